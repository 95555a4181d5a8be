//! Descents, how they end, and the evidence at their end.

use imufast_core::{
    hinge::{
        AxisPair, Evidence, SolveOptions, Status,
        axes::stack,
        deterministic_starts,
        evidence::{angular_deviation, tangent_covariance},
        solve::{same_axes, solve},
    },
    so3::angle_between,
};
use nalgebra::{Matrix2, Vector3, Vector6};

use crate::data::{Pairs, Random, any_samples, cost_of, delicate_axes, hinge_samples};

#[test]
fn the_same_data_give_the_same_bits_again() {
    let mut random = Random(7);
    let truth = random.axes();
    let (gyr, acc) = hinge_samples(&mut random, &truth, 777, 0.02);
    let run = || {
        let cost = cost_of(50.0, &gyr, &acc);
        let solution = solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || true);
        let evidence = Evidence::at(&solution.best().axes, &cost);
        let mut bits: Vec<u64> = stack(&solution.best().axes).iter().map(|x| x.to_bits()).collect();
        bits.push(solution.best().cost.to_bits());
        bits.extend(evidence.covariance.iter().chain(evidence.published_covariance.iter()).map(|x| x.to_bits()));
        (bits, solution.iterations)
    };
    let first = run();
    assert!((0..5).all(|_| run() == first));
}

#[test]
fn the_axes_of_an_exact_hinge_are_found_to_rounding_with_their_sign_pair() {
    let mut random = Random(10);
    for truth in delicate_axes(&mut random) {
        let (gyr, acc) = hinge_samples(&mut random, &truth, 200, 0.0);
        let cost = cost_of(50.0, &gyr, &acc);
        let solution = solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || true);
        let best = solution.best();
        assert_eq!(best.status, Status::Converged);
        assert!(same_axes(&best.axes, &truth, 1e-9), "{truth:?} gave {:?}", best.axes);
        assert!(best.axes == best.axes.canonical());
        assert!(solution.minima.windows(2).all(|pair| pair[0].cost <= pair[1].cost));
    }
}

#[test]
fn random_starts_end_in_the_same_minimum() {
    let mut random = Random(11);
    let truth = random.axes();
    let (gyr, acc) = hinge_samples(&mut random, &truth, 600, 0.05);
    let cost = cost_of(50.0, &gyr, &acc);
    let options = SolveOptions { coarse_first: false, ..SolveOptions::default() };
    let starts: Vec<AxisPair> = (0..50).map(|_| random.axes()).collect();
    let (many, few) = (
        solve(&cost, &starts, &options, &mut || true),
        solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || true),
    );
    assert!(few.best().cost <= many.best().cost * (1.0 + 1e-9));
    assert!(same_axes(&few.best().axes, &many.best().axes, 1e-6));
}

#[test]
fn one_start_with_its_sign_pair_is_algorithm_1() {
    let mut random = Random(12);
    let truth = random.axes();
    let (gyr, acc) = hinge_samples(&mut random, &truth, 400, 0.01);
    let cost = cost_of(50.0, &gyr, &acc);
    let options = SolveOptions { coarse_first: false, ..SolveOptions::default() };
    let wrong_sign = AxisPair::new(truth.j1, -truth.j2);
    let solution = solve(&cost, &[wrong_sign], &options, &mut || true);
    assert!(same_axes(&solution.best().axes, &truth, 0.01));
    assert!(solution.minima.len() <= 2);
}

#[test]
fn data_without_any_motion_or_force_are_not_identifiable() {
    let zeros: Pairs = (0..300).map(|k| (k as f64 * 0.02, [0.0; 3], [0.0; 3])).collect();
    let cost = cost_of(50.0, &zeros, &zeros);
    let solution = solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || true);
    assert_eq!(solution.best().status, Status::NotIdentifiable);
    let evidence = Evidence::at(&solution.best().axes, &cost);
    assert!(evidence.covariance.iter().all(|p| !p.is_nan()));
    assert!(evidence.covariance.trace().is_infinite() && evidence.published_covariance.trace().is_infinite());
    let nothing = cost_of(50.0, &Pairs::new(), &Pairs::new());
    assert_eq!(solve(&nothing, &[], &SolveOptions::default(), &mut || true).best().status, Status::NotIdentifiable);
}

#[test]
fn data_that_overflow_are_a_numerical_error_and_end() {
    for size in [1e160, 1e200, 1e300] {
        for (gyr_size, acc_size) in [(size, 1.0), (1.0, size), (size, size)] {
            let mut random = Random(13);
            let (mut gyr, mut acc) = any_samples(&mut random, 60);
            gyr.iter_mut().for_each(|(_, a, b)| a.iter_mut().chain(b).for_each(|x| *x *= gyr_size));
            acc.iter_mut().for_each(|(_, a, b)| a.iter_mut().chain(b).for_each(|x| *x *= acc_size));
            let cost = cost_of(50.0, &gyr, &acc);
            let starts: Vec<AxisPair> = (0..4).map(|_| random.axes()).collect();
            let solution = solve(&cost, &starts, &SolveOptions::default(), &mut || true);
            assert_eq!(solution.best().status, Status::NumericalError, "gyr {gyr_size:e}, acc {acc_size:e}");
        }
    }
}

#[test]
fn deterministic_starts_are_unit_vectors_whatever_the_data() {
    let mut random = Random(14);
    for size in [0.0, 1e-300, 1e-160, 1.0, 1e150, 1e155, 1e200, 1e300] {
        let (mut gyr, mut acc) = any_samples(&mut random, 40);
        let all = gyr.iter_mut().chain(acc.iter_mut());
        all.for_each(|(_, a, b)| a.iter_mut().chain(b).for_each(|x| *x *= size));
        for start in deterministic_starts(&cost_of(50.0, &gyr, &acc)) {
            assert!((start.j1.norm() - 1.0).abs() < 1e-12 && (start.j2.norm() - 1.0).abs() < 1e-12, "{size:e}: {start:?}");
        }
    }
}

#[test]
fn a_pair_has_unit_axes_whatever_it_is_made_of() {
    for x in [0.0, 1e-320, 1e-200, 1e200, f64::MAX, f64::NAN, f64::INFINITY] {
        let pair = AxisPair::new(Vector3::new(x, 0.0, 0.0), Vector3::new(0.0, x, x));
        assert!((pair.j1.norm() - 1.0).abs() < 1e-12 && (pair.j2.norm() - 1.0).abs() < 1e-12, "{x:e}: {pair:?}");
    }
}

#[test]
fn a_caller_who_says_stop_is_obeyed() {
    let mut random = Random(15);
    let truth = random.axes();
    let (gyr, acc) = hinge_samples(&mut random, &truth, 300, 0.05);
    let cost = cost_of(50.0, &gyr, &acc);
    for allowed in 0..5 {
        let mut asked = 0;
        let solution = solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || {
            asked += 1;
            asked <= allowed
        });
        assert_eq!(solution.best().status, Status::Interrupted, "after {allowed} iterations");
        assert_eq!(asked, allowed + 1, "a no is asked for once");
    }
}

/// A caller who can say no only once, as a pending Ctrl-C does: asking clears it.
fn interrupted_once(count: usize, allowed: usize) -> (Status, usize) {
    let mut random = Random(15);
    let truth = random.axes();
    let (gyr, acc) = hinge_samples(&mut random, &truth, count, 0.05);
    let cost = cost_of(50.0, &gyr, &acc);
    let mut asked = 0;
    let solution = solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || {
        asked += 1;
        asked != allowed + 1
    });
    (solution.best().status, asked)
}

#[test]
fn one_no_is_enough_on_few_samples() {
    for allowed in 0..5 {
        assert_eq!(interrupted_once(300, allowed), (Status::Interrupted, allowed + 1));
    }
}

#[test]
fn one_no_is_enough_on_many_samples_whose_valleys_are_found_on_few() {
    for allowed in 0..5 {
        assert_eq!(interrupted_once(5000, allowed), (Status::Interrupted, allowed + 1));
    }
}

#[test]
fn iterations_that_run_out_are_reported() {
    let mut random = Random(16);
    let truth = random.axes();
    let (gyr, acc) = hinge_samples(&mut random, &truth, 300, 0.05);
    let cost = cost_of(50.0, &gyr, &acc);
    let options = SolveOptions { max_iterations: 1, coarse_first: false, ..SolveOptions::default() };
    let solution = solve(&cost, &[random.axes()], &options, &mut || true);
    assert!(solution.minima.iter().all(|m| m.status == Status::MaxIterations && m.iterations == 1));
}

#[test]
fn covariance_is_tangent_to_the_axes_and_the_deviation_is_its_moment() {
    let mut random = Random(17);
    for truth in delicate_axes(&mut random) {
        let (gyr, acc) = hinge_samples(&mut random, &truth, 500, 0.05);
        let cost = cost_of(50.0, &gyr, &acc);
        let best = solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || true).best().axes;
        let evidence = Evidence::at(&best, &cost);
        for p in [&evidence.covariance, &evidence.published_covariance] {
            assert!((p - p.transpose()).amax() <= 1e-12 * p.trace());
            assert!(p.symmetric_eigenvalues().min() > -1e-12 * p.trace());
            let along1 = Vector6::new(best.j1.x, best.j1.y, best.j1.z, 0.0, 0.0, 0.0);
            let along2 = Vector6::new(0.0, 0.0, 0.0, best.j2.x, best.j2.y, best.j2.z);
            assert!((p * along1).norm() < 1e-12 * p.trace() && (p * along2).norm() < 1e-12 * p.trace());
            for part in tangent_covariance(p, &best.tangent()) {
                let (mean, std) = angular_deviation(&part);
                assert!((mean * mean + std * std - part.trace()).abs() < 1e-12 * part.trace());
            }
        }
        assert!(angle_between(&best.j1, &truth.j1).sin() < 0.02);
    }
}

#[test]
fn the_closed_form_of_the_angular_deviation_agrees_with_drawing_it() {
    // Eqs 62-65 by Monte Carlo; 200 000 draws, so means are good to about 0.3 %.
    let mut random = Random(18);
    for (a, b) in [(1.0_f64, 1.0_f64), (1.0, 0.3), (1.0, 0.01), (1.0, 0.0), (0.2, 0.7)] {
        let turn = nalgebra::Rotation2::new(random.uniform() * 6.0);
        let root = turn.matrix() * Matrix2::new(a.sqrt(), 0.0, 0.0, b.sqrt());
        let draws = 200_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..draws {
            let length = (root * nalgebra::Vector2::new(random.normal(), random.normal())).norm();
            sum += length;
            squares += length * length;
        }
        let drawn_mean = sum / f64::from(draws);
        let drawn_std = (squares / f64::from(draws) - drawn_mean * drawn_mean).sqrt();
        let (mean, std) = angular_deviation(&(root * root.transpose()));
        assert!((mean - drawn_mean).abs() < 0.01 * mean && (std - drawn_std).abs() < 0.01 * std, "{a} {b}");
    }
}
