//! The axis of a hinge joint from two inertial sensors: Olsson, Kok, Seel, Halvorsen, *Robust Plug-and-Play Joint Axis
//! Estimation Using Inertial Sensors*, Sensors 2020, doi 10.3390/s20123534 (equation numbers below are that paper's).
//!
//! * [`axes`], [`residual`], [`cost`]: unknowns; residuals and Jacobians (eqs 24–25, 36–39); the cost over chosen samples
//! * [`solve`]: Gauss–Newton with sign-pair re-initialisation (Algorithm 1), deterministic starts, distinct minima
//! * [`scores`], [`select`], [`prune`]: which samples to use (Algorithms 2 and 3)
//! * [`sign`]: which of the two sign pairings is right, from motion in the plane of the hinge
//! * [`evidence`]: covariance (eq. 57 and a sandwich), angular deviation in closed form (eqs 60–65), residual statistics
//! * [`stream`], [`record`]: all of it on an endless stream in bounded memory, and what it says at one moment

pub mod axes;
pub mod cost;
pub mod evidence;
pub mod prune;
pub mod record;
pub mod residual;
pub mod scores;
pub mod select;
pub mod sign;
pub mod solve;
pub mod stream;

pub use axes::AxisPair;
pub use cost::{HingeCost, Weights};
pub use evidence::Evidence;
pub use solve::{Minimum, Solution, SolveOptions, Status, deterministic_starts, solve};
