//! The joint centre from outside the crate: derivatives and sums against slow loops, the truth of exact motion, and a stream
//! that breaks, saving, damage and hours cannot bend.

mod bytes;
mod data;
mod residual;
mod stream;
mod truth;
