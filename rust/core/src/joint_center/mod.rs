//! The centre of a joint as seen from the sensors on its two segments: Olsson & Halvorsen 2017.
//!
//! Both sensors see the same specific force at the joint centre, each in its own frame, so its norms agree (eq. 16):
//! `e = ‖a1 − b1 − K1 r1‖ − ‖a2 − b2 − K2 r2‖`. The lever arms `r` and, beyond the paper, the accelerometer biases `b` are
//! those that make e small. Smoothed, the same equation reads `e = ‖A1 − B1 b1 − C1 r1‖ − ‖A2 − B2 b2 − C2 r2‖`.
//!
//! | module | holds |
//! | --- | --- |
//! | [`moments`] | the samples, raw with their angular accelerations, or smoothed |
//! | [`smooth`] | the low-pass in a frame that does not turn |
//! | [`residual`] | e and its derivatives (eqs 16–19), summed in one pass |
//! | [`loss`] | squares, absolute values, Huber |
//! | [`solve`] | SS (eq. 15) and SA (eq. 20): the descent, its start, its end |
//! | [`ls`] | LS (eqs 10–14), where the relative orientation is known |
//! | [`observability`] | covariance under correlated residuals; what the motion did not determine |
//! | [`estimate`] | all starts, the minimum, what it is worth |
//! | [`stream`] | from an endless stream in bounded memory |

pub mod estimate;
pub mod loss;
pub mod ls;
pub mod moments;
pub mod observability;
pub mod residual;
pub mod smooth;
pub mod solve;
pub mod stream;

use nalgebra::{SMatrix, SVector, Vector3};

/// The unknowns: r1, r2 (m, from the joint centre to the sensor), then the accelerometer biases b1, b2 (m/s²).
pub type Unknowns = SVector<f64, 12>;
/// A matrix over [`Unknowns`].
pub type Matrix12 = SMatrix<f64, 12, 12>;

/// One of the four parts of [`Unknowns`].
pub(crate) fn part(x: &Unknowns, which: usize) -> Vector3<f64> {
    x.fixed_rows::<3>(3 * which).into()
}
