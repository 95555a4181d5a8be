//! Accuracy and honesty against a known truth.

use imufast_core::orientation::{Complementary, Mekf, Outliers, Settings, method::Method};
use nalgebra::Vector3;

use crate::data::{BallJoint, Random, Recording};

/// Mean over simulations of the root mean square error, degrees, and of the squared error in claimed variances.
fn score<M: Method>(
    method: M,
    count: u64,
    rate_hz: f64,
    change: impl Fn(&mut BallJoint, &mut Recording, &mut Settings),
) -> (f64, f64) {
    let (mut error, mut nees) = (0.0, 0.0);
    for seed in 0..count {
        let mut joint = BallJoint::new(1000 + seed, rate_hz);
        let mut recording = joint.record(30.0);
        let mut settings = joint.settings();
        change(&mut joint, &mut recording, &mut settings);
        let estimates = recording.estimates(&settings, method);
        let errors = recording.errors(&estimates);
        error += recording.rms_deg(&estimates);
        nees +=
            errors.iter().zip(&estimates).map(|(d, e)| d.norm_squared() / (e.std * e.std)).sum::<f64>() / errors.len() as f64;
    }
    (error / count as f64, nees / count as f64)
}

#[test]
fn the_claimed_covariance_is_honest() {
    let (error, nees) = score(Mekf::default(), 100, 50.0, |_, _, _| {});
    assert!(error < 0.5, "{error}");
    assert!((0.5..1.5).contains(&nees), "{nees}");
}

#[test]
fn it_stays_honest_when_the_gyroscopes_have_wrong_scales() {
    let (error, nees) = score(Mekf::default(), 30, 50.0, |_, recording, _| {
        let mut random = Random(77);
        for k in [0, 2] {
            let wrong = Vector3::from_fn(|_, _| 1.0 + 0.005 * random.normal());
            for gyr in &mut recording.xyz[k] {
                *gyr = Vector3::from(*gyr).component_mul(&wrong).into();
            }
        }
    });
    assert!(error < 1.0, "{error}");
    assert!((0.3..2.0).contains(&nees), "{nees}");
}

fn impacts(recording: &mut Recording) {
    let mut random = Random(78);
    for k in 0..recording.time_s.len() {
        if random.uniform() < 0.05 {
            let hit = random.vector(10.0);
            recording.xyz[1][k] = (Vector3::from(recording.xyz[1][k]) + hit).into();
        }
    }
}

#[test]
fn impacts_are_survived() {
    let with = |outliers| score(Mekf { outliers, ..Mekf::default() }, 10, 50.0, |_, r, _| impacts(r)).0;
    let [keep, downweight] = [Outliers::Keep, Outliers::Downweight].map(with);
    assert!(downweight < 0.7 && downweight < 0.7 * keep, "{downweight} against {keep}");
    let complementary = score(Complementary::default(), 10, 50.0, |_, r, _| impacts(r)).0;
    assert!(complementary < 1.0, "{complementary}");
}

#[test]
fn the_complementary_filter_is_nearly_as_good_and_its_heading_gain_is_why() {
    let (ours, nees) = score(Complementary::default(), 20, 50.0, |_, _, _| {});
    let (plain, _) = score(Complementary { heading_gain: 1.0, ..Complementary::default() }, 20, 50.0, |_, _, _| {});
    assert!(ours < 0.6 && ours < plain, "{ours} against {plain}");
    assert!((0.1..3.0).contains(&nees), "{nees}");
}

#[test]
fn feedback_finds_the_bias_of_the_gyroscopes() {
    let bias = |_: &mut BallJoint, recording: &mut Recording, _: &mut Settings| {
        for gyr in &mut recording.xyz[2] {
            gyr[1] += 0.02;
        }
    };
    let (without, _) = score(Complementary::default(), 5, 100.0, bias);
    let (with, _) = score(Complementary { bias_gain: 0.05, ..Complementary::default() }, 5, 100.0, bias);
    assert!(with < without, "{with} against {without}");
}

#[test]
fn the_midpoint_step_matters() {
    let (ours, _) = score(Mekf::default(), 10, 50.0, |_, _, _| {});
    let (end, _) = score(Mekf::default(), 10, 50.0, |_, _, s| s.midpoint = false);
    assert!(ours < 0.8 * end, "{ours} against {end}");
}

#[test]
fn high_rates_work_too() {
    let (error, nees) = score(Mekf::default(), 3, 1000.0, |_, _, _| {});
    assert!(error < 0.4, "{error}");
    assert!((0.05..2.0).contains(&nees), "{nees}");
}
