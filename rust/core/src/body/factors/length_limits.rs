//! Least and most length of a bone, section 2.2.6: eqs 14 and 15.

use nalgebra::{ComplexField, Vector3};

/// Residual, m, and derivative by the bone: `x tanh²(a x)` of what the length x exceeds the limits by.
pub fn linearised(bone: &Vector3<f64>, limits: [f64; 2], steepness: f64) -> (f64, Vector3<f64>) {
    let length = bone.norm();
    let (beyond, sign) = if length > limits[1] {
        (length - limits[1], 1.0)
    } else if length < limits[0] {
        (limits[0] - length, -1.0)
    } else {
        return (0.0, Vector3::zeros());
    };
    let t = ComplexField::tanh(steepness * beyond);
    let slope = t * t + 2.0 * beyond * t * steepness * (1.0 - t * t);
    (beyond * t * t, if length > 0.0 { bone * (sign * slope / length) } else { Vector3::zeros() })
}
