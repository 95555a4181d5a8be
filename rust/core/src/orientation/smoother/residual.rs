//! Residuals and Jacobians. Unknown are `W` at every key, perturbed on the right, and eighteen constants.

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::keys::Key;

/// Constants of a recording.
pub const CONSTANTS: usize = 18;
/// Where they stand: r_1, r_2 (m, from the joint centre to the sensor), accelerometer biases (m/s²), gyroscope biases (rad/s).
pub const LEVERS: usize = 0;
/// Accelerometer biases.
pub const ACC_BIASES: usize = 6;
/// Gyroscope biases.
pub const GYR_BIASES: usize = 12;

/// The constants, or one of their triples.
pub type Constants = SVector<f64, CONSTANTS>;

/// Three constants from place `at`.
pub fn triple(x: &Constants, at: usize) -> Vector3<f64> {
    x.fixed_rows::<3>(at).into()
}

/// The link (eq. 3 of Remmerswaal 2021) in drift frame 1, m/s²: `e = f_1 − W f_2`, `f_i = A_i − B_i b_a,i − C_i r_i`.
pub struct Link {
    /// e.
    pub residual: Vector3<f64>,
    /// `∂e/∂η = W [f_2×]`.
    pub turn: Matrix3<f64>,
    /// `∂e/∂(r_1, r_2, b_a,1, b_a,2) = [−C_1, W C_2, −B_1, W B_2]`.
    pub constants: SMatrix<f64, 3, 12>,
}

/// The acceleration of the joint centre as each sensor sees it, in its drift frame.
pub fn joint_acc(key: &Key, x: &Constants) -> [Vector3<f64>; 2] {
    [0, 1].map(|i| {
        let view = &key.view[i];
        view.acc - view.bias * triple(x, ACC_BIASES + 3 * i) - view.lever * triple(x, LEVERS + 3 * i)
    })
}

impl Link {
    /// At one key.
    pub fn at(key: &Key, w: &UnitQuaternion<f64>, x: &Constants) -> Self {
        let [f1, f2] = joint_acc(key, x);
        let w = w.to_rotation_matrix().into_inner();
        let mut constants = SMatrix::<f64, 3, 12>::zeros();
        constants.fixed_view_mut::<3, 3>(0, 0).copy_from(&-key.view[0].lever);
        constants.fixed_view_mut::<3, 3>(0, 3).copy_from(&(w * key.view[1].lever));
        constants.fixed_view_mut::<3, 3>(0, 6).copy_from(&-key.view[0].bias);
        constants.fixed_view_mut::<3, 3>(0, 9).copy_from(&(w * key.view[1].bias));
        Self { residual: f1 - w * f2, turn: w * f2.cross_matrix(), constants }
    }
}

/// The drift from one key to the next, rad: `p = Log(W_kᵀ W_k+1) − W_kᵀ S_1 β_1 + S_2 β_2`, where `S_i = ∫Q_i dt` and β_i is
/// what the gyroscope bias has moved by since the drift frames were made.
pub struct Drift {
    /// p.
    pub residual: Vector3<f64>,
    /// `∂p/∂η_k = −J_l⁻¹(Log) − [W_kᵀ S_1 β_1 ×]`.
    pub here: Matrix3<f64>,
    /// `∂p/∂η_k+1 = J_r⁻¹(Log)`.
    pub next: Matrix3<f64>,
    /// `∂p/∂(b_g,1, b_g,2) = [−W_kᵀ S_1, S_2]`.
    pub biases: [Matrix3<f64>; 2],
}

impl Drift {
    /// From `key`, where W is `w`, to the next, where it is `next`; `moved` is β_1, β_2.
    pub fn between(key: &Key, w: &UnitQuaternion<f64>, next: &UnitQuaternion<f64>, moved: &[Vector3<f64>; 2]) -> Self {
        let turn = (w.inverse() * next).scaled_axis();
        let back = w.inverse().to_rotation_matrix().into_inner();
        let biases = [-(back * key.view[0].turned), key.view[1].turned];
        let first = biases[0] * moved[0];
        let inverse = inverse_right_jacobian(&turn);
        Self {
            residual: turn + first + biases[1] * moved[1],
            here: first.cross_matrix() - inverse.transpose(),
            next: inverse,
            biases,
        }
    }
}

/// `J_r⁻¹(φ) = I + [φ×]/2 + (1/θ² − (1 + cos θ)/(2θ sin θ)) [φ×]²`; its transpose is `J_l⁻¹(φ)`.
pub fn inverse_right_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let square = phi.norm_squared();
    let cross = phi.cross_matrix();
    // Below this the next term of the series is under 1e-12 of what stays.
    let factor = if square < 1e-4 {
        1.0 / 12.0 + square / 720.0 + square * square / 30240.0
    } else {
        let half = 0.5 * nalgebra::ComplexField::sqrt(square);
        let (sin, cos) = nalgebra::ComplexField::sin_cos(half);
        (1.0 - half * cos / sin) / square
    };
    Matrix3::identity() + cross * 0.5 + cross * cross * factor
}
