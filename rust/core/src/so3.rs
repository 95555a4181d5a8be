//! The unit sphere and its tangent planes.

use nalgebra::{Matrix3x2, Vector2, Vector3};

/// An orthonormal basis `[b1 b2]` (3×2) of the plane tangent to the unit sphere at `j`, right-handed with `j`.
///
/// Built from the coordinate axis that is farthest from `j`, so it is regular everywhere (the spherical angles of eqs 20–21
/// of Olsson 2020 are not, near the poles).
pub fn tangent_basis(j: &Vector3<f64>) -> Matrix3x2<f64> {
    let mut farthest = Vector3::zeros();
    farthest[j.iamin()] = 1.0;
    let b1 = farthest.cross(j).normalize();
    let b2 = j.cross(&b1);
    Matrix3x2::from_columns(&[b1, b2])
}

/// The unit vector reached from `j` by the tangent step `basis·step`.
pub fn retract(j: &Vector3<f64>, basis: &Matrix3x2<f64>, step: &Vector2<f64>) -> Vector3<f64> {
    (j + basis * step).normalize()
}

/// Angle between two unit vectors, rad; exact near 0 and π, where an arc cosine is not.
pub fn angle_between(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    nalgebra::RealField::atan2(a.cross(b).norm(), a.dot(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn basis_is_orthonormal_and_right_handed_also_at_the_poles() {
        for j in [
            Vector3::z(),
            -Vector3::z(),
            Vector3::x(),
            Vector3::new(0.3, -0.4, 0.5).normalize(),
            Vector3::new(1e-9, 0.0, 1.0).normalize(),
        ] {
            let b = tangent_basis(&j);
            assert!((b.transpose() * b - nalgebra::Matrix2::identity()).norm() < 1e-15);
            assert!((b.transpose() * j).norm() < 1e-15);
            assert!((b.column(0).cross(&b.column(1)) - j).norm() < 1e-15);
        }
    }

    #[test]
    fn retraction_has_unit_length_and_the_step_as_derivative() {
        let j = Vector3::new(0.2, 0.9, -0.1).normalize();
        let b = tangent_basis(&j);
        let step = Vector2::new(1e-6, -2e-6);
        let moved = retract(&j, &b, &step);
        assert!((moved.norm() - 1.0).abs() < 1e-15);
        assert!((moved - j - b * step).norm() < 1e-11);
        assert!((angle_between(&moved, &j) - step.norm()).abs() < 1e-15);
    }
}
