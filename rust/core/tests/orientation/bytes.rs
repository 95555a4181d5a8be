//! What is not exactly what `to_bytes` wrote is refused, and a forged checksum makes nothing panic.

use imufast_core::orientation::{Complementary, Filter, Mekf};

use crate::data::{BallJoint, Random};

const HEAD: usize = 13; // version, kind, checksum

fn saved(count: usize) -> Vec<u8> {
    let joint = BallJoint::new(41, 100.0);
    let mut filter = Filter::<f64, _>::new(joint.settings(), Mekf::default());
    joint.record(8.0).push_all(&mut filter, 0..count);
    filter.to_bytes()
}

type Kalman = Filter<f64, Mekf>;

#[test]
fn damage_is_noticed() {
    let (bytes, mut random) = (saved(700), Random(42));
    assert!(Kalman::from_bytes(&bytes).is_some());
    for length in (0..40).chain((40..bytes.len()).step_by(97)) {
        assert!(Kalman::from_bytes(&bytes[..length]).is_none(), "{length}");
    }
    assert!(Kalman::from_bytes(&[&bytes[..], &[0]].concat()).is_none());
    for _ in 0..200 {
        let mut damaged = bytes.clone();
        damaged[random.whole() as usize % bytes.len()] ^= 1 << (random.whole() % 8);
        assert!(Kalman::from_bytes(&damaged).is_none());
    }
}

#[test]
fn another_filter_does_not_take_it() {
    let bytes = saved(100);
    assert!(Filter::<f32, Mekf>::from_bytes(&bytes).is_none());
    assert!(Filter::<f64, Complementary>::from_bytes(&bytes).is_none());
}

fn checksum(body: &[u8]) -> u32 {
    imufast_core::checksum(body)
}

#[test]
fn with_a_forged_checksum_it_is_refused_or_goes_on_and_never_panics() {
    let recording = BallJoint::new(43, 100.0).record(8.0);
    let mut random = Random(44);
    let mut went_on = 0;
    for trial in 0..400 {
        let bytes = saved([0, 3, 60, 700][trial % 4]);
        let mut body = bytes[HEAD..].to_vec();
        for _ in 0..=random.whole() % 4 {
            let at = if trial % 2 == 0 { random.whole() as usize % 400 } else { random.whole() as usize % body.len() };
            let at = if trial % 3 == 0 { body.len() - 1 - at.min(body.len() - 1) } else { at.min(body.len() - 1) };
            body[at] = [0, 1, 127, 128, 255, random.whole() as u8][random.whole() as usize % 6];
        }
        let forged = [&bytes[..9], &checksum(&body).to_le_bytes(), &body].concat();
        if let Some(mut filter) = Kalman::from_bytes(&forged) {
            for k in 0..300 {
                filter.push(100.0 + 0.01 * k as f64, &recording.signals().sample(k));
                let _ = filter.latest();
            }
            went_on += 1;
        }
    }
    assert!(went_on > 20, "{went_on}");
}
