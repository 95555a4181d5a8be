//! Algorithm 1 as printed, with both orientations, and the filter in one frame must be the same.

use imufast_core::orientation::{Complementary, Filter, Mekf, Outliers, Settings};
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Quaternion, UnitQuaternion, Vector3, Vector6};

use crate::data::BallJoint;

type V = Vector3<f64>;

fn published(joint: &BallJoint) -> Settings {
    Settings { midpoint: false, scale_noise: 0.0, given: Some(([1.0, 0.0, 0.0, 0.0], 0.1)), restart: false, ..joint.settings() }
}

/// Joint-centre accelerations with the five-point stencil; None where a neighbour is missing.
fn accelerations(joint: &BallJoint, xyz: &[Vec<[f64; 3]>; 4], k: usize) -> Option<[V; 2]> {
    let h = 1.0 / joint.rate_hz;
    let side = |i: usize, r: [f64; 3]| {
        let gyr = |k: usize| V::from(xyz[2 * i][k]);
        let dot = (gyr(k - 2) - gyr(k - 1) * 8.0 + gyr(k + 1) * 8.0 - gyr(k + 2)) / (12.0 * h);
        let k_matrix = gyr(k).cross_matrix() * gyr(k).cross_matrix() + dot.cross_matrix();
        V::from(xyz[2 * i + 1][k]) - k_matrix * V::from(r)
    };
    (k >= 2 && k + 2 < xyz[0].len()).then(|| [side(0, joint.joint.r1), side(1, joint.joint.r2)])
}

/// Eq. 5b with `S(q)` of eq. 7 as corrected (`+[q_v×]`), renormalised.
fn step(q: UnitQuaternion<f64>, turn: V) -> UnitQuaternion<f64> {
    let v = q.imag();
    let change = turn * q.w + v.cross(&turn);
    let half = 0.5;
    UnitQuaternion::from_quaternion(Quaternion::from_parts(q.w - half * v.dot(&turn), v + change * half))
}

#[test]
fn the_complementary_filter_is_algorithm_1() {
    let joint = BallJoint::new(1, 50.0);
    let recording = joint.record(20.0);
    let method = Complementary {
        beta: 0.3,
        heading_gain: 1.0,
        soft_angle: 0.0,
        drift_limit: 0.0,
        literal: true,
        ..Complementary::default()
    };
    let estimates = recording.estimates(&published(&joint), method);
    let t = 1.0 / joint.rate_hz;
    let mut q = [UnitQuaternion::identity(); 2];
    let mut worst = 0.0f64;
    for (k, estimate) in estimates.iter().enumerate() {
        let mut rate = [0, 2].map(|i| V::from(recording.xyz[i][k]));
        if let Some([a1, a2]) = accelerations(&joint, &recording.xyz, k) {
            // Eq. 13: the 6-vector gradient of the stacked deviations.
            let [r1, r2] = q.map(|q| *q.to_rotation_matrix().matrix());
            let mut jacobian = Matrix3x6::zeros();
            jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-r1 * a1.cross_matrix()));
            jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&(r2 * a2.cross_matrix()));
            let gradient: Vector6<f64> = jacobian.transpose() * (r1 * a1 - r2 * a2);
            let correction = gradient.normalize() * method.beta;
            rate[0] -= correction.fixed_rows::<3>(0);
            rate[1] -= correction.fixed_rows::<3>(3);
        }
        if k > 0 {
            q = [0, 1].map(|i| step(q[i], rate[i] * t));
        }
        let relative = q[0].inverse() * q[1];
        worst = worst.max(relative.angle_to(&crate::data::unit(estimate.q)));
    }
    assert!(estimates.len() == 1000 && worst < 1e-9, "{worst}");
}

/// The published filter with both orientations as states and a 6×6 covariance.
struct Literal {
    q: [UnitQuaternion<f64>; 2],
    p: Matrix6<f64>,
}

impl Literal {
    fn time_update(&mut self, rate: [V; 2], t: f64, gyr_std: f64) {
        let mut f = Matrix6::identity();
        for (i, rate) in rate.into_iter().enumerate() {
            self.q[i] *= UnitQuaternion::from_scaled_axis(rate * t);
            let turn = UnitQuaternion::from_scaled_axis(-rate * t).to_rotation_matrix();
            f.fixed_view_mut::<3, 3>(3 * i, 3 * i).copy_from(turn.matrix());
        }
        self.p = f * self.p * f.transpose() + Matrix6::identity() * (t * t * gyr_std * gyr_std);
    }

    fn measurement_update(&mut self, [a1, a2]: [V; 2], link_var: f64, limit: Option<f64>) {
        let [r1, r2] = self.q.map(|q| *q.to_rotation_matrix().matrix());
        let e = -(r1 * a1 - r2 * a2);
        let mut h = Matrix3x6::zeros();
        h.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-r1 * a1.cross_matrix()));
        h.fixed_view_mut::<3, 3>(0, 3).copy_from(&(r2 * a2.cross_matrix()));
        let s = h * self.p * h.transpose() + Matrix3::identity() * link_var;
        let inverse = s.try_inverse().unwrap_or_else(Matrix3::zeros);
        if limit.is_some_and(|limit| (e.transpose() * inverse * e)[0] > limit) {
            return;
        }
        let k = self.p * h.transpose() * inverse;
        let eta = k * e;
        for i in 0..2 {
            self.q[i] *= UnitQuaternion::from_scaled_axis(eta.fixed_rows::<3>(3 * i));
        }
        self.p = (Matrix6::identity() - k * h) * self.p;
    }

    /// Covariance of the relative error, in frame 2.
    fn relative_variance(&self) -> f64 {
        let back = (self.q[1].inverse() * self.q[0]).to_rotation_matrix();
        let mut j = Matrix3x6::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-back.matrix()));
        j.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
        (j * self.p * j.transpose()).trace()
    }
}

#[test]
fn the_kalman_filter_with_three_states_is_the_published_one_with_six() {
    for (outliers, limit) in [(Outliers::Keep, None), (Outliers::Reject, Some(7.81))] {
        let joint = BallJoint::new(2, 50.0);
        let mut recording = joint.record(20.0);
        for k in (200..1000).step_by(37).filter(|_| limit.is_some()) {
            recording.xyz[1][k][0] += 30.0; // an impact
        }
        let start = joint.truth(0.0) * UnitQuaternion::from_scaled_axis(V::new(0.003, -0.002, 0.004));
        let std = 0.01;
        let q = start.as_vector();
        let settings = Settings { midpoint: true, given: Some(([q[3], q[0], q[1], q[2]], std)), ..published(&joint) };
        let mut filter = Filter::<f64, _>::new(settings, Mekf { outliers, limit: 7.81, adapt: false });
        let estimates = recording.estimates(&settings, Mekf { outliers, limit: 7.81, adapt: false });
        let link_var = filter.state().link_var;
        filter.push(0.0, &[0.0; 12]);
        let half = std * std / 6.0;
        let mut literal = Literal { q: [UnitQuaternion::identity(), start], p: Matrix6::identity() * half };
        let t = 1.0 / joint.rate_hz;
        let (mut worst, mut worst_std) = (0.0f64, 0.0f64);
        for (k, estimate) in estimates.iter().enumerate() {
            // The mean of neighbouring rates: linearisation is then at fault for less than the filters' noise.
            let mean = |i: usize| (V::from(recording.xyz[i][k]) + V::from(recording.xyz[i][k - 1])) * 0.5;
            let rate = if k > 0 { [0, 2].map(mean) } else { [V::zeros(); 2] };
            literal.time_update(rate, t, joint.noise.gyr_std);
            if let Some(a) = accelerations(&joint, &recording.xyz, k) {
                literal.measurement_update(a, link_var, limit);
            }
            let relative = literal.q[0].inverse() * literal.q[1];
            worst = worst.max(relative.angle_to(&crate::data::unit(estimate.q)));
            worst_std = worst_std.max((literal.relative_variance().sqrt() / estimate.std - 1.0).abs());
        }
        // Two corrections are one rotation, and two linearisations one, to first order only.
        assert!(estimates.len() == 1000 && worst < 1e-3, "{outliers:?}: {worst}");
        assert!(worst_std < 0.02, "{outliers:?}: {worst_std}");
    }
}
