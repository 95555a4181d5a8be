//! Every derivative of every term against central differences, at random places and at awkward ones.

use imufast_core::{
    body::{
        factors::{
            axes_agree, axis_angle, gauge::Gauge, hinge, imu, joint_center, length_difference, length_limits, segment_length,
            skin::Seat,
        },
        preintegration::{Preintegrated, Step},
        states::{GYR_BIAS, Motion, POSITION, TURN, VELOCITY},
    },
    so3::{retract, tangent_basis},
};
use nalgebra::{Vector2, Vector3};

use crate::data::{Random, apart, nudged, slope};

const TOLERANCE: f64 = 2e-7;

fn three(v: Vector3<f64>) -> [f64; 3] {
    v.into()
}

fn tilted(axis: &Vector3<f64>, k: usize, by: f64) -> Vector3<f64> {
    let mut step = Vector2::zeros();
    step[k] = by;
    retract(axis, &tangent_basis(axis), &step)
}

#[test]
fn imu_dynamics() {
    let mut random = Random(1);
    for _ in 0..20 {
        let reference = [random.vector(0.01), random.vector(0.1)];
        let mut pre = Preintegrated::new(reference[0], reference[1]);
        let rate = random.vector(2.0);
        for _ in 0..10 {
            let step = Step { dt: 0.01, gyr: rate + random.vector(0.3), acc: random.vector(5.0) };
            pre.push(&step, 1e-3, 1e-2, 1e-4);
        }
        let i = random.motion();
        // Near where the increments lead: rotation residuals of a few tenths at most.
        let mut j = random.motion();
        let turn = nalgebra::Rotation3::from_matrix_unchecked(pre.turn);
        let q = i.q * nalgebra::UnitQuaternion::from_rotation_matrix(&turn);
        let to = Motion::turned(q * nalgebra::UnitQuaternion::from_scaled_axis(random.vector(0.1)));
        (j.q, j.turn) = (to.q, to.turn);
        let (_, rows) = imu::linearised(&pre, &i, &j, 9.81);
        let flat = |e: imu::Residual| -> [f64; 9] { core::array::from_fn(|k| e[k / 3][k % 3]) };
        for c in 0..24 {
            let found = slope(|h| {
                let (i, j) = if c < 15 { (nudged(&i, c, h), j) } else { (i, nudged(&j, c - 15, h)) };
                flat(imu::residual(&pre, &i, &j, 9.81))
            });
            let stated: [f64; 9] = core::array::from_fn(|r| rows[r / 3][c / 3][(r % 3, c % 3)]);
            assert!(apart(&found, &stated) < TOLERANCE, "column {c}: {found:?} {stated:?}");
        }
    }
}

#[test]
fn hinge_axes() {
    let mut random = Random(2);
    for _ in 0..20 {
        let (a, b) = (random.motion(), random.motion());
        let (rate_a, rate_b, axis) = (random.vector(3.0), random.vector(3.0), random.direction());
        let stated = hinge::linearised(&a, &b, [&rate_a, &rate_b], &axis);
        let at = |a: &Motion, b: &Motion, axis: &Vector3<f64>| three(hinge::residual(a, b, [&rate_a, &rate_b], axis));
        assert!(apart(&stated.residual.into(), &at(&a, &b, &axis)) < 1e-14);
        for c in 0..3 {
            for (from, blocks) in [(TURN, &stated.turns), (GYR_BIAS, &stated.biases)] {
                let by_a = slope(|h| at(&nudged(&a, from + c, h), &b, &axis));
                let by_b = slope(|h| at(&a, &nudged(&b, from + c, h), &axis));
                assert!(apart(&by_a, &three(blocks[0].column(c).into())) < TOLERANCE);
                assert!(apart(&by_b, &three(blocks[1].column(c).into())) < TOLERANCE);
            }
        }
        for c in 0..2 {
            let found = slope(|h| at(&a, &b, &tilted(&axis, c, h)));
            assert!(apart(&found, &three(stated.axis.column(c).into())) < TOLERANCE);
        }
    }
}

#[test]
fn axes_that_agree() {
    let mut random = Random(3);
    for _ in 0..20 {
        let (a, b) = (random.motion(), random.motion());
        let axes = [random.direction(), random.direction()];
        let stated = axes_agree::linearised(&a, &b, &axes);
        for c in 0..3 {
            let by_a = slope(|h| three(axes_agree::residual(&nudged(&a, c, h), &b, &axes)));
            let by_b = slope(|h| three(axes_agree::residual(&a, &nudged(&b, c, h), &axes)));
            assert!(apart(&by_a, &three(stated.turns[0].column(c).into())) < TOLERANCE);
            assert!(apart(&by_b, &three(stated.turns[1].column(c).into())) < TOLERANCE);
        }
        for c in 0..2 {
            let first = slope(|h| three(axes_agree::residual(&a, &b, &[tilted(&axes[0], c, h), axes[1]])));
            let second = slope(|h| three(axes_agree::residual(&a, &b, &[axes[0], tilted(&axes[1], c, h)])));
            assert!(apart(&first, &three(stated.axes[0].column(c).into())) < TOLERANCE);
            assert!(apart(&second, &three(stated.axes[1].column(c).into())) < TOLERANCE);
        }
    }
}

#[test]
fn joint_centers() {
    let mut random = Random(4);
    for _ in 0..20 {
        let (a, b) = (random.motion(), random.motion());
        let centers = [random.vector(0.3), random.vector(0.3)];
        let stated = joint_center::linearised(&a, &b, &centers);
        for c in 0..3 {
            let mut unit = Vector3::zeros();
            unit[c] = 1.0;
            let by_a = slope(|h| three(joint_center::residual(&nudged(&a, TURN + c, h), &b, &centers)));
            let by_b = slope(|h| three(joint_center::residual(&a, &nudged(&b, TURN + c, h), &centers)));
            assert!(apart(&by_a, &three(stated.turns[0].column(c).into())) < TOLERANCE);
            assert!(apart(&by_b, &three(stated.turns[1].column(c).into())) < TOLERANCE);
            let here = slope(|h| three(joint_center::residual(&nudged(&a, POSITION + c, h), &b, &centers)));
            let there = slope(|h| three(joint_center::residual(&a, &nudged(&b, POSITION + c, h), &centers)));
            assert!(apart(&here, &three(unit)) < TOLERANCE && apart(&there, &three(-unit)) < TOLERANCE);
            for side in 0..2 {
                let found = slope(|h| {
                    let mut moved = centers;
                    moved[side][c] += h;
                    three(joint_center::residual(&a, &b, &moved))
                });
                assert!(apart(&found, &three(stated.centers[side].column(c).into())) < TOLERANCE);
            }
        }
    }
}

#[test]
fn centers_under_skin() {
    let mut random = Random(8);
    for size in [0.0, 0.1, 1.0] {
        let skins = [[random.vector(size), random.vector(0.02)], [random.vector(size), random.vector(0.02)]];
        let (angles, point) = ([0.7, -1.2], random.vector(0.3));
        let at = |skins: &[[Vector3<f64>; 2]; 2], point: &Vector3<f64>| Seat::new(skins.iter().zip(&angles)).point(point);
        let seat = Seat::new(skins.iter().zip(&angles));
        for c in 0..3 {
            let mut unit = Vector3::zeros();
            unit[c] = 1.0;
            let found = slope(|h| three(at(&skins, &(point + unit * h))));
            assert!(apart(&found, &three(seat.turn.column(c).into())) < TOLERANCE);
            for (n, angle) in angles.iter().enumerate() {
                for (part, stated) in [(0, seat.by_turn(&point)), (1, nalgebra::Matrix3::identity())] {
                    let found = slope(|h| {
                        let mut moved = skins;
                        moved[n][part][c] += h;
                        three(at(&moved, &point))
                    });
                    assert!(apart(&found, &three(stated.column(c) * *angle)) < TOLERANCE);
                }
            }
        }
    }
    // Two skins that undo each other leave everything in its place.
    let skins = [[Vector3::x(), Vector3::y()]; 2];
    let point = Seat::new(skins.iter().zip(&[0.5, -0.5])).point(&Vector3::z());
    assert!((point - Vector3::z()).norm() < 1e-15);
}

#[test]
fn axis_against_bone() {
    let mut random = Random(5);
    for _ in 0..20 {
        let (axis, bone) = (random.direction(), random.vector(0.3));
        let (e, by_axis, by_bone) = axis_angle::linearised(&axis, &bone, 1.5);
        assert!((e - (1.5 - (axis.dot(&bone) / bone.norm()).acos())).abs() < 1e-12);
        for c in 0..2 {
            let found = slope(|h| [axis_angle::residual(&tilted(&axis, c, h), &bone, 1.5)]);
            assert!((found[0] - by_axis[c]).abs() < 1e-6);
        }
        for c in 0..3 {
            let found = slope(|h| {
                let mut moved = bone;
                moved[c] += h;
                [axis_angle::residual(&axis, &moved, 1.5)]
            });
            assert!((found[0] - by_bone[c]).abs() < 1e-6 * (1.0 + 1.0 / bone.norm()));
        }
    }
    // Along the bone there is no derivative, and no infinite one is claimed.
    let (e, by_axis, by_bone) = axis_angle::linearised(&Vector3::z(), &Vector3::new(0.0, 0.0, 0.4), 1.5);
    assert!((e - 1.5).abs() < 1e-12 && by_axis.norm() == 0.0 && by_bone.norm() == 0.0);
}

#[test]
fn lengths_limits_and_differences() {
    let mut random = Random(6);
    let shifted = |bone: &Vector3<f64>, c: usize, h: f64| {
        let mut moved = *bone;
        moved[c] += h;
        moved
    };
    for size in [0.1, 0.24, 0.4, 1.0] {
        for _ in 0..10 {
            let (bone, other) = (random.direction() * size, random.vector(0.3));
            let limits = [0.25, 0.7];
            for c in 0..3 {
                let found = slope(|h| [segment_length::linearised(&shifted(&bone, c, h), 0.4).0]);
                assert!((found[0] - segment_length::linearised(&bone, 0.4).1[c]).abs() < TOLERANCE);
                let found = slope(|h| [length_limits::linearised(&shifted(&bone, c, h), limits, 4.0).0]);
                assert!((found[0] - length_limits::linearised(&bone, limits, 4.0).1[c]).abs() < TOLERANCE);
                let stated = length_difference::linearised([&bone, &other]).1;
                let found = slope(|h| [length_difference::linearised([&shifted(&bone, c, h), &other]).0]);
                assert!((found[0] - stated[0][c]).abs() < TOLERANCE);
                let found = slope(|h| [length_difference::linearised([&bone, &shifted(&other, c, h)]).0]);
                assert!((found[0] - stated[1][c]).abs() < TOLERANCE);
            }
        }
    }
    assert_eq!(length_limits::linearised(&Vector3::new(0.3, 0.0, 0.0), [0.25, 0.7], 4.0).0, 0.0);
    // Eq. 14 by hand.
    let beyond: f64 = 0.3;
    let expected = beyond * (4.0 * beyond).tanh().powi(2);
    assert!((length_limits::linearised(&Vector3::new(1.0, 0.0, 0.0), [0.25, 0.7], 4.0).0 - expected).abs() < 1e-12);
}

#[test]
fn gauge() {
    let mut random = Random(7);
    for _ in 0..20 {
        let start = random.motion();
        let gauge = Gauge::of(&start);
        assert!(gauge.heading_residual(&start).abs() < 1e-14);
        let at = nudged(&nudged(&start, 0, 0.2), 2, -0.1);
        let stated = gauge.heading_turn(&at);
        for c in 0..3 {
            let found = slope(|h| [gauge.heading_residual(&nudged(&at, TURN + c, h))]);
            assert!((found[0] - stated[c]).abs() < TOLERANCE);
        }
        // Turned about the upright by 3 rad and more it stays within half a turn.
        let q = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::z() * 3.0) * start.q;
        assert!((gauge.heading_residual(&Motion::turned(q)) - 3.0).abs() < 1e-12);
        assert_eq!(nudged(&start, VELOCITY, 1.0).position, start.position);
    }
}
