//! Angle between the knee's axis and the bone, section 2.2.4: eq. 12, `e = μ − arccos(r·u)`, u the bone's direction towards the
//! body. By `atan2`, which is exact where the arc cosine is not.

use nalgebra::{Vector2, Vector3};

use crate::so3::{angle_between, tangent_basis};

/// Residual, derivatives by the axis and by the bone (proximal minus distal joint).
pub fn linearised(axis: &Vector3<f64>, bone: &Vector3<f64>, mean: f64) -> (f64, Vector2<f64>, Vector3<f64>) {
    let length = bone.norm();
    let u = bone / length;
    let cosine = axis.dot(&u);
    // |r × u|; where both are parallel the angle has no derivative, and none is claimed.
    let sine = axis.cross(&u).norm();
    let per = if sine > 1e-9 { 1.0 / sine } else { 0.0 };
    let by_axis = tangent_basis(axis).tr_mul(&u) * per;
    let by_bone = (axis - u * cosine) * (per / length);
    (residual(axis, bone, mean), by_axis, by_bone)
}

/// The residual alone, rad.
pub fn residual(axis: &Vector3<f64>, bone: &Vector3<f64>, mean: f64) -> f64 {
    mean - angle_between(axis, bone)
}
