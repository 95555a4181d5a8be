//! Memory that stays bounded and covers what it stands for.

use imufast_core::{hinge::stream::HingeStream, reservoir::Reservoir};

use crate::data::{Linkage, settings};

#[test]
fn memory_stays_what_it_is_over_many_minutes() {
    let mut linkage = Linkage::new(1);
    // A minute over and over; nobody asks for an estimate in between.
    let minute = linkage.samples(0.0, 3000);
    let mut stream = HingeStream::new(settings());
    let mut sizes = Vec::new();
    for k in 0..40 {
        for (t, sample) in &minute {
            stream.push(60.0 * f64::from(k) + t, sample);
        }
        sizes.push(stream.to_bytes().len());
    }
    let most = |part: &[usize]| part.iter().copied().max().unwrap_or(0);
    // Candidates gather up to 2048 and are pruned, so the size goes up and down; measured: 170 to 350 kB.
    assert!(most(&sizes[20..]) as f64 <= 1.1 * most(&sizes[..20]) as f64, "{sizes:?}");
    assert!(most(&sizes) < 450_000, "{sizes:?}");
    assert!(stream.estimate(None).is_some());
    assert!(stream.selected() <= 2 * settings().max_samples);
}

#[test]
fn a_reservoir_keeps_every_nth_from_the_first_on() {
    for capacity in [2, 5, 100] {
        let mut reservoir = Reservoir::new(capacity);
        for k in 0..5000_usize {
            reservoir.push(k);
            let held = reservoir.entries();
            assert!(held.len() <= capacity);
            assert_eq!(held[0], 0);
            let step = held.get(1).map_or(1, |second| second - held[0]);
            assert!(step.is_power_of_two());
            assert!(held.windows(2).all(|pair| pair[1] - pair[0] == step));
            assert!(k - held[held.len() - 1] < 2 * step, "the latest is near");
        }
        assert_eq!(reservoir.seen(), 5000);
        assert!(2 * reservoir.entries().len() >= capacity);
    }
}

#[test]
fn what_a_reservoir_holds_does_not_depend_on_when_it_was_saved() {
    let (mut one, mut other) = (Reservoir::new(16), Reservoir::new(16));
    for k in 0..1000_u32 {
        one.push(k);
        other.push(k);
        if k % 37 == 0 {
            other = other.clone();
        }
    }
    assert_eq!(one.entries(), other.entries());
}
