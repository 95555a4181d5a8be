//! The lower body from outside the crate: derivatives against differences, preintegration against Monte Carlo, the solution
//! against a dense one, and simulated bodies whose truth is known.

mod band;
mod data;
mod factors;
mod preintegration;
mod solve;
