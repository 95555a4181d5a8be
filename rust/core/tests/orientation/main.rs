//! The orientation filters from outside the crate: the literal paper as oracle, laws that hold for any data, accuracy and
//! honesty on simulations.

mod biases;
mod bytes;
mod data;
mod gaps;
mod laws;
mod literal;
mod starts;
mod truth;
