//! The closed form knows what it knows.

use imufast_core::orientation::{Filter, Mekf, Settings, Status, start_of};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use crate::data::{BallJoint, Random, unit};

#[test]
fn without_noise_it_is_exact() {
    let mut random = Random(31);
    for _ in 0..50 {
        let truth = UnitQuaternion::from_scaled_axis(random.vector(2.0));
        let [a1, a2]: [Vec<[f64; 3]>; 2] = {
            let second: Vec<Vector3<f64>> = (0..3).map(|_| random.vector(5.0)).collect();
            [second.iter().map(|a| (truth * a).into()).collect(), second.iter().map(|a| (*a).into()).collect()]
        };
        let still = [[0.0; 3]; 3];
        let (q, p) = start_of([&still, &still], [&a1, &a2], 0.02);
        assert!(unit(q).angle_to(&truth) < 1e-6, "{}", unit(q).angle_to(&truth));
        assert!(p[0] > 0.0 && p[3] > 0.0 && p[5] > 0.0);
    }
}

#[test]
fn at_rest_the_heading_stays_open_and_says_so() {
    let tilt = Rotation3::from_euler_angles(0.4, -0.7, 1.0);
    let up = tilt.inverse() * Vector3::new(0.0, 0.0, 9.81);
    let sample = [0.0, 0.0, 0.0, 0.0, 0.0, 9.81, 0.0, 0.0, 0.0, up.x, up.y, up.z];
    let mut filter = Filter::<f64, _>::new(Settings::default(), Mekf::default());
    for k in 0..100_000 {
        filter.push(k as f64 * 0.01, &sample);
    }
    let estimate = filter.latest();
    assert_eq!(estimate.status, Status::Starting);
    assert!(estimate.std > 1.5, "{}", estimate.std);
    assert!((unit(estimate.q) * up - Vector3::new(0.0, 0.0, 9.81)).norm() < 1e-3, "tilt is known");
}

#[test]
fn a_given_start_wins() {
    let joint = BallJoint::new(32, 100.0);
    let recording = joint.record(3.0);
    let q = [0.5, 0.5, -0.5, 0.5];
    let settings = Settings { given: Some((q, 0.01)), ..joint.settings() };
    let mut filter = Filter::<f64, _>::new(settings, Mekf::default());
    recording.push_all(&mut filter, 0..1);
    assert_eq!(filter.latest().status, Status::Tracking);
    assert!(unit(filter.latest().q).angle_to(&unit(q)) < 1e-12);
}

#[test]
fn it_ends_where_its_bound_says_and_within_three_of_them() {
    for seed in 0..30 {
        let joint = BallJoint::new(100 + seed, 100.0);
        let recording = joint.record(30.0);
        let estimates = recording.estimates(&joint.settings(), Mekf::default());
        let Some(end) = estimates.iter().position(|e| e.status != Status::Starting) else { panic!("seed {seed}") };
        assert!(end < 2000, "seed {seed}: {end}");
        assert!(estimates[end].std <= 3.0 * joint.settings().start_std);
        let error = recording.errors(&estimates)[end].norm();
        assert!(error < 3.0 * estimates[end].std, "seed {seed}: {error}");
    }
}
