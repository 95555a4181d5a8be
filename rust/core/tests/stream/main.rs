//! The hinge stream from outside the crate: cutting and saving change no bit, damaged bytes give nothing and never panic, and
//! what it remembers tells the axis, the pairing and a slip.

mod bytes;
mod data;
mod laws;
mod memory;
mod truth;
