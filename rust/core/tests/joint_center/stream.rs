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
                stream.push(*t, sample);
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
            stream.push(*t, sample);
            assert!(stream.moments().len() <= settings.max_samples);
            if k % 100 == 0 {
                assert!(stream.moments().time_s().is_sorted_by(|a, b| a < b));
                assert!(stream.moments().time_s().iter().all(|moment| moment <= t));
            }
        }
        assert!(stream.moments().time_s().is_sorted_by(|a, b| a < b));
        assert!(stream.moments().len() as u64 <= stream.count());
        let enough = (stream.count() as usize).min(settings.max_samples) / 2;
        assert!(settings.least_rate > 0.0 || stream.moments().len() >= enough, "{settings:?}: {}", stream.moments().len());
    }
}

#[test]
fn a_moment_is_as_late_as_stated() {
    for settings in choices() {
        let stream = fed(settings, &BallJoint::new(1, 1.0, 0.0).samples(0.0, 600));
        assert!((5.99 - stream.latest_s() - stream.delay_s()).abs() < 0.25, "{settings:?}");
        let first = stream.moments().time_s()[0];
        assert!((first - stream.delay_s()).abs() < 1e-9, "{settings:?}: first at {first}, {} late", stream.delay_s());
    }
}

#[test]
fn no_derivative_reaches_across_a_break() {
    // Constant rates that differ from stretch to stretch: any derivative that saw two stretches would not be zero.
    let stretches = [(0.0, 1.0), (3.0, -4.0), (4.13, 2.5), (7.0, -1.0)];
    for settings in choices() {
        let mut stream = CenterStream::new(settings);
        for (number, (start, level)) in stretches.into_iter().enumerate() {
            let end = stretches.get(number + 1).map_or(10.0, |next| next.0 - 0.06);
            let mut k = 0.0;
            while start + 0.01 * k < end {
                let mut sample = [0.0; 12];
                for c in 0..3 {
                    sample[c] = level * (1.0 + c as f64);
                    sample[6 + c] = -level * (2.0 + c as f64);
                    (sample[3 + c], sample[9 + c]) = (5.0 + level, 5.0 + level);
                }
                stream.push(start + 0.01 * k, &sample);
                k += 1.0;
            }
        }
        let moments = stream.moments();
        assert!(!moments.is_empty());
        let mut seen = [false; 4];
        for (k, t) in moments.time_s().iter().enumerate() {
            let stretch = stretches.iter().rposition(|(start, _)| t >= start).expect("time begins with the first");
            seen[stretch] = true;
            let [[gyr1, dot1, acc1], [_, dot2, _]] = moments.at(k);
            assert!(dot1.norm() < 1e-9 && dot2.norm() < 1e-9, "{settings:?}: {dot1} at {t}");
            assert!((acc1[0] - 5.0 - stretches[stretch].1).abs() < 1e-9);
            let rate = stretches[stretch].1 - stream.gyr_bias()[0].map_or(0.0, |bias| bias[0]);
            assert!((gyr1[0] - rate).abs() < 1e-9, "{gyr1} at {t}");
        }
        assert!(settings.max_samples < 100 || seen == [true; 4], "{settings:?}: {seen:?}");
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
            let [[gyr1, ..], [gyr2, ..]] = stream.moments().at(k);
            gyr1.norm().max(gyr2.norm()) >= least_rate
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
            stream.push(0.01 * f64::from(k), &sample);
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
    // Five hours of gentle motion with ten seconds of vigour in each half hour.
    let settings = StreamSettings { max_samples: 400, ..settings() };
    let (gentle, strong) = (BallJoint::new(8, 0.15, 0.02).samples(0.0, 6000), BallJoint::new(9, 2.0, 0.02).samples(0.0, 1000));
    let mut stream = CenterStream::new(settings);
    let mut largest = [0; 2];
    let mut vigour = Vec::new();
    for minute in 0..300 {
        let start = 70.0 * f64::from(minute);
        gentle.iter().for_each(|(t, s)| stream.push(start + t, s));
        if minute % 30 == 7 {
            strong.iter().for_each(|(t, s)| stream.push(start + 60.0 + t, s));
            vigour.push(start + 60.0);
        }
        let half = &mut largest[usize::from(minute >= 150)];
        *half = (*half).max(stream.to_bytes().len());
    }
    assert!(largest[1] as f64 <= 1.02 * largest[0] as f64, "{largest:?}");
    assert!(largest[1] < 400 * 8 * 20 + 20_000, "{largest:?}");
    let strong_ones = |t: &f64| vigour.iter().any(|start| (*start..start + 10.0).contains(t));
    let times = stream.moments().time_s();
    let share = times.iter().filter(|t| strong_ones(t)).count() as f64 / times.len() as f64;
    assert!(share > 0.9, "{share}");
    let remembered = vigour.iter().filter(|start| times.iter().any(|t| (**start..**start + 10.0).contains(t))).count();
    assert_eq!(remembered, vigour.len());
}
