//! Irregular time, gaps, and a heading that went wrong.

use imufast_core::orientation::{Complementary, Filter, Mekf, Settings, Status};
use nalgebra::{UnitQuaternion, Vector3};

use crate::data::{BallJoint, Random, unit};

#[test]
fn irregular_time_costs_no_accuracy() {
    let joint = BallJoint::new(21, 100.0);
    let mut random = Random(22);
    let times: Vec<f64> = (0..3000).map(|k| k as f64 * 0.01 + 0.006 * random.uniform()).collect();
    let recording = joint.at_times(&times);
    let error = recording.rms_deg(&recording.estimates(&joint.settings(), Mekf::default()));
    let even = joint.record(30.0);
    let even = even.rms_deg(&even.estimates(&joint.settings(), Mekf::default()));
    assert!(error < 1.6 * even + 0.1, "{error} against {even}");
}

#[test]
fn a_short_gap_is_bridged_and_said() {
    let joint = BallJoint::new(23, 100.0);
    let times: Vec<f64> = (0..3000).filter(|k| !(1500..1510).contains(k)).map(|k| k as f64 * 0.01).collect();
    let recording = joint.at_times(&times);
    for method in [true, false] {
        let estimates = if method {
            recording.estimates(&joint.settings(), Mekf::default())
        } else {
            recording.estimates(&joint.settings(), Complementary::default())
        };
        assert!(estimates[1500].std > 1.05 * estimates[1490].std, "uncertainty grows over the gap");
        assert!(estimates[1700].std < 1.5 * estimates[1490].std, "and shrinks again");
        let errors = recording.errors(&estimates);
        assert!(errors[1500..1520].iter().all(|e| e.norm() < 3.0 * estimates[1500].std));
        assert!(errors[1700..].iter().all(|e| e.norm().to_degrees() < 3.0));
    }
}

#[test]
fn after_a_long_gap_it_starts_anew_unless_told_not_to() {
    let joint = BallJoint::new(24, 100.0);
    let times: Vec<f64> = (0..4000).filter(|k| !(1500..1900).contains(k)).map(|k| k as f64 * 0.01).collect();
    let recording = joint.at_times(&times);
    let mut filter = Filter::<f64, _>::new(joint.settings(), Mekf::default());
    recording.push_all(&mut filter, 0..1510);
    assert_eq!(filter.latest().status, Status::Starting);
    assert_eq!(filter.restarts(), 1);
    recording.push_all(&mut filter, 1510..times.len());
    let last = filter.latest();
    assert!(last.status == Status::Tracking && unit(last.q).angle_to(&recording.truth[times.len() - 1]).to_degrees() < 2.0);
    // In the whole recording the new start reaches back to the gap and not across it.
    let estimates = recording.estimates(&joint.settings(), Mekf::default());
    let errors = recording.errors(&estimates);
    assert!(errors.iter().all(|e| e.norm().to_degrees() < 6.0));
    assert!(estimates[1499].status == Status::Tracking && estimates[1500].status == Status::Starting);
    let stubborn = Settings { restart: false, ..joint.settings() };
    let mut filter = Filter::<f64, _>::new(stubborn, Mekf::default());
    recording.push_all(&mut filter, 0..1502);
    assert!(filter.restarts() == 0 && filter.latest().std > 1.0);
}

#[test]
fn a_wrong_heading_is_noticed_and_found_again() {
    let joint = BallJoint::new(25, 100.0);
    let recording = joint.record(60.0);
    let up = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, 2.8));
    // Wrong about the vertical of sensor 1 at the beginning, and sure of it.
    let vertical = Vector3::from(recording.xyz[1][0]).normalize();
    let wrong = UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_normalize(vertical), up.angle()) * recording.truth[0];
    let q = wrong.as_vector();
    let settings = Settings { given: Some(([q[3], q[0], q[1], q[2]], 0.005)), ..joint.settings() };
    for mekf in [true, false] {
        let (last, restarts) = if mekf {
            let mut f = Filter::<f64, _>::new(settings, Mekf { adapt: false, ..Mekf::default() });
            recording.push_all(&mut f, 0..6000);
            (f.latest(), f.restarts())
        } else {
            let slow = Complementary { beta: 0.01, heading_gain: 1.0, ..Complementary::default() };
            let mut f = Filter::<f64, _>::new(settings, slow);
            recording.push_all(&mut f, 0..6000);
            (f.latest(), f.restarts())
        };
        assert!(restarts <= 2, "{restarts}");
        assert!(unit(last.q).angle_to(&recording.truth[5999]).to_degrees() < 3.0, "mekf {mekf}, {restarts} restarts");
    }
}
