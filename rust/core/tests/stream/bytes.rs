//! What is not exactly what `to_bytes` wrote is refused, and a forged checksum makes nothing panic.

use imufast_core::hinge::stream::HingeStream;

use crate::data::{Linkage, Random, fed, raw_settings, settings};

const HEAD: usize = 12; // version and checksum

fn saved() -> Vec<u8> {
    fed(settings(), &Linkage::new(1).samples(0.0, 900)).to_bytes()
}

#[test]
fn truncated_bytes_are_none() {
    let bytes = saved();
    for length in (0..64).chain((64..bytes.len()).step_by(97)).chain(bytes.len() - 8..bytes.len()) {
        assert!(HingeStream::from_bytes(&bytes[..length]).is_none(), "{length}");
    }
}

#[test]
fn bytes_with_more_behind_are_none() {
    let mut bytes = saved();
    bytes.push(0);
    assert!(HingeStream::from_bytes(&bytes).is_none());
}

#[test]
fn every_flipped_bit_is_noticed() {
    let (bytes, mut random) = (saved(), Random(2));
    for _ in 0..300 {
        let mut damaged = bytes.clone();
        damaged[random.below(bytes.len())] ^= 1 << random.below(8);
        assert!(HingeStream::from_bytes(&damaged).is_none());
    }
    for k in 0..HEAD {
        let mut damaged = bytes.clone();
        damaged[k] ^= 1;
        assert!(HingeStream::from_bytes(&damaged).is_none(), "{k}");
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
    let samples = Linkage::new(3).samples(100.0, 60);
    let mut random = Random(4);
    let mut went_on = 0;
    for settings in [settings(), raw_settings()] {
        let bytes = fed(settings, &Linkage::new(1).samples(0.0, 400)).to_bytes();
        assert_eq!(forged(&bytes, &bytes[HEAD..]), bytes, "the checksum is the usual one");
        for trial in 0..90 {
            let mut body = bytes[HEAD..].to_vec();
            for _ in 0..=random.below(4) {
                // The settings at the beginning and the lengths among the last are where it hurts.
                let at = match trial % 3 {
                    0 => random.below(100),
                    1 => body.len() - 1 - random.below(2000),
                    _ => random.below(body.len()),
                };
                body[at] = [0, 1, 127, 128, 255, random.below(256) as u8][random.below(6)];
            }
            if let Some(mut stream) = HingeStream::from_bytes(&forged(&bytes, &body)) {
                samples.iter().for_each(|(t, s)| stream.push(*t, s));
                let _ = stream.to_bytes();
                went_on += 1;
            }
        }
    }
    assert!(went_on > 20, "{went_on}");
}

#[test]
fn random_bytes_behind_a_good_head_never_panic() {
    let (head, mut random) = (saved()[..8].to_vec(), Random(5));
    for _ in 0..500 {
        let body: Vec<u8> = (0..random.below(300)).map(|_| random.below(256) as u8).collect();
        assert!(HingeStream::from_bytes(&forged(&head, &body)).is_none());
    }
}
