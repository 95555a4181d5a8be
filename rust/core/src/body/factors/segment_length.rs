//! Length of a bone, section 2.2.5: eq. 13, `e = |s_1 − s_2| − μ`.

use nalgebra::Vector3;

/// Residual, m, and derivative by the bone (one joint minus the other).
pub fn linearised(bone: &Vector3<f64>, mean: f64) -> (f64, Vector3<f64>) {
    let length = bone.norm();
    (length - mean, if length > 0.0 { bone / length } else { Vector3::zeros() })
}
