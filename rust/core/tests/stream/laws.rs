//! Saving, gaps and irregular time.

use imufast_core::{PairSample, hinge::stream::HingeStream};

use crate::data::{Linkage, Random, fed, raw_settings, settings};

/// Half a minute with lost samples, breaks and times that jitter.
fn rough() -> Vec<(f64, PairSample)> {
    let (mut linkage, mut random) = (Linkage::new(1), Random(2));
    let mut t = 100.0;
    (0..1500)
        .map(|k| {
            t += 0.02 * (0.7 + 0.6 * random.uniform());
            if k % 41 == 0 {
                t += 0.02;
            }
            if k % 311 == 310 {
                t += 0.5;
            }
            (t, linkage.sample(t))
        })
        .collect()
}

/// Bits of what an estimate says.
fn spoken(stream: &mut HingeStream) -> Vec<u64> {
    let Some(record) = stream.estimate(None) else { return Vec::new() };
    let mut numbers = vec![record.time_s, record.pairing, record.witness.moving_s, record.witness.relative_rate];
    numbers.extend(record.minima.iter().flat_map(|m| [m.axes.j1, m.axes.j2]).flat_map(|j| [j.x, j.y, j.z]));
    numbers.extend(record.minima.iter().map(|m| m.cost));
    numbers.extend(record.evidence.covariance.iter());
    numbers.extend(record.witness.misfit);
    numbers.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn a_stream_saved_and_read_back_anywhere_goes_on_as_the_same() {
    let samples = rough();
    for settings in [settings(), raw_settings()] {
        let mut plain = HingeStream::new(settings);
        let mut saved = HingeStream::new(settings);
        let mut random = Random(3);
        for (k, (t, sample)) in samples.iter().enumerate() {
            plain.push(*t, sample);
            saved.push(*t, sample);
            if random.below(40) == 0 {
                saved = HingeStream::from_bytes(&saved.to_bytes()).expect("its own bytes");
            }
            if k % 250 == 249 {
                assert!(plain.to_bytes() == saved.to_bytes(), "{k}");
                assert_eq!(spoken(&mut plain), spoken(&mut saved), "{k}");
            }
        }
        assert!(!spoken(&mut plain).is_empty() && !spoken(&mut saved).is_empty());
        assert!(plain.to_bytes() == saved.to_bytes());
    }
}

#[test]
fn no_sample_is_chosen_whose_window_reaches_across_a_break() {
    let mut linkage = Linkage::new(4);
    let mut samples = linkage.samples(0.0, 300);
    samples.extend(linkage.samples(20.0, 300));
    let mut stream = fed(raw_settings(), &samples);
    let (gyr, acc) = stream.chosen();
    let times: Vec<f64> = gyr.iter().chain(acc).map(|c| c.time).collect();
    assert!(times.len() > 200);
    // Ten samples on either side of each stretch have no whole window.
    let inside = |t: f64| (0.2 - 1e-9..5.78 + 1e-9).contains(&t) || (20.2 - 1e-9..25.78 + 1e-9).contains(&t);
    assert!(times.iter().all(|t| inside(*t)), "{times:?}");
}

#[test]
fn the_delay_is_that_of_the_low_pass_and_time_is_the_samples_own() {
    let samples = Linkage::new(5).samples(7.0, 400);
    let (latest, raw) = (fed(settings(), &samples).latest_s(), fed(raw_settings(), &samples).latest_s());
    assert_eq!(raw, samples[399].0);
    assert!(latest < raw && raw - latest < 0.32, "{latest} {raw}");
}

#[test]
fn an_empty_or_short_stream_says_nothing() {
    assert!(HingeStream::new(settings()).estimate(None).is_none());
    let samples = Linkage::new(6).samples(0.0, 30);
    let mut stream = fed(settings(), &samples);
    assert!(stream.estimate(None).is_none());
    assert!(stream.selected() < 20);
}

#[test]
fn starting_over_forgets_the_joint_and_keeps_the_biases() {
    let mut linkage = Linkage::new(7);
    let mut stream = HingeStream::new(settings());
    let still = linkage.sample(0.0);
    for k in 0..200 {
        let mut sample = still;
        // At rest, with a bias of 0.01 rad/s on each channel.
        for c in [0, 1, 2, 6, 7, 8] {
            sample[c] = 0.01;
        }
        stream.push(k as f64 * 0.02, &sample);
    }
    linkage.samples(4.0, 500).iter().for_each(|(t, s)| stream.push(*t, s));
    let biases = stream.gyr_bias();
    for bias in biases {
        assert!(bias.is_some_and(|b| b.iter().all(|x| (x - 0.01).abs() < 1e-9)), "{bias:?}");
    }
    stream.restart();
    assert_eq!((stream.selected(), stream.moving_seen()), (0, 0));
    assert!(stream.estimate(None).is_none());
    assert_eq!(stream.gyr_bias(), biases);
}
