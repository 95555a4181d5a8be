//! The unit sphere and its tangent planes; how the exponential map of rotations bends.

use nalgebra::{ComplexField, Matrix3, Matrix3x2, RealField, Rotation3, UnitQuaternion, Vector2, Vector3};

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

/// `J_r(φ) = I − (1 − cos θ)/θ² [φ×] + (θ − sin θ)/θ³ [φ×]²`, with which `Exp(φ + δ) = Exp(φ) Exp(J_r(φ) δ)`.
pub fn right_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let square = phi.norm_squared();
    let cross = phi.cross_matrix();
    // Below this the next term of the series is under 1e-13 of what stays.
    let (a, b) = if square < 1e-3 {
        (
            0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0 - square / 40320.0)),
            1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0 - square / 362_880.0)),
        )
    } else {
        let angle = ComplexField::sqrt(square);
        let (sin, cos) = ComplexField::sin_cos(angle);
        ((1.0 - cos) / square, (angle - sin) / (square * angle))
    };
    Matrix3::identity() - cross * a + cross * cross * b
}

/// The rotation vector of a rotation matrix; exact for small angles, where an arc cosine is not.
pub fn log(r: &Matrix3<f64>) -> Vector3<f64> {
    let twice_sine = Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]);
    let cosine = 0.5 * (r.trace() - 1.0);
    // Near half a turn the sine tells the axis badly; a quaternion's vector part tells it well.
    if cosine < -0.5 {
        return UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*r)).scaled_axis();
    }
    let sine = 0.5 * twice_sine.norm();
    let ratio = if sine > 1e-8 { RealField::atan2(sine, cosine) / sine } else { 1.0 };
    twice_sine * (0.5 * ratio)
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
    fn the_right_jacobian_is_the_derivative_of_the_exponential_and_has_no_seam() {
        use nalgebra::Rotation3;
        let axis = Vector3::new(0.48, -0.6, 0.64);
        for angle in [0.0, 1e-5, 0.03, 0.4, 2.0, 3.1] {
            let phi = axis * angle;
            for k in 0..3 {
                let mut step = Vector3::zeros();
                step[k] = 1e-6;
                let back = Rotation3::from_scaled_axis(phi - step).inverse();
                let found = log((back * Rotation3::from_scaled_axis(phi + step)).matrix()) / 2e-6;
                assert!((found - right_jacobian(&phi).column(k)).norm() < 1e-8, "{angle}");
            }
        }
        let edge = 1e-3_f64.sqrt();
        let gap = right_jacobian(&(axis * (edge - 1e-12))) - right_jacobian(&(axis * (edge + 1e-12)));
        assert!(gap.norm() < 1e-11);
    }

    #[test]
    fn the_logarithm_undoes_the_exponential_at_every_angle() {
        use nalgebra::Rotation3;
        for axis in [Vector3::new(0.48, -0.6, 0.64), Vector3::z(), -Vector3::x()] {
            for angle in [0.0, 1e-12, 1e-8, 1.1e-8, 1e-5, 0.3, 1.5, 2.09, 2.1, 3.0, 3.13] {
                let phi = axis * angle;
                let gap = (log(&Rotation3::from_scaled_axis(phi).into_inner()) - phi).norm();
                assert!(gap < 1e-15 + 1e-12 * angle, "{angle}: {gap}");
            }
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
