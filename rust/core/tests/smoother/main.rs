//! The smoother from outside the crate: derivatives against differences, the solution against a dense one, recordings whose
//! truth is known, and every way in which a descent can end.

mod data;
mod ends;
mod laws;
mod oracle;
mod truth;
