//! The residuals' derivatives are those that differences show, and the sums in one pass are those of a slow loop.

use imufast_core::joint_center::{
    Matrix12, Unknowns,
    loss::Loss,
    ls,
    moments::Moments,
    residual::{Sums, residual, spread, sums},
};
use imufast_core::rigid_body::Moment;
use nalgebra::{Rotation3, Vector3};

use crate::data::{Random, scattered, scattered_smooth, side};

const LOSSES: [Loss; 5] =
    [Loss::Square, Loss::Huber(0.7), Loss::Huber(1e-9), Loss::Absolute(0.3, 0.0), Loss::Absolute(1e-6, 0.02)];
const COUNTS: [usize; 8] = [0, 1, 31, 32, 33, 64, 100, 1000];

fn unknowns(seed: u64, size: f64) -> Unknowns {
    let mut random = Random(seed);
    Unknowns::from_fn(|_, _| size * random.normal())
}

#[test]
fn the_derivative_of_the_residual_is_what_differences_show() {
    let mut random = Random(1);
    for trial in 0..200 {
        let (sides, x) = ([side(&mut random), side(&mut random)], unknowns(trial, 0.3));
        let (_, slope) = residual(&sides, &x);
        for k in 0..12 {
            let h = 1e-6;
            let along = |sign: f64| {
                let mut there = x;
                there[k] += sign * h;
                residual(&sides, &there).0
            };
            let seen = (along(1.0) - along(-1.0)) / (2.0 * h);
            assert!((seen - slope[k]).abs() < 1e-6 * (1.0 + slope[k].abs()), "{trial}, unknown {k}: {seen} {}", slope[k]);
        }
    }
}

#[test]
fn the_derivative_of_the_linear_residual_is_what_differences_show() {
    let mut random = Random(2);
    for trial in 0..100 {
        let rotation = Rotation3::new(random.vector(1.5)).into_inner();
        let (sides, x) = ([side(&mut random), side(&mut random)], unknowns(trial, 0.3));
        let (e, slope) = ls::residual(&sides, &rotation, &x);
        let slow = |x: &Unknowns| {
            let seen = |i: usize| {
                let r: Vector3<f64> = x.fixed_rows::<3>(3 * i).into();
                let b: Vector3<f64> = x.fixed_rows::<3>(6 + 3 * i).into();
                sides[i].a - sides[i].b * b - sides[i].c * r
            };
            seen(0) - rotation * seen(1)
        };
        assert!((e - slow(&x)).norm() < 1e-11 * (1.0 + e.norm()));
        for k in 0..12 {
            let mut there = x;
            there[k] += 1.0;
            assert!((slow(&there) - slow(&x) - slope.column(k)).norm() < 1e-10 * (1.0 + slope.column(k).norm()), "{k}");
        }
    }
}

#[test]
fn the_linear_residual_is_the_norms_difference_where_the_directions_agree() {
    let mut random = Random(3);
    let (mut sides, x) = ([side(&mut random), side(&mut random)], Unknowns::zeros());
    let rotation = Rotation3::new(random.vector(1.5));
    sides[0].a = rotation * sides[1].a * 1.3;
    let (e, _) = ls::residual(&sides, &rotation.into_inner(), &x);
    assert!((e.norm() - residual(&sides, &x).0.abs()).abs() < 1e-12);
}

#[test]
fn where_the_acceleration_at_the_centre_vanishes_the_slopes_are_zero_and_all_is_finite() {
    let mut random = Random(4);
    let mut sides = [side(&mut random), side(&mut random)];
    sides[1].a = Vector3::zeros();
    let (e, slope) = residual(&sides, &Unknowns::zeros());
    assert_eq!(e, sides[0].a.norm());
    assert_eq!(slope.fixed_rows::<3>(3).norm(), 0.0);
    assert_eq!(slope.fixed_rows::<3>(9).norm(), 0.0);
    assert!(slope.fixed_rows::<3>(0).norm() > 0.0);
    let mut still = Moments::default();
    let nothing = Moment { time_s: 0.0, sample: [0.0; 12], gyr_dot1: [0.0; 3], gyr_dot2: [0.0; 3] };
    still.push(&nothing);
    for loss in LOSSES {
        let sums = sums(&still, &Unknowns::zeros(), loss, true);
        assert!(sums.cost.is_finite() && sums.gradient.norm() == 0.0 && sums.hessian.iter().all(|v| v.is_finite()), "{loss:?}");
    }
}

/// The sums as their definition says, and the size of what was added.
fn slow_sums(moments: &Moments, x: &Unknowns, loss: Loss, active: usize) -> (Sums, Sums) {
    let zero = || Sums { cost: 0.0, absolute: 0.0, gradient: Unknowns::zeros(), hessian: Matrix12::zeros() };
    let (mut slow, mut size) = (zero(), zero());
    for k in 0..moments.len() {
        let (e, mut slope) = residual(&moments.at(k), x);
        (active..12).for_each(|k| slope[k] = 0.0);
        let (rho, psi, curvature) = loss.of(e);
        slow.cost += rho;
        slow.absolute += e.abs();
        slow.gradient += slope * psi;
        slow.hessian += slope * slope.transpose() * curvature;
        let slope = slope.abs();
        size.cost += rho;
        size.gradient += slope * psi.abs();
        size.hessian += slope * slope.transpose() * curvature;
    }
    (slow, size)
}

fn same(fast: &Sums, slow: &Sums, size: &Sums, about: &str) {
    // e is a small difference of large norms: a rounding of 1e-15 of these is more of a curvature that lives near 0.
    let near = |a: f64, b: f64, size: f64| (a - b).abs() <= 1e-8 * size;
    assert!(near(fast.cost, slow.cost, size.cost), "{about}: cost {} {}", fast.cost, slow.cost);
    assert!(near(fast.absolute, slow.absolute, slow.absolute), "{about}: absolute");
    for a in 0..12 {
        assert!(near(fast.gradient[a], slow.gradient[a], size.gradient[a]), "{about}: gradient {a}");
        for b in 0..12 {
            assert_eq!(fast.hessian[(a, b)], fast.hessian[(b, a)]);
            assert!(near(fast.hessian[(a, b)], slow.hessian[(a, b)], size.hessian[(a, b)]), "{about}: hessian {a} {b}");
        }
    }
}

#[test]
fn the_sums_are_those_of_a_slow_loop() {
    for count in COUNTS {
        for moments in [scattered(7 + count as u64, count), scattered_smooth(8 + count as u64, count)] {
            for x in [Unknowns::zeros(), unknowns(1, 0.2)] {
                for loss in LOSSES {
                    for biases in [false, true] {
                        let fast = sums(&moments, &x, loss, biases);
                        let (slow, size) = slow_sums(&moments, &x, loss, if biases { 12 } else { 6 });
                        same(&fast, &slow, &size, &format!("{count} moments, {loss:?}, biases {biases}"));
                    }
                }
            }
        }
    }
}

#[test]
fn a_raw_moment_is_the_rigid_body_of_the_paper() {
    let mut random = Random(9);
    for _ in 0..20 {
        let [gyr1, dot1, acc1, gyr2, dot2, acc2] = core::array::from_fn(|_| random.vector(5.0));
        let mut sample = [0.0; 12];
        for (from, v) in [gyr1, acc1, gyr2, acc2].into_iter().enumerate() {
            sample[3 * from..3 * from + 3].copy_from_slice(v.as_slice());
        }
        let mut moments = Moments::default();
        moments.push(&Moment { time_s: 1.0, sample, gyr_dot1: dot1.into(), gyr_dot2: dot2.into() });
        let r = random.vector(1.0);
        for (side, [gyr, dot, acc]) in moments.at(0).iter().zip([[gyr1, dot1, acc1], [gyr2, dot2, acc2]]) {
            assert_eq!((side.a, side.gyr, side.b), (acc, gyr, nalgebra::Matrix3::identity()));
            assert!((side.c * r - gyr.cross(&gyr.cross(&r)) - dot.cross(&r)).norm() < 1e-12);
        }
    }
}

#[test]
fn without_unknown_biases_those_given_count_all_the_same() {
    let moments = scattered(8, 50);
    let x = unknowns(5, 0.3);
    let (with, without) = (sums(&moments, &x, Loss::Square, true), sums(&moments, &x, Loss::Square, false));
    assert!((with.cost - without.cost).abs() <= 1e-12 * with.cost);
    let mut levers = x;
    levers.fixed_rows_mut::<6>(6).fill(0.0);
    assert!((sums(&moments, &levers, Loss::Square, false).cost - without.cost).abs() > 1e-3);
}

#[test]
fn the_spread_is_made_of_the_same_sums_cut_into_pieces() {
    for count in COUNTS.into_iter().filter(|count| *count > 0) {
        let moments = if count % 2 == 0 { scattered(11, count) } else { scattered_smooth(11, count) };
        let x = unknowns(12, 0.2);
        for loss in LOSSES {
            for biases in [false, true] {
                let one = spread(&moments, &x, loss, biases, |_| 0.0);
                let many = spread(&moments, &x, loss, biases, |time| (time / 1.0).floor());
                assert_eq!(one.scores.len(), 1);
                let last = moments.time_s()[count - 1];
                assert_eq!(many.scores.len(), last.floor() as usize + 1, "{count}");
                let (slow, size) = slow_sums(&moments, &x, loss, if biases { 12 } else { 6 });
                let total = many.scores.iter().fold(Unknowns::zeros(), |sum, s| sum + s);
                for sum in [total, one.scores[0]] {
                    assert!((0..12).all(|a| (sum[a] - slow.gradient[a]).abs() <= 1e-8 * size.gradient[a]), "{count} {loss:?}");
                }
                let e = |x: &Unknowns| (0..count).map(|k| residual(&moments.at(k), x).0.powi(2)).sum::<f64>();
                let mut no_levers = x;
                no_levers.fixed_rows_mut::<6>(0).fill(0.0);
                assert!((many.squares / e(&x) - 1.0).abs() < 1e-11);
                // One block in four is compared; up to 128 instants that is the first 32.
                if count <= 32 {
                    assert!((many.unexplained / (e(&x) / e(&no_levers)) - 1.0).abs() < 1e-10);
                }
                assert_eq!(many.cost, sums(&moments, &x, loss, biases).cost);
            }
        }
    }
}

#[test]
fn thinning_keeps_moments_as_they_are_and_spreads_them_evenly() {
    let moments = scattered_smooth(21, 1000);
    for count in [1, 7, 31, 32, 33, 100, 999, 1000, 5000] {
        let few = moments.thinned(count);
        let stride = (1000 / count).max(1);
        assert_eq!(few.len(), 1000_usize.div_ceil(stride));
        for k in 0..few.len() {
            for (one, other) in few.at(k).iter().zip(moments.at(k * stride)) {
                assert_eq!((one.a, one.b, one.c, one.gyr), (other.a, other.b, other.c, other.gyr));
            }
            assert_eq!(few.time_s()[k], moments.time_s()[k * stride]);
        }
        let x = unknowns(22, 0.2);
        let (slow, size) = slow_sums(&few, &x, Loss::Square, 12);
        same(&sums(&few, &x, Loss::Square, true), &slow, &size, "thinned");
    }
    assert!(Moments::default().thinned(10).is_empty());
}
