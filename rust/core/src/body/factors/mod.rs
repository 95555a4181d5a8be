//! The terms of the posterior, one file each: the residual, and its derivatives by the unknowns that it depends on.
//!
//! Here rotations are moved on the right, `R Exp(φ)`; unit vectors in the basis of [`crate::so3::tangent_basis`]; all else by
//! sums. A step of the solver turns from the left, which is `Rᵀ` of it ([`super::states::Motion::moved`]).

pub mod axes_agree;
pub mod axis_angle;
pub mod gauge;
pub mod hinge;
pub mod imu;
pub mod joint_center;
pub mod length_difference;
pub mod length_limits;
pub mod segment_length;
pub mod skin;
