//! What the stream says of a linkage whose truth is known: axes, pairing, and that a strap has slipped.

use imufast_core::{
    PairSample, Xyz,
    hinge::{
        AxisPair,
        record::refit,
        sign::{PAIRING_DECIDED, Stretch, pairing_evidence},
        stream::{HingeStream, PRESENT_MOVING},
    },
};
use nalgebra::{Rotation3, Vector3};

use crate::data::{Linkage, fed, line_angle, settings};

fn stretch(linkage: &mut Linkage, start_s: f64, count: usize) -> Stretch {
    Stretch { step_s: 0.02, samples: linkage.samples(start_s, count).into_iter().map(|(_, s)| s).collect() }
}

#[test]
fn planar_motion_pairs_the_axes_in_any_mounting() {
    for seed in 0..20 {
        let mut linkage = Linkage::new(seed);
        let stretches: Vec<Stretch> = (0..3).map(|k| stretch(&mut linkage, 5.0 * f64::from(k), 200)).collect();
        let axes = linkage.axes();
        let (right, wrong) =
            (pairing_evidence(&axes, stretches.iter()), pairing_evidence(&axes.other_sign_pair(), stretches.iter()));
        assert!(right > 10.0 * PAIRING_DECIDED, "{seed}: {right}");
        assert!((right + wrong).abs() < 1e-9, "one hypothesis against the other, either way round");
        assert!((pairing_evidence(&axes.flipped(), stretches.iter()) - right).abs() < 1e-9, "the common sign is free");
    }
}

#[test]
fn stretches_too_short_to_differentiate_say_nothing() {
    let mut linkage = Linkage::new(1);
    for count in 0..8 {
        let short = [stretch(&mut linkage, 0.0, count)];
        assert_eq!(pairing_evidence(&linkage.axes(), short.iter()), 0.0, "{count}");
    }
}

#[test]
fn the_stream_finds_the_axes_and_their_pairing() {
    for seed in 0..10 {
        let mut linkage = Linkage::new(seed);
        let record = fed(settings(), &linkage.samples(0.0, 1500)).estimate(None).expect("half a minute is enough");
        let (found, truth) = (record.minima[0].axes, linkage.axes());
        assert!(line_angle(&found.j1, &truth.j1) < 0.005 && line_angle(&found.j2, &truth.j2) < 0.005, "{seed}: {found:?}");
        assert!(found.j1.dot(&truth.j1) * found.j2.dot(&truth.j2) > 0.0, "{seed}");
        assert!(record.pairing > PAIRING_DECIDED);
        assert!(record.witness.misfit.is_some_and(|m| m < 0.02));
        assert!(record.witness.moving_s > 15.0 && record.witness.moving_s <= 30.0);
    }
}

#[test]
fn a_gap_every_few_seconds_costs_stretches_and_no_axis() {
    let mut linkage = Linkage::new(3);
    let samples: Vec<(f64, PairSample)> = (0..8).flat_map(|k| linkage.samples(6.0 * f64::from(k), 260)).collect();
    let record = fed(settings(), &samples).estimate(None).expect("40 s in pieces of 5");
    assert!(line_angle(&record.minima[0].axes.j1, &linkage.axes().j1) < 0.005);
    assert!(record.pairing > PAIRING_DECIDED);
}

fn present(stream: &HingeStream) -> Vec<[Xyz; 2]> {
    stream.present().copied().collect()
}

#[test]
fn present_motion_refitted_tells_a_slip_from_none() {
    let mut linkage = Linkage::new(8);
    let mut stream = fed(settings(), &linkage.samples(0.0, 1500));
    assert_eq!(present(&stream).len(), PRESENT_MOVING);
    let truth = linkage.axes();
    let same = refit(stream.present(), &truth).expect("plenty of motion");
    assert!(same.misfit_before < 0.02 && same.misfit < 0.02, "{same:?}");
    assert!(line_angle(&same.axes.j1, &truth.j1) < 0.02);

    // The strap of sensor 1 slips by 20 degrees.
    let across = truth.tangent().b1.column(0).into_owned();
    let slip = Rotation3::new(20_f64.to_radians() * across);
    linkage.mounts[0] = slip * linkage.mounts[0];
    linkage.samples(30.0, 1500).iter().for_each(|(t, s)| stream.push(*t, s));
    let turned = refit(stream.present(), &truth).expect("plenty of motion");
    assert!(turned.misfit_before > 0.1 && turned.misfit < 0.02, "{turned:?}");
    assert!(line_angle(&turned.axes.j1, &linkage.axes().j1) < 0.03, "{turned:?}");
    assert!((line_angle(&turned.axes.j1, &truth.j1).to_degrees() - 20.0).abs() < 2.0);
}

#[test]
fn motion_that_says_nothing_is_not_refitted() {
    let axes = AxisPair::new(Vector3::x(), Vector3::y());
    assert!(refit([].iter(), &axes).is_none());
    assert!(refit([[[0.0; 3]; 2]; 200].iter(), &axes).is_none());
}

#[test]
fn only_present_motion_is_present() {
    let mut linkage = Linkage::new(9);
    let mut stream = fed(settings(), &linkage.samples(0.0, 1500));
    let before = present(&stream);
    let still = [0.0, 0.0, 0.0, 0.0, 0.0, 9.81, 0.0, 0.0, 0.0, 0.0, 0.0, 9.81];
    (0..3000).for_each(|k| stream.push(30.0 + f64::from(k) * 0.02, &still));
    // Rest adds nothing: only the filter's tail of the motion that had just ended pushes old instants out.
    let after = present(&stream);
    assert_eq!(after.len(), before.len());
    let pushed = (0..40).find(|n| before[*n..] == after[..after.len() - n]);
    assert!(pushed.is_some(), "rest pushed motion out");
}
