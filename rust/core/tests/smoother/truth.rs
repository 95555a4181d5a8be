//! Recordings whose truth is known.

use imufast_core::orientation::smoother::{Options, Status};
use nalgebra::{UnitQuaternion, Vector3};

use crate::data::{Random, Recipe, Recording, rotation, spread};

#[test]
fn a_ball_joint_is_followed_from_nothing_and_the_stated_covariance_holds() {
    let (mut nees, mut count) = (0.0, 0.0);
    for seed in 0..12 {
        let recording = Recipe::usual(seed).make();
        let smoothed = recording.smooth(&Options::default());
        assert_eq!(smoothed.status, Status::Converged, "{seed}");
        assert!(recording.rms_deg(&smoothed) < 0.8, "{seed}: {}", recording.rms_deg(&smoothed));
        for (i, lever) in recording.levers.iter().enumerate() {
            let off = smoothed.constants.fixed_rows::<3>(3 * i) - lever;
            assert!(off.norm() < 0.004, "{seed}: {off}");
        }
        for (e, c) in recording.errors(&smoothed).iter().zip(&smoothed.covariance) {
            nees += e.dot(&spread(c).try_inverse().map_or(Vector3::repeat(f64::NAN), |p| p * e)) / 3.0;
            count += 1.0;
        }
    }
    assert!((0.6..1.6).contains(&(nees / count)), "{}", nees / count);
}

#[test]
fn without_noise_the_truth_comes_back() {
    let recording = Recipe { noise: 0.0, ..Recipe::usual(3) }.make();
    let smoothed = recording.smooth(&Options::default());
    assert!(recording.rms_deg(&smoothed) < 0.03, "{}", recording.rms_deg(&smoothed));
}

#[test]
fn turned_sensor_frames_turn_the_answer_and_nothing_else() {
    let recording = Recipe::usual(5).make();
    let mut random = Random(50);
    let mounts = [random.rotation(), random.rotation()];
    let turned =
        |rows: &Vec<[f64; 3]>, by: &UnitQuaternion<f64>| rows.iter().map(|r| (by * Vector3::from(*r)).into()).collect();
    let other = Recording {
        time_s: recording.time_s.clone(),
        gyr: [0, 1].map(|i| turned(&recording.gyr[i], &mounts[i])),
        acc: [0, 1].map(|i| turned(&recording.acc[i], &mounts[i])),
        q_12: recording.q_12.clone(),
        levers: recording.levers,
    };
    let (a, b) = (recording.smooth(&Options::default()), other.smooth(&Options::default()));
    for (a, b) in a.q_12.iter().zip(&b.q_12) {
        let expected = mounts[0] * rotation(a) * mounts[1].inverse();
        assert!(expected.angle_to(&rotation(b)) < 1e-4);
    }
    for (a, b) in a.covariance.iter().zip(&b.covariance) {
        let (a, b) = (spread(a).trace(), spread(b).trace());
        assert!((a - b).abs() < 1e-2 * a);
    }
}

#[test]
fn lost_rows_that_stand_as_copies_cost_little() {
    let mut recording = Recipe::usual(6).make();
    let clean = recording.rms_deg(&recording.smooth(&Options::default()));
    for k in (100..1400).step_by(130) {
        for n in k..k + 2 {
            recording.gyr[0][n] = recording.gyr[0][k - 1];
            recording.acc[0][n] = recording.acc[0][k - 1];
        }
    }
    let held = recording.smooth(&Options::default());
    assert!(recording.rms_deg(&held) < clean + 0.4, "{clean} {}", recording.rms_deg(&held));
}

#[test]
fn spikes_in_the_accelerometers_cost_little() {
    let mut recording = Recipe::usual(7).make();
    let clean = recording.rms_deg(&recording.smooth(&Options::default()));
    let mut random = Random(70);
    for k in (50..1450).step_by(37) {
        recording.acc[1][k] = (Vector3::from(recording.acc[1][k]) + random.vector() * 30.0).into();
    }
    let spiked = recording.smooth(&Options::default());
    assert!(recording.rms_deg(&spiked) < 2.0 * clean + 0.2, "{clean} {}", recording.rms_deg(&spiked));
}

#[test]
fn gaps_are_bridged_or_break_the_chain_and_every_sample_has_its_answer() {
    let whole = Recipe::usual(8).make();
    for gap in [10, 200] {
        let recording = whole.thinned(|k| !(600..600 + gap).contains(&k) && k % 97 != 0);
        let smoothed = recording.smooth(&Options::default());
        assert_eq!(smoothed.q_12.len(), recording.time_s.len());
        let nees: f64 = recording
            .errors(&smoothed)
            .iter()
            .zip(&smoothed.covariance)
            .map(|(e, c)| e.norm_squared() / spread(c).trace())
            .sum::<f64>()
            / recording.time_s.len() as f64;
        assert!(recording.rms_deg(&smoothed) < 1.5, "{gap}: {}", recording.rms_deg(&smoothed));
        assert!(nees < 3.0, "{gap}: {nees}");
    }
}

#[test]
fn time_that_jitters_is_honoured() {
    let whole = Recipe::usual(9).make();
    let thinned = whole.thinned(|k| k % 5 != 3);
    assert!(thinned.rms_deg(&thinned.smooth(&Options::default())) < 1.5);
}
