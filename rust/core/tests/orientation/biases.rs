//! Gyroscope biases that nobody knows: what they do to a filter is what it says they might.

use imufast_core::orientation::{Complementary, Estimate, Filter, Mekf, Settings, method::Method};
use nalgebra::{Matrix3, Vector3};

use crate::data::{BallJoint, Recording, unit};

/// rad/s.
const BIAS: f64 = 0.004;

/// The same recording, the rates of sensor 2 biased.
fn biased(recording: &Recording, bias: Vector3<f64>) -> Recording {
    let mut more = recording.clone();
    more.xyz[2].iter_mut().for_each(|gyr| *gyr = (Vector3::from(*gyr) + bias).into());
    more
}

fn run<M: Method>(settings: &Settings, method: M, recording: &Recording, samples: usize) -> (Filter<f64, M>, Estimate) {
    let mut filter = Filter::<f64, M>::new(*settings, method);
    recording.push_all(&mut filter, 0..samples);
    let latest = filter.latest();
    (filter, latest)
}

/// How an estimate leans with a bias, by differences, beside what the filter keeps of it.
fn check<M: Method>(method: M, most: f64) {
    let (mut off, mut size) = (0.0, 0.0);
    for seed in 0..6 {
        let joint = BallJoint::new(300 + seed, 100.0);
        let recording = joint.record(40.0);
        let mut settings = joint.settings();
        let q = joint.truth(0.0);
        settings.given = Some(([q.w, q.i, q.j, q.k], 0.02));
        settings.joint.relative_bias_std = BIAS;
        for samples in [1000, 2000, 3000, 4000] {
            let (filter, plain) = run(&settings, method, &recording, samples);
            let mut leant = Matrix3::zeros();
            for axis in 0..3 {
                let bias = Vector3::ith(axis, BIAS);
                let (_, other) = run(&settings, method, &biased(&recording, bias), samples);
                let turned = (unit(plain.q).inverse() * unit(other.q)).scaled_axis() / BIAS;
                leant.set_column(axis, &turned);
            }
            let kept = Matrix3::from_fn(|r, c| filter.state().leaning.rows[r][c]);
            off += (leant - kept).norm_squared();
            size += leant.norm_squared();
            assert!(plain.std * plain.std > 0.99 * filter.state().leaning.variance);
        }
    }
    assert!(off < most * most * size, "{}", (off / size).sqrt());
}

#[test]
fn the_kalman_filter_knows_how_it_leans_with_a_bias() {
    check(Mekf { adapt: false, ..Mekf::default() }, 0.5);
}

#[test]
fn the_complementary_filter_knows_how_it_leans_with_a_bias() {
    check(Complementary { drift_limit: 0.0, ..Complementary::default() }, 0.5);
}

#[test]
fn without_biases_nothing_is_added() {
    let joint = BallJoint::new(310, 100.0);
    let recording = joint.record(20.0);
    let (filter, _) = run(&joint.settings(), Mekf::default(), &recording, 2000);
    assert_eq!(filter.state().leaning.variance, 0.0);
}
