//! Every way in which a descent can end.

use imufast_core::orientation::smoother::{Options, Status};

use crate::data::{Recipe, Recording, rotation};

fn sound(recording: &Recording, status: Status) {
    let smoothed = recording.smooth(&Options::default());
    assert_eq!(smoothed.status, status);
    assert_eq!((smoothed.q_12.len(), smoothed.covariance.len()), (recording.time_s.len(), recording.time_s.len()));
    assert!(smoothed.q_12.iter().all(|q| (rotation(q).norm() - 1.0).abs() < 1e-9 && q.iter().all(|v| v.is_finite())));
}

#[test]
fn a_few_samples_say_nothing_and_do_no_harm() {
    let recording = Recipe::usual(1).make();
    for count in 0..9 {
        sound(&recording.thinned(|k| k < count), Status::NotObservable);
    }
}

#[test]
fn rest_shows_inclination_alone() {
    let recording = Recipe { swing: 0.0, sway: 0.0, ..Recipe::usual(2) }.make();
    sound(&recording, Status::NotObservable);
    let smoothed = recording.smooth(&Options::default());
    let middle = smoothed.covariance.len() / 2;
    let std_deg = smoothed.covariance[middle][..3].iter().sum::<f64>().sqrt().to_degrees();
    assert!(std_deg > 90.0, "{std_deg}");
}

#[test]
fn what_is_not_a_number_or_overflows_is_said() {
    let mut recording = Recipe::usual(3).make();
    recording.acc[0][77][1] = f64::NAN;
    sound(&recording, Status::NumericalError);
    let mut recording = Recipe::usual(3).make();
    recording.acc.iter_mut().flatten().for_each(|row| *row = row.map(|v| v * 1e200));
    sound(&recording, Status::NumericalError);
}

#[test]
fn the_caller_can_stop_it_and_iterations_can_run_out() {
    let recording = Recipe::usual(4).make();
    let mut asked = 0;
    let mut go_on = || {
        asked += 1;
        asked < 4
    };
    let stopped = recording.smooth_until(&Options::default(), &mut go_on);
    assert_eq!((stopped.status, stopped.iterations), (Status::Interrupted, 3));
    assert_eq!(stopped.q_12.len(), recording.time_s.len());
    let short = recording.smooth(&Options { max_iterations: 3, ..Options::default() });
    assert_eq!((short.status, short.iterations), (Status::MaxIterations, 3));
}

#[test]
fn every_option_changes_something() {
    let recording = Recipe::usual(5).make().thinned(|k| !(700..735).contains(&k));
    let usual = Options::default();
    let answer = recording.smooth(&usual);
    let others = [
        Options { window_s: 0.3, ..usual },
        Options { key_step_s: 0.2, ..usual },
        Options { bridge_s: 0.5, ..usual },
        Options { tail: 30.0, ..usual },
        Options { drift_std: Some(3e-3), ..usual },
        Options { link_std: Some(0.1), ..usual },
        Options { max_iterations: 5, ..usual },
    ];
    for (k, other) in others.iter().enumerate() {
        let changed = recording.smooth(other);
        let moved = answer.q_12.iter().zip(&changed.q_12).map(|(a, b)| rotation(a).angle_to(&rotation(b))).fold(0.0, f64::max);
        assert!(moved > 1e-6, "{k}: {moved}");
    }
    let rest = Recipe { swing: 0.0, sway: 0.0, ..Recipe::usual(5) }.make();
    let (with, without) = (rest.smooth(&usual), rest.smooth(&Options { rest_bias_std: None, ..usual }));
    assert!((with.constants - without.constants).fixed_rows::<6>(12).norm() > 1e-6);
}
