//! Left against right, section 2.2.7: eq. 16, `e = |s_1 − s_2| − |s_3 − s_4|`.

use nalgebra::Vector3;

use super::segment_length;

/// Residual, m, and derivatives by both bones.
pub fn linearised(bones: [&Vector3<f64>; 2]) -> (f64, [Vector3<f64>; 2]) {
    let [(a, by_a), (b, by_b)] = bones.map(|bone| segment_length::linearised(bone, 0.0));
    (a - b, [by_a, -by_b])
}
