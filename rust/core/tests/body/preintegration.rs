//! Increments against a fine integration, derivatives by the biases against differences, covariance against Monte Carlo.

use imufast_core::{
    body::preintegration::{Preintegrated, Step},
    so3::log,
};
use nalgebra::{Rotation3, Vector3};

use crate::data::Random;

fn steps(random: &mut Random, count: usize, dt: f64) -> Vec<Step> {
    let (rate, force) = (random.vector(2.0), random.vector(6.0));
    (0..count).map(|_| Step { dt, gyr: rate + random.vector(0.5), acc: force + random.vector(1.0) }).collect()
}

fn integrated(steps: &[Step], gyr_bias: Vector3<f64>, acc_bias: Vector3<f64>) -> Preintegrated {
    let mut pre = Preintegrated::new(gyr_bias, acc_bias);
    steps.iter().for_each(|s| pre.push(s, 2e-3, 3e-2, 1e-3));
    pre
}

/// Rotation, velocity, position of `b` against `a`.
fn apart(a: &Preintegrated, b: &Preintegrated) -> [f64; 9] {
    let turn = log(&a.turn.tr_mul(&b.turn));
    let all = [turn, b.velocity - a.velocity, b.position - a.position];
    core::array::from_fn(|k| all[k / 3][k % 3])
}

#[test]
fn a_body_that_turns_steadily_and_falls_ends_where_it_must() {
    // Rate about z; a force that stands still in the world: Δv and Δp are those of constant acceleration.
    let (rate, force) = (Vector3::new(0.0, 0.0, 3.0), Vector3::new(1.0, -2.0, 0.5));
    let error = |count: usize| {
        let dt = 0.2 / count as f64;
        let mut pre = Preintegrated::new(Vector3::zeros(), Vector3::zeros());
        for n in 0..count {
            let middle = Rotation3::from_scaled_axis(rate * (dt * (n as f64 + 0.5)));
            pre.push(&Step { dt, gyr: rate, acc: middle.inverse() * force }, 1e-3, 1e-2, 1e-4);
        }
        assert!((pre.span_s - 0.2).abs() < 1e-12);
        assert!((pre.turn - Rotation3::from_scaled_axis(rate * 0.2).into_inner()).norm() < 1e-12);
        (pre.velocity - force * 0.2).norm() + (pre.position - force * 0.02).norm()
    };
    assert!(error(20) < 1e-12);
}

#[test]
fn pieces_make_the_whole() {
    let mut random = Random(3);
    let all = steps(&mut random, 20, 0.01);
    let none = Vector3::zeros();
    let (whole, first, second) =
        (integrated(&all, none, none), integrated(&all[..8], none, none), integrated(&all[8..], none, none));
    assert!((first.turn * second.turn - whole.turn).norm() < 1e-13);
    assert!((first.velocity + first.turn * second.velocity - whole.velocity).norm() < 1e-13);
    let position = first.position + first.velocity * second.span_s + first.turn * second.position;
    assert!((position - whole.position).norm() < 1e-13);
}

#[test]
fn derivatives_by_the_biases_are_differences() {
    let mut random = Random(4);
    for _ in 0..5 {
        let all = steps(&mut random, 10, 0.01);
        let (gyr, acc) = (random.vector(0.02), random.vector(0.2));
        let stated = integrated(&all, gyr, acc);
        let h = 1e-5;
        for c in 0..3 {
            let mut by = Vector3::zeros();
            by[c] = h;
            for (b, low, high) in [
                (0, integrated(&all, gyr - by, acc), integrated(&all, gyr + by, acc)),
                (1, integrated(&all, gyr, acc - by), integrated(&all, gyr, acc + by)),
            ] {
                let (low, high) = (apart(&stated, &low), apart(&stated, &high));
                for r in 0..3 {
                    let found = |k: usize| (high[k] - low[k]) / (2.0 * h);
                    let turn = if b == 0 { stated.turn_gyr[(r, c)] } else { 0.0 };
                    assert!((found(r) - turn).abs() < 1e-8, "{} {turn}", found(r));
                    assert!((found(3 + r) - stated.velocity_bias[b][(r, c)]).abs() < 1e-8);
                    assert!((found(6 + r) - stated.position_bias[b][(r, c)]).abs() < 1e-8);
                }
            }
        }
    }
}

#[test]
fn the_covariance_is_that_of_noisy_repetitions() {
    let mut random = Random(5);
    let dt = 0.01;
    let all = steps(&mut random, 10, dt);
    let none = Vector3::zeros();
    let (gyr_std, acc_std) = (2e-3, 3e-2);
    let mut truth = Preintegrated::new(none, none);
    all.iter().for_each(|s| truth.push(s, gyr_std, acc_std, 1e-12));
    let stated = truth.covariance();
    let repetitions = 4000;
    let mut sum = [[0.0; 9]; 9];
    for _ in 0..repetitions {
        let noisy: Vec<Step> = all
            .iter()
            .map(|s| Step {
                dt,
                gyr: s.gyr + random.vector(gyr_std / dt.sqrt()),
                acc: s.acc + random.vector(acc_std / dt.sqrt()),
            })
            .collect();
        let e = apart(&truth, &integrated(&noisy, none, none));
        for i in 0..9 {
            (0..9).for_each(|j| sum[i][j] += e[i] * e[j] / f64::from(repetitions));
        }
    }
    for i in 0..9 {
        for j in 0..9 {
            // Standard error of a covariance of 4000 draws is 1/45 of both standard deviations for Gaussians; 5 of them.
            let scale = (stated[i][i] * stated[j][j]).sqrt();
            assert!((sum[i][j] - stated[i][j]).abs() < 0.11 * scale, "({i}, {j}): {} {}", sum[i][j], stated[i][j]);
        }
    }
}

#[test]
fn whitening_makes_white_and_refuses_what_has_no_noise() {
    let mut random = Random(6);
    let pre = integrated(&steps(&mut random, 10, 0.01), Vector3::zeros(), Vector3::zeros());
    let (w, p) = (pre.whitening().expect("there is noise"), pre.covariance());
    for i in 0..9 {
        for j in 0..9 {
            let mut product = 0.0;
            for k in 0..9 {
                (0..9).for_each(|l| product += w[i][k] * p[k][l] * w[j][l]);
            }
            assert!((product - f64::from(u8::from(i == j))).abs() < 1e-8);
        }
    }
    let mut silent = Preintegrated::new(Vector3::zeros(), Vector3::zeros());
    silent.push(&Step { dt: 0.1, gyr: Vector3::zeros(), acc: Vector3::zeros() }, 0.0, 0.0, 0.0);
    assert!(silent.whitening().is_none());
}
