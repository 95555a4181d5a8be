//! What is not exactly what `to_bytes` wrote is refused, and a forged checksum makes nothing panic.

use imufast_core::joint_center::{
    estimate::{Request, estimate},
    solve::{Knowledge, Method},
    stream::CenterStream,
};

use crate::data::{BallJoint, Random, fed, raw_settings, settings};

const HEAD: usize = 12; // version and checksum

fn saved() -> Vec<u8> {
    fed(settings(), &BallJoint::new(1, 1.0, 0.05).samples(0.0, 900)).to_bytes()
}

#[test]
fn truncated_bytes_are_none() {
    let bytes = saved();
    for length in (0..64).chain((64..bytes.len()).step_by(97)).chain(bytes.len() - 8..bytes.len()) {
        assert!(CenterStream::from_bytes(&bytes[..length]).is_none(), "{length}");
    }
}

#[test]
fn bytes_with_more_behind_are_none() {
    let mut bytes = saved();
    bytes.push(0);
    assert!(CenterStream::from_bytes(&bytes).is_none());
}

#[test]
fn the_bytes_of_another_kind_of_stream_or_version_are_none() {
    let mut bytes = saved();
    bytes[7] += 1;
    assert!(CenterStream::from_bytes(&bytes).is_none());
    let body = saved()[HEAD..].to_vec();
    let hinge = [b"imuhng\0\x01".as_slice(), &checksum(&body).to_le_bytes(), &body].concat();
    assert!(CenterStream::from_bytes(&hinge).is_none());
}

#[test]
fn every_flipped_bit_is_noticed() {
    let (bytes, mut random) = (saved(), Random(2));
    for _ in 0..300 {
        let mut damaged = bytes.clone();
        damaged[random.below(bytes.len())] ^= 1 << random.below(8);
        assert!(CenterStream::from_bytes(&damaged).is_none());
    }
    for k in 0..HEAD {
        let mut damaged = bytes.clone();
        damaged[k] ^= 1;
        assert!(CenterStream::from_bytes(&damaged).is_none(), "{k}");
    }
}

/// CRC-32 (IEEE), bit by bit.
fn checksum(body: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in body {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg());
        }
    }
    !crc
}

fn forged(bytes: &[u8], body: &[u8]) -> Vec<u8> {
    [&bytes[..8], &checksum(body).to_le_bytes(), body].concat()
}

#[test]
fn with_a_forged_checksum_it_is_refused_or_goes_on_and_never_panics() {
    let samples = BallJoint::new(3, 1.0, 0.05).samples(100.0, 300);
    let request = Request {
        method: Method::Absolute,
        knowledge: Knowledge { bias_std: 0.3, lever_std: 1.0, correlated: 1.0, gyr_bias_std: 0.005 },
        axis: None,
        undetermined_std: 0.02,
        minimum_norm: true,
        max_iterations: 5,
    };
    let mut random = Random(4);
    let mut went_on = 0;
    for settings in [settings(), raw_settings()] {
        // Enough that room had to be made.
        let bytes = fed(settings, &BallJoint::new(1, 1.0, 0.05).samples(0.0, 1200)).to_bytes();
        assert_eq!(forged(&bytes, &bytes[HEAD..]), bytes, "the checksum is the usual one");
        for trial in 0..300 {
            let mut body = bytes[HEAD..].to_vec();
            for _ in 0..=random.below(4) {
                // The settings at the beginning and the counts among the last are where it hurts.
                let at = match trial % 3 {
                    0 => random.below(60),
                    1 => body.len() - 1 - random.below(600),
                    _ => random.below(body.len()),
                };
                body[at] = [0, 1, 127, 128, 255, random.below(256) as u8][random.below(6)];
            }
            if let Some(mut stream) = CenterStream::from_bytes(&forged(&bytes, &body)) {
                stream.push(samples.iter().copied());
                let _ = stream.to_bytes();
                if trial % 10 == 0 {
                    let _ = estimate(stream.moments(), &request, &mut || true);
                }
                went_on += 1;
            }
        }
    }
    assert!(went_on > 50, "{went_on}");
}

#[test]
fn random_bytes_behind_a_good_head_never_panic() {
    let (head, mut random) = (saved()[..8].to_vec(), Random(5));
    for _ in 0..500 {
        let body: Vec<u8> = (0..random.below(300)).map(|_| random.below(256) as u8).collect();
        assert!(CenterStream::from_bytes(&forged(&head, &body)).is_none());
    }
}

#[test]
fn forged_counts_next_to_overflow_make_nothing_panic() {
    let samples = BallJoint::new(3, 1.0, 0.05).samples(100.0, 120);
    let bytes = fed(raw_settings(), &BallJoint::new(1, 1.0, 0.05).samples(0.0, 600)).to_bytes();
    let (body, mut went_on) = (&bytes[HEAD..], 0);
    // Any byte among the last may be a count of one digit: there is a larger one in its place.
    for at in body.len().saturating_sub(500)..body.len() {
        for large in [u64::MAX, u64::MAX - 1, 1 << 63, 1 << 32] {
            let mut digits = Vec::new();
            let mut rest = large;
            while rest > 127 {
                digits.push(rest as u8 | 128);
                rest >>= 7;
            }
            digits.push(rest as u8);
            let body = [&body[..at], &digits, &body[at + 1..]].concat();
            if let Some(mut stream) = CenterStream::from_bytes(&forged(&bytes, &body)) {
                stream.push(samples.iter().copied());
                went_on += 1;
            }
        }
    }
    assert!(went_on > 0);
}
