//! What must hold whatever the data.

use imufast_core::orientation::{
    Complementary, Estimate, Estimates, Filter, Joint, Mekf, Outliers, Page, Settings, Signals, Status, lane::Real,
    method::Method, run_batch,
};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use crate::data::{BallJoint, Random, Recording, run_over, unit};

#[test]
fn every_sample_has_one_unit_quaternion() {
    let joint = BallJoint::new(3, 100.0);
    for count in [0, 1, 2, 4, 5, 6, 50, 1000] {
        let recording = joint.record(count as f64 / 100.0 + 1e-9);
        for estimates in [
            recording.estimates(&joint.settings(), Mekf::default()),
            recording.estimates(&joint.settings(), Complementary::default()),
        ] {
            assert_eq!(estimates.len(), count);
            for e in estimates {
                unit(e.q);
                assert!(e.std > 0.0 && e.std < 4.0);
            }
        }
    }
}

#[test]
fn saved_and_restored_it_goes_on_as_if_nothing_had_happened() {
    fn check<M: Method + core::fmt::Debug>(method: M) {
        let joint = BallJoint::new(4, 200.0);
        let recording = joint.record(12.0);
        let mut whole = Filter::<f64, M>::new(joint.settings(), method);
        recording.push_all(&mut whole, 0..2400);
        for cut in [0, 1, 3, 40, 1000, 2399] {
            let mut first = Filter::<f64, M>::new(joint.settings(), method);
            recording.push_all(&mut first, 0..cut);
            let Some(mut second) = Filter::<f64, M>::from_bytes(&first.to_bytes()) else { panic!("cut {cut}") };
            recording.push_all(&mut second, cut..2400);
            assert!(second == whole && second.to_bytes() == whole.to_bytes(), "cut {cut}");
            assert_eq!(second.latest(), whole.latest());
        }
    }
    check(Mekf::default());
    check(Complementary { bias_gain: 0.01, beta_extra: 1.0, ..Complementary::default() });
}

#[test]
fn a_recording_in_a_batch_gives_the_bits_it_gives_alone() {
    fn check<M: Method>(method: M) {
        let joints: Vec<BallJoint> = (0..13).map(|k| BallJoint::new(10 + k, if k == 6 { 300.0 } else { 100.0 })).collect();
        let mut recordings: Vec<Recording> = joints.iter().enumerate().map(|(k, j)| j.record(4.0 + 3.0 * k as f64)).collect();
        // One lane loses its heading on the way: it must start anew without disturbing the others.
        for k in 600..recordings[9].xyz[2].len().min(660) {
            recordings[9].xyz[2][k][1] += 3.0;
        }
        recordings[4].xyz[1][777] = [f64::NAN; 3];
        // Lost packets: rows that repeat the one before, one to seven at a time.
        for k in 0..12 {
            for lane in [1, 7, 11] {
                repeat_rows(&mut recordings[lane], 300 + 37 * k + 11 * lane, 1 + k % 7, k % 2);
            }
        }
        let mut all: Vec<(Settings, Signals<'_>)> =
            joints.iter().map(BallJoint::settings).zip(recordings.iter().map(Recording::signals)).collect();
        all[2].1 = recordings[2].timed();
        let mut together = Estimates::of_size(all.iter().map(|(_, signals)| signals.len()).sum());
        let Some(done) = run_batch::<f64, M>(method, &all, together.page(), &mut || true) else { panic!() };
        assert_eq!(done.len(), all.len());
        for ((settings, signals), done) in all.iter().zip(done) {
            let (alone, filter) = run_over::<f64, M>(settings, method, signals);
            assert!(together.of(&done).eq(alone) && done.restarts == filter.restarts());
        }
    }
    check(Mekf::default());
    check(Complementary::default());
    assert!(
        run_batch::<f64, _>(
            Mekf::default(),
            &[(Settings::default(), Signals { xyz: [&[]; 4], time_s: None })],
            Page::default(),
            &mut || false
        )
        .is_none()
    );
}

#[test]
fn a_whole_recording_ends_in_the_bits_of_one_that_came_sample_by_sample() {
    fn check<T: Real, M: Method + core::fmt::Debug>(method: M, midpoint: bool) {
        for (seed, rate_hz) in [(19, 20.0), (20, 50.0), (21, 100.0), (22, 1000.0)] {
            let joint = BallJoint::new(seed, rate_hz);
            let mut recording = joint.record(15.0);
            for k in 0..6 {
                repeat_rows(&mut recording, 500 + 37 * k, 1 + k, k % 2);
            }
            // Times that are even, but for one.
            recording.time_s.iter_mut().skip(700).for_each(|t| *t += 0.3 / rate_hz);
            let settings = Settings { midpoint, ..joint.settings() };
            for signals in [recording.signals(), recording.timed()] {
                let mut filter = Filter::<T, M>::new(settings, method);
                for k in 0..signals.len() {
                    filter.push(signals.time(k, rate_hz), &signals.sample(k));
                }
                assert_eq!(run_over::<T, M>(&settings, method, &signals).1, filter);
            }
        }
    }
    check::<f64, _>(Mekf::default(), true);
    check::<f64, _>(Mekf { outliers: Outliers::Reject, limit: 7.81, adapt: false }, false);
    check::<f64, _>(Complementary::default(), true);
    check::<f64, _>(Complementary { bias_gain: 0.01, beta_extra: 1.0, ..Complementary::default() }, true);
    check::<f64, _>(Complementary { literal: true, soft_angle: 0.0, heading_gain: 1.0, ..Complementary::default() }, false);
    check::<f32, _>(Mekf::default(), true);
    check::<f32, _>(Complementary::default(), true);
}

/// Rows of sensor 0 or 1 after `at` become copies of it.
fn repeat_rows(recording: &mut Recording, at: usize, count: usize, sensor: usize) {
    for signal in 2 * sensor..2 * sensor + 2 {
        let rows = &mut recording.xyz[signal];
        let copy = rows[at.min(rows.len() - 1)];
        let end = (at + 1 + count).min(rows.len());
        rows[(at + 1).min(end)..end].fill(copy);
    }
}

#[test]
fn lost_packets_that_stand_as_copies_do_little_harm() {
    let joint = BallJoint::new(3, 100.0);
    let whole = joint.record(30.0);
    let mut lossy = joint.record(30.0);
    for k in 0..50 {
        repeat_rows(&mut lossy, 400 + 50 * k, 1 + k % 6, k % 2);
    }
    let error = |r: &Recording| r.rms_deg(&run_over::<f64, _>(&joint.settings(), Mekf::default(), &r.signals()).0);
    assert!(error(&lossy) < 2.5 * error(&whole), "{} against {}", error(&lossy), error(&whole));
}

#[test]
fn turning_a_sensor_in_its_mounting_turns_the_result() {
    fn check<M: Method>(method: M) {
        let joint = BallJoint::new(5, 100.0);
        let recording = joint.record(15.0);
        let mut random = Random(6);
        let mounts: [Rotation3<f64>; 2] = [random.mounting(), random.mounting()];
        let turned = Recording {
            xyz: [0, 1, 2, 3].map(|k| recording.xyz[k].iter().map(|v| (mounts[k / 2] * Vector3::from(*v)).into()).collect()),
            ..recording.clone()
        };
        let Joint { r1, r2, .. } = joint.joint;
        let turned_joint =
            Joint { r1: (mounts[0] * Vector3::from(r1)).into(), r2: (mounts[1] * Vector3::from(r2)).into(), ..joint.joint };
        let plain = recording.estimates(&joint.settings(), method);
        let other = turned.estimates(&Settings { joint: turned_joint, ..joint.settings() }, method);
        let [m1, m2] = mounts.map(|m| UnitQuaternion::from_rotation_matrix(&m));
        for (a, b) in plain.iter().zip(&other) {
            let expected = m1 * unit(a.q) * m2.inverse();
            assert!(expected.angle_to(&unit(b.q)) < 1e-7, "{}", expected.angle_to(&unit(b.q)));
            assert!((a.std / b.std - 1.0).abs() < 1e-6);
        }
    }
    check(Mekf::default());
    check(Complementary::default());
}

#[test]
fn swapping_the_sensors_gives_the_inverse() {
    let joint = BallJoint::new(7, 100.0);
    let recording = joint.record(15.0);
    let [a, b, c, d] = recording.xyz.clone();
    let swapped = Recording { xyz: [c, d, a, b], ..recording.clone() };
    let Joint { r1, r2, .. } = joint.joint;
    let settings = Settings { joint: Joint { r1: r2, r2: r1, ..joint.joint }, ..joint.settings() };
    let plain = recording.estimates(&joint.settings(), Mekf::default());
    let other = swapped.estimates(&settings, Mekf::default());
    let worst = plain.iter().zip(&other).map(|(a, b)| unit(a.q).angle_to(&unit(b.q).inverse())).fold(0.0, f64::max);
    // The gain is worked out from the accelerations of one sensor, whose noise differs.
    assert!(worst < 0.05, "{worst}");
}

#[test]
fn the_latest_estimate_bridges_the_delay() {
    let joint = BallJoint::new(8, 100.0);
    let recording = joint.record(20.0);
    let mut filter = Filter::<f64, _>::new(joint.settings(), Mekf::default());
    let mut now: Vec<Estimate> = Vec::new();
    for k in 0..recording.time_s.len() {
        recording.push_all(&mut filter, k..k + 1);
        now.push(filter.latest());
    }
    let errors = recording.errors(&now);
    let started = now.iter().position(|e| e.status == Status::Tracking).unwrap_or(0);
    assert!(started > 0 && started < 1000, "{started}");
    let rms = (errors[started..].iter().map(Vector3::norm_squared).sum::<f64>() / (errors.len() - started) as f64).sqrt();
    assert!(rms.to_degrees() < 1.0, "{}", rms.to_degrees());
    // Later estimates of the same samples, which have seen their accelerations, differ by little.
    let aligned = recording.estimates(&joint.settings(), Mekf::default());
    assert!(now[started..].iter().zip(&aligned[started..]).all(|(a, b)| unit(a.q).angle_to(&unit(b.q)) < 3.0 * a.std));
}

#[test]
fn single_precision_is_as_good() {
    for rate_hz in [50.0, 1000.0] {
        let joint = BallJoint::new(9, rate_hz);
        let recording = joint.record(20.0);
        let signals = recording.signals();
        let double = recording.estimates(&joint.settings(), Mekf::default());
        let (single, _) = run_over::<f32, _>(&joint.settings(), Mekf::default(), &signals);
        let worst = double.iter().zip(&single).map(|(a, b)| unit(a.q).angle_to(&unit(b.q))).fold(0.0, f64::max);
        assert!(worst.to_degrees() < 0.02, "{}", worst.to_degrees());
        let double = recording.estimates(&joint.settings(), Complementary::default());
        let (single, _) = run_over::<f32, _>(&joint.settings(), Complementary::default(), &signals);
        let worst = double.iter().zip(&single).map(|(a, b)| unit(a.q).angle_to(&unit(b.q))).fold(0.0, f64::max);
        assert!(worst.to_degrees() < 0.02, "{}", worst.to_degrees());
    }
}

#[test]
fn what_is_not_finite_or_not_later_is_passed_over() {
    let joint = BallJoint::new(9, 100.0);
    let recording = joint.record(8.0);
    let mut clean = Filter::<f64, _>::new(joint.settings(), Mekf::default());
    let mut soiled = clean.clone();
    for k in 0..800 {
        let (t, sample) = (recording.time_s[k], recording.signals().sample(k));
        clean.push(t, &sample);
        soiled.push(t, &sample);
        soiled.push(t, &sample);
        soiled.push(t - 1.0, &sample);
        soiled.push(f64::NAN, &sample);
        soiled.push(t + 0.005, &[f64::INFINITY; 12]);
    }
    assert_eq!(clean, soiled);
}
