//! The stream: saving changes no bit, nothing reaches across a break, memory is bounded and goes to the exciting moments.

use imufast_core::{
    PairSample,
    joint_center::stream::{CenterStream, StreamSettings},
    rigid_body::Stencil,
};

use crate::data::{BallJoint, Random, fed, raw_settings, settings};

fn choices() -> [StreamSettings; 5] {
    [
        settings(),
        raw_settings(),
        StreamSettings { stencil: Stencil::Five, max_samples: 20, ..raw_settings() },
        StreamSettings { rate_hz: 100.0, lowpass_hz: 2.0, least_rate: 1.2, max_samples: 57, ..settings() },
        StreamSettings { bias_from_rest: true, max_samples: 100_000, ..raw_settings() },
    ]
}

/// Motion, rest, motion, with a few packets lost and one long silence.
fn eventful() -> Vec<(f64, PairSample)> {
    let mut samples = BallJoint::new(1, 1.0, 0.05).samples(0.0, 700);
    samples.extend(BallJoint::new(2, 0.0, 0.02).samples(7.0, 500));
    samples.extend(BallJoint::new(3, 0.7, 0.05).samples(21.5, 900));
    let mut random = Random(4);
    samples.retain(|_| random.uniform() > 0.02);
    samples
}

#[test]
fn saved_and_restored_anywhere_it_goes_on_as_if_nothing_had_happened() {
    let samples = eventful();
    for settings in choices() {
        let whole = fed(settings, &samples).to_bytes();
        let mut random = Random(5);
        for _ in 0..6 {
            let mut cuts = [random.below(samples.len()), random.below(samples.len())];
            cuts.sort_unstable();
            let mut stream = CenterStream::new(settings);
            for (k, (t, sample)) in samples.iter().enumerate() {
                if cuts.contains(&k) {
                    let bytes = stream.to_bytes();
                    stream = CenterStream::from_bytes(&bytes).expect("what was written is read");
                    assert_eq!(stream.to_bytes(), bytes);
                }
                stream.push([(*t, *sample)]);
            }
            assert_eq!(stream.to_bytes(), whole);
        }
    }
}

#[test]
fn moments_are_bounded_in_number_and_ordered_in_time() {
    let samples = eventful();
    for settings in choices() {
        let mut stream = CenterStream::new(settings);
        for (k, (t, sample)) in samples.iter().enumerate() {
            stream.push([(*t, *sample)]);
            assert!(stream.moments().len() <= settings.max_samples);
            if k % 100 == 0 {
                assert!(stream.moments().time_s().is_sorted_by(|a, b| a < b));
                assert!(stream.moments().time_s().iter().all(|moment| moment <= t));
            }
        }
        assert!(stream.moments().time_s().is_sorted_by(|a, b| a < b));
        assert!(stream.moments().len() >= settings.max_samples.min(60) / 2, "{settings:?}: {}", stream.moments().len());
    }
}

#[test]
fn a_moment_is_as_late_as_stated() {
    for settings in choices() {
        let stream = fed(settings, &BallJoint::new(1, 1.0, 0.0).samples(0.0, 600));
        let first = stream.moments().time_s()[0];
        // The orientation of a smoothed one needs a sample more, but the window none before the first.
        let early = if settings.lowpass_hz > 0.0 { 0.01 } else { 0.0 };
        assert!((first + early - stream.delay_s()).abs() < 1e-9, "{settings:?}: first at {first}, {} late", stream.delay_s());
    }
}

#[test]
fn nothing_reaches_across_a_break() {
    // Three motions that have nothing to do with each other: what each tells must be what it tells alone.
    let stretches: Vec<_> = [(1, 0.0, 300), (2, 3.05, 250), (3, 7.0, 333)]
        .map(|(seed, start, n)| BallJoint::new(seed, 1.0, 3.0).samples(start, n))
        .into();
    let whole: Vec<_> = stretches.concat();
    for settings in choices() {
        let settings = StreamSettings { max_samples: 100_000, bias_from_rest: false, ..settings };
        let together = fed(settings, &whole);
        let mut k = 0;
        for stretch in &stretches {
            let alone = fed(settings, stretch);
            for j in 0..alone.moments().len() {
                assert!((together.moments().time_s()[k] - alone.moments().time_s()[j]).abs() < 1e-9);
                for (one, other) in together.moments().at(k).iter().zip(alone.moments().at(j)) {
                    let near = (one.a - other.a).norm() + (one.b - other.b).norm() + (one.c - other.c).norm() < 1e-9;
                    assert!(near && one.gyr == other.gyr, "{settings:?}: moment {k}");
                }
                k += 1;
            }
        }
        assert!(k > 10 && k == together.moments().len(), "{settings:?}: {k}");
    }
}

#[test]
fn known_gyroscope_biases_are_taken_off_all_the_same() {
    let bias = [[0.03, -0.02, 0.01], [-0.02, 0.0, 0.04]];
    let samples = BallJoint::new(5, 1.0, 0.05).samples(0.0, 600);
    let biased: Vec<_> = samples
        .iter()
        .map(|(t, sample)| {
            let mut s = *sample;
            (0..3).for_each(|k| (s[k], s[6 + k]) = (s[k] + bias[0][k], s[6 + k] + bias[1][k]));
            (*t, s)
        })
        .collect();
    for settings in choices() {
        let settings = StreamSettings { bias_from_rest: false, ..settings };
        let (plain, known) = (fed(settings, &samples), fed(StreamSettings { gyr_bias: Some(bias), ..settings }, &biased));
        assert_eq!(known.gyr_bias(), bias.map(Some));
        assert_eq!(plain.moments().len(), known.moments().len());
        for k in 0..plain.moments().len() {
            for (one, other) in plain.moments().at(k).iter().zip(known.moments().at(k)) {
                assert!((one.a - other.a).norm() + (one.c - other.c).norm() + (one.gyr - other.gyr).norm() < 1e-9);
            }
        }
    }
}

#[test]
fn one_lost_sample_is_bridged_and_two_are_a_break() {
    let samples = BallJoint::new(6, 1.0, 0.0).samples(0.0, 400);
    for (lost, missing) in [(1, 0), (2, 2 * Stencil::Three.reach() + 2), (10, 2 * Stencil::Three.reach() + 10)] {
        let kept: Vec<_> = samples[..200].iter().chain(&samples[200 + lost..]).copied().collect();
        let settings = StreamSettings { max_samples: 1000, ..raw_settings() };
        let (all, some) = (fed(settings, &samples).moments().len(), fed(settings, &kept).moments().len());
        assert_eq!(all - some, missing, "{lost} lost");
    }
}

#[test]
fn quiet_moments_below_the_gate_are_passed_over() {
    let samples = BallJoint::new(7, 0.6, 0.0).samples(0.0, 1500);
    for least_rate in [0.5, 1.2, 3.0] {
        let settings = StreamSettings { least_rate, max_samples: 10_000, ..raw_settings() };
        let (stream, all) = (fed(settings, &samples), fed(StreamSettings { least_rate: 0.0, ..settings }, &samples));
        let moves = |k: usize, stream: &CenterStream| {
            let [one, two] = stream.moments().at(k);
            one.gyr.norm().max(two.gyr.norm()) >= least_rate
        };
        assert!((0..stream.moments().len()).all(|k| moves(k, &stream)));
        assert_eq!(stream.moments().len(), (0..all.moments().len()).filter(|&k| moves(k, &all)).count());
    }
}

#[test]
fn of_equal_moments_those_that_stay_are_spread_over_all_time() {
    for max_samples in [20, 21, 64, 200] {
        let settings = StreamSettings { max_samples, ..raw_settings() };
        let mut stream = CenterStream::new(settings);
        for k in 0..20_000 {
            let angle = 0.1 * f64::from(k);
            // Steady coning: always equally exciting.
            let sample = [angle.cos(), angle.sin(), 0.0, 9.0, 1.0, 2.0, 0.0, angle.cos(), angle.sin(), 3.0, 9.0, 1.0];
            stream.push([(0.01 * f64::from(k), sample)]);
        }
        let times = stream.moments().time_s();
        assert!(times.len() >= max_samples / 4 && times.len() <= max_samples);
        assert!(times[0] < 1.0 && times[times.len() - 1] > 199.0 - 400.0 / max_samples as f64);
        let steps: Vec<_> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let (least, most) = steps.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), s| (a.min(*s), b.max(*s)));
        assert!(most < 1.001 * least, "{max_samples}: {least} to {most}");
    }
}

#[test]
fn memory_is_bounded_over_hours_and_goes_to_the_rare_exciting_moments() {
    // An hour of gentle motion in pieces, with ten seconds of vigour now and then.
    let settings = StreamSettings { max_samples: 400, bias_from_rest: false, ..settings() };
    let (gentle, strong) = (BallJoint::new(8, 0.15, 0.02).samples(0.0, 1000), BallJoint::new(9, 2.0, 0.02).samples(0.0, 1000));
    let mut stream = CenterStream::new(settings);
    let mut largest = [0; 2];
    let mut vigour = Vec::new();
    for minute in 0..120 {
        let start = 30.0 * f64::from(minute);
        stream.push(gentle.iter().map(|(t, s)| (start + t, *s)));
        if minute % 30 == 7 {
            stream.push(strong.iter().map(|(t, s)| (start + 15.0 + t, *s)));
            vigour.push(start + 15.0);
        }
        let half = &mut largest[usize::from(minute >= 60)];
        *half = (*half).max(stream.to_bytes().len());
    }
    assert!(largest[1] as f64 <= 1.02 * largest[0] as f64, "{largest:?}");
    assert!(largest[1] < 400 * 8 * 50 + 40_000, "{largest:?}");
    let strong_ones = |t: &f64| vigour.iter().any(|start| (*start..start + 10.0).contains(t));
    let times = stream.moments().time_s();
    let share = times.iter().filter(|t| strong_ones(t)).count() as f64 / times.len() as f64;
    // Every level keeps a sixteenth at most, so that none falls silent.
    assert!(share > 0.8, "{share}");
    let remembered = vigour.iter().filter(|start| times.iter().any(|t| (**start..**start + 10.0).contains(t))).count();
    assert_eq!(remembered, vigour.len());
}
