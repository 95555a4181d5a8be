//! Algorithm 1 of Olsson et al. 2020 from outside the crate: derivatives against differences, sums against a plain loop,
//! and every way in which a descent can end.

mod cost;
mod data;
mod solve;
