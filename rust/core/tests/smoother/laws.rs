//! Residuals, Jacobians and windows obey their definitions.

use imufast_core::orientation::smoother::{
    assemble::{Problem, State},
    kernel::{Kernel, Window},
    keys::{Key, View},
    noise::Noise,
    residual::{CONSTANTS, Constants, Drift, Link, inverse_right_jacobian},
};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::data::{Random, ignorant};

fn matrix(random: &mut Random) -> Matrix3<f64> {
    Matrix3::from_fn(|_, _| random.normal())
}

pub fn key(random: &mut Random) -> Key {
    let view = [0, 1].map(|_| View {
        acc: random.vector() * 5.0,
        bias: random.rotation().to_rotation_matrix().into_inner(),
        lever: matrix(random) * 10.0,
        turned: matrix(random) * 0.1,
    });
    Key { sample: 0, view, share: 0.3 + 0.7 * random.uniform(), span_s: 0.1, lost_variance: 0.0 }
}

fn near(a: f64, b: f64, what: &str) {
    assert!((a - b).abs() <= 1e-6 * (1.0 + b.abs()), "{what}: {a} against {b}");
}

/// Turns on the right from nearly nothing to nearly half a turn.
fn steps(random: &mut Random) -> Vec<Vector3<f64>> {
    [0.0, 1e-9, 1e-5, 9.9e-3, 1.01e-2, 0.3, 1.5, 3.0].iter().map(|size| random.vector().normalize() * *size).collect()
}

#[test]
fn jacobians_of_the_link_are_its_derivatives() {
    let mut random = Random(1);
    for _ in 0..10 {
        let key = key(&mut random);
        let (w, x) = (random.rotation(), Constants::from_fn(|_, _| random.normal()));
        let link = Link::at(&key, &w, &x);
        let d = 1e-6;
        for c in 0..3 {
            let axis = Vector3::ith(c, d);
            let at = |s: f64| Link::at(&key, &(w * UnitQuaternion::from_scaled_axis(axis * s)), &x).residual;
            let slope = (at(1.0) - at(-1.0)) / (2.0 * d);
            (0..3).for_each(|r| near(link.turn[(r, c)], slope[r], "turn"));
        }
        for c in 0..12 {
            let at = |s: f64| Link::at(&key, &w, &(x + Constants::ith(c, s * d))).residual;
            let slope = (at(1.0) - at(-1.0)) / (2.0 * d);
            (0..3).for_each(|r| near(link.constants[(r, c)], slope[r], "constants"));
        }
    }
}

#[test]
fn jacobians_of_the_drift_are_its_derivatives() {
    let mut random = Random(2);
    for step in steps(&mut random) {
        let key = key(&mut random);
        let w = random.rotation();
        let next = w * UnitQuaternion::from_scaled_axis(step);
        let moved = [random.vector() * 0.1, random.vector() * 0.1];
        let drift = Drift::between(&key, &w, &next, &moved);
        let d = 1e-6;
        for c in 0..3 {
            let turned = |q: &UnitQuaternion<f64>, s: f64| q * UnitQuaternion::from_scaled_axis(Vector3::ith(c, s * d));
            let biased = |i: usize, s: f64| {
                let mut moved = moved;
                moved[i][c] += s * d;
                moved
            };
            let slope = |f: &dyn Fn(f64) -> Drift| (f(1.0).residual - f(-1.0).residual) / (2.0 * d);
            let here = slope(&|s| Drift::between(&key, &turned(&w, s), &next, &moved));
            let there = slope(&|s| Drift::between(&key, &w, &turned(&next, s), &moved));
            let biases = [0, 1].map(|i| slope(&|s| Drift::between(&key, &w, &next, &biased(i, s))));
            for r in 0..3 {
                near(drift.here[(r, c)], here[r], "here");
                near(drift.next[(r, c)], there[r], "next");
                (0..2).for_each(|i| near(drift.biases[i][(r, c)], biases[i][r], "biases"));
            }
        }
    }
}

#[test]
fn the_series_of_the_inverse_jacobian_joins_its_closed_form() {
    let axis = Vector3::new(0.6, -0.48, 0.64);
    let gap = inverse_right_jacobian(&(axis * 0.009_999_999)) - inverse_right_jacobian(&(axis * 0.010_000_001));
    assert!(gap.norm() < 3e-9);
}

#[test]
fn the_systems_gradient_is_half_the_costs() {
    let mut random = Random(3);
    let mut keys: Vec<Key> = (0..6).map(|_| key(&mut random)).collect();
    keys[2].span_s = 0.0;
    keys[4].share = 0.0;
    keys[3].lost_variance = 1e-4;
    let prior = ignorant();
    let noise = Noise { link_std: 2.0, drift_std: 0.5, tail: 4.0, trust: 0.7 };
    let problem = Problem {
        keys: &keys,
        noise,
        prior: &prior,
        prior_weight: 1.7,
        drift_bias: [random.vector() * 0.1, random.vector() * 0.1],
    };
    let state = State { w: (0..6).map(|_| random.rotation()).collect(), x: Constants::from_fn(|_, _| 0.1 * random.normal()) };
    let system = problem.linearise(&state, 0.0);
    let d = 1e-6;
    let slope = |turn: &dyn Fn(f64) -> (Vec<Vector3<f64>>, Constants)| {
        let at = |s: f64| {
            let (turns, constants) = turn(s * d);
            problem.cost(&state.moved(&turns, &constants))
        };
        (at(1.0) - at(-1.0)) / (4.0 * d)
    };
    for k in 0..6 {
        for c in 0..3 {
            let turn = |s: f64| {
                let mut turns = vec![Vector3::zeros(); 6];
                turns[k][c] = s;
                (turns, Constants::zeros())
            };
            near(system.nodes[k].gradient[c], slope(&turn), "node");
        }
    }
    for c in 0..CONSTANTS {
        near(system.gradient[c], slope(&|s| (vec![Vector3::zeros(); 6], Constants::ith(c, s))), "constant");
    }
}

#[test]
fn windows_average_polynomials_and_their_second_derivatives_at_any_spacing() {
    let mut random = Random(4);
    for reach in [2_i32, 3, 5, 9] {
        for jitter in [0.0, 0.3] {
            let times: Vec<f64> = (-reach..=reach)
                .map(|k| 0.01 * (f64::from(k) + if k == 0 { 0.0 } else { jitter * (random.uniform() - 0.5) }))
                .collect();
            let window = Window::new(times.iter().copied(), 0.01 * f64::from(reach + 1));
            near(window.average.iter().sum(), 1.0, "sum");
            for power in 0..=4 {
                let second = |t: f64| f64::from(power * (power - 1)) * t.powi((power - 2).max(0));
                let mean: f64 = window.average.iter().zip(&times).map(|(h, t)| h * second(*t)).sum();
                let bent: f64 = window.curvature.iter().zip(&times).map(|(c, t)| c * t.powi(power)).sum();
                assert!((bent - mean).abs() < 1e-8 * (1.0 + mean.abs()), "{reach} {jitter} {power}: {bent} {mean}");
            }
        }
    }
    let kernel = Kernel::new(0.2, 0.02);
    let even: Vec<f64> = (0..11).map(|k| 3.0 + 0.02 * f64::from(k)).collect();
    assert_eq!(kernel.reach(), 5);
    assert_eq!(kernel.window(&even).average.len(), 11);
}
