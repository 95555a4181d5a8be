//! Algorithm 1: Gauss–Newton with backtracking on the tangent planes of the two axes, sign-pair re-initialisation (eqs 28–30),
//! and all distinct minima.

use alloc::vec::Vec;
use core::cell::Cell;
use nalgebra::{Matrix3, Matrix4, SymmetricEigen, Vector3, Vector4};
use serde::{Deserialize, Serialize};

use super::{axes::AxisPair, cost::HingeCost, residual::NormalEquations};
use crate::so3::angle_between;

/// Why a descent ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Status {
    /// The next step would be shorter than the tolerance, or gain less than rounding.
    Converged,
    /// No shorter step lowered the cost, though one was predicted to.
    Stalled,
    /// The iterations ran out.
    MaxIterations,
    /// Nothing in the data depends on the axis.
    NotIdentifiable,
    /// The cost is not a finite number: the data overflow.
    NumericalError,
    /// The caller asked to stop.
    Interrupted,
}

/// How to descend.
#[derive(Clone, Copy, Debug)]
pub struct SolveOptions {
    /// Gauss–Newton iterations of one descent.
    pub max_iterations: usize,
    /// A descent has converged when its next step is shorter than this, rad.
    pub step_tolerance: f64,
    /// A descent has converged, too, when its next step would gain less than this share of the cost.
    pub gain_tolerance: f64,
    /// Find the valleys on few samples first, then walk to their bottom on all.
    pub coarse_first: bool,
    /// Minima closer than this in both axes, up to the common sign, are one, rad.
    pub distinct_angle: f64,
}

impl Default for SolveOptions {
    fn default() -> Self {
        Self { max_iterations: 300, step_tolerance: 1e-7, gain_tolerance: 1e-15, coarse_first: true, distinct_angle: 0.03 }
    }
}

/// A local minimum of the cost.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Minimum {
    /// Canonical in its overall sign.
    pub axes: AxisPair,
    /// V of eq. 23.
    pub cost: f64,
    /// Why the descent ended.
    pub status: Status,
    /// Gauss–Newton iterations of this descent.
    pub iterations: usize,
}

/// Every distinct minimum found, best first; never empty.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Sorted by cost.
    pub minima: Vec<Minimum>,
    /// Gauss–Newton iterations of all descents together.
    pub iterations: usize,
}

impl Solution {
    /// The minimum with the smallest cost.
    pub fn best(&self) -> &Minimum {
        &self.minima[0]
    }
}

/// Descends from every start and from the opposite sign pairing of where that ended (eqs 28–29), and returns all distinct
/// minima. `go_on` is asked before each iteration; where it says no, what was found so far comes back with the status
/// [`Status::Interrupted`].
pub fn solve(cost: &HingeCost, starts: &[AxisPair], options: &SolveOptions, go_on: &mut dyn FnMut() -> bool) -> Solution {
    if !cost.is_finite() {
        let axes = AxisPair::new(Vector3::x(), Vector3::x());
        let overflow = Minimum { axes, cost: f64::INFINITY, status: Status::NumericalError, iterations: 0 };
        return Solution { minima: alloc::vec![overflow], iterations: 0 };
    }
    let few = COARSE_SAMPLES.max(cost.gyr_count() / COARSE_SHARE);
    if !options.coarse_first || cost.gyr_count() < 2 * few {
        return descend_all(cost, starts, options, go_on);
    }
    let coarse = descend_all(&cost.thinned(few), starts, options, go_on);
    if coarse.best().status == Status::Interrupted {
        return coarse;
    }
    let starts: Vec<AxisPair> = coarse.minima.iter().map(|m| m.axes).collect();
    let mut found = descend_all(cost, &starts, options, go_on);
    found.iterations += coarse.iterations;
    found
}

/// The coarse walk sees at least this many gyroscope samples...
const COARSE_SAMPLES: usize = 256;
/// ...and at least one in so many, so that a rare movement in a long recording still shapes its valleys.
const COARSE_SHARE: usize = 8;

fn descend_all(cost: &HingeCost, starts: &[AxisPair], options: &SolveOptions, go_on: &mut dyn FnMut() -> bool) -> Solution {
    let mut found = Solution { minima: Vec::new(), iterations: 0 };
    // A "no" stands, whatever is answered later.
    let stopped = Cell::new(false);
    let mut go_on = || {
        stopped.set(stopped.get() || !go_on());
        !stopped.get()
    };
    let first = [AxisPair::new(Vector3::x(), Vector3::x())];
    for start in if starts.is_empty() { &first } else { starts } {
        let end = descend_unless_known(cost, *start, options, &mut found, &mut go_on);
        descend_unless_known(cost, end.other_sign_pair(), options, &mut found, &mut go_on);
        if stopped.get() {
            found.minima.iter_mut().for_each(|m| m.status = Status::Interrupted);
            break;
        }
    }
    found.minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    found
}

/// Descends from every start on all samples, without the opposite pairings: follows valleys that are known already.
pub fn refine(cost: &HingeCost, starts: &[AxisPair], options: &SolveOptions) -> Solution {
    let mut found = Solution { minima: Vec::new(), iterations: 0 };
    for start in starts {
        descend_unless_known(cost, *start, options, &mut found, &mut || true);
    }
    found.minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    found
}

/// One descent; its minimum is added to `found` unless the descent comes so close to a known one that it would end there.
fn descend_unless_known(
    cost: &HingeCost,
    start: AxisPair,
    options: &SolveOptions,
    found: &mut Solution,
    go_on: &mut dyn FnMut() -> bool,
) -> AxisPair {
    let known = |axes: &AxisPair, minima: &[Minimum]| minima.iter().any(|m| same_axes(axes, &m.axes, options.distinct_angle));
    let mut axes = start;
    if known(&axes, &found.minima) {
        return axes;
    }
    let mut here = evaluate(cost, &axes);
    let mut status = Status::MaxIterations;
    let mut iterations = 0;
    while iterations < options.max_iterations {
        if !go_on() {
            status = Status::Interrupted;
            break;
        }
        let (normal, _) = &here;
        if !normal.half_cost.is_finite() {
            status = Status::NumericalError;
            break;
        }
        let Some(step) = gauss_newton_step(normal) else {
            status = Status::NotIdentifiable;
            break;
        };
        let predicted = -normal.gradient.dot(&step);
        if step.norm() < options.step_tolerance || predicted <= options.gain_tolerance * normal.half_cost {
            status = Status::Converged;
            break;
        }
        iterations += 1;
        found.iterations += 1;
        match backtrack(cost, &axes, &here, &step, predicted) {
            Some((next, there)) => {
                axes = next;
                here = there;
                if known(&axes, &found.minima) {
                    return axes;
                }
            }
            None => {
                // Near the floor of rounding the cost cannot tell the points apart: that is the minimum.
                status = if predicted <= 1e-9 * here.0.half_cost { Status::Converged } else { Status::Stalled };
                break;
            }
        }
    }
    if !known(&axes, &found.minima) {
        found.minima.push(Minimum { axes: axes.canonical(), cost: 2.0 * here.0.half_cost, status, iterations });
    }
    axes
}

type Point = (NormalEquations, super::axes::Tangent);

fn evaluate(cost: &HingeCost, axes: &AxisPair) -> Point {
    let tangent = axes.tangent();
    (cost.normal_equations(axes, &tangent), tangent)
}

/// Solves `JᵀJ δ = −Jᵀe` with a trace of damping, so that a direction that nothing depends on is left alone.
fn gauss_newton_step(normal: &NormalEquations) -> Option<Vector4<f64>> {
    let damping = 1e-12 * normal.hessian.trace();
    let step = -(normal.hessian + Matrix4::identity() * damping).cholesky()?.solve(&normal.gradient);
    // The tangent plane is a map of the sphere near its foot only.
    let longest = step.norm();
    Some(if longest > 1.0 { step / longest } else { step })
}

/// Halves the step until the cost falls by a share of what the gradient promises (Armijo).
fn backtrack(
    cost: &HingeCost,
    axes: &AxisPair,
    here: &Point,
    step: &Vector4<f64>,
    predicted: f64,
) -> Option<(AxisPair, Point)> {
    let mut alpha = 1.0;
    for _ in 0..30 {
        let next = axes.step(&here.1, &(step * alpha));
        let there = evaluate(cost, &next);
        if there.0.half_cost <= here.0.half_cost - 1e-4 * alpha * predicted {
            return Some((next, there));
        }
        alpha *= 0.5;
    }
    None
}

/// Whether two pairs are one hinge: both axes within `angle`, the overall sign free.
pub fn same_axes(a: &AxisPair, b: &AxisPair, angle: f64) -> bool {
    let apart = |b: &AxisPair| angle_between(&a.j1, &b.j1).max(angle_between(&a.j2, &b.j2));
    apart(b) < angle || apart(&b.flipped()) < angle
}

/// Four starts that need no luck: the two weakest directions of the accelerometers' Gram matrix, the principal axes of the
/// two gyroscopes, and those over the samples where the one or the other sensor turns faster.
pub fn deterministic_starts(cost: &HingeCost) -> [AxisPair; 4] {
    if !cost.is_finite() {
        return [AxisPair::new(Vector3::x(), Vector3::x()); 4];
    }
    let gram = SymmetricEigen::new(*cost.acc_gram());
    let mut order = [0, 1, 2, 3, 4, 5];
    order.sort_by(|&a: &usize, &b| gram.eigenvalues[a].total_cmp(&gram.eigenvalues[b]));
    let weakest = |rank: usize| {
        let v = gram.eigenvectors.column(order[rank]);
        AxisPair::new(v.fixed_rows::<3>(0).into(), v.fixed_rows::<3>(3).into())
    };
    let mut whole = [Matrix3::zeros(); 2];
    let mut faster = [Matrix3::zeros(); 2];
    // Directions need no more samples than the coarse walk.
    for (gyr1, gyr2) in cost.gyr_samples().step_by((cost.gyr_count() / COARSE_SAMPLES).max(1)) {
        let (outer1, outer2) = (gyr1 * gyr1.transpose(), gyr2 * gyr2.transpose());
        whole[0] += outer1;
        whole[1] += outer2;
        if gyr1.norm_squared() > gyr2.norm_squared() { faster[0] += outer1 } else { faster[1] += outer2 }
    }
    [
        weakest(0),
        weakest(1),
        AxisPair::new(principal(whole[0]), principal(whole[1])),
        AxisPair::new(principal(faster[0]), principal(faster[1])),
    ]
}

/// Eigenvector of the largest eigenvalue.
fn principal(m: Matrix3<f64>) -> Vector3<f64> {
    let e = SymmetricEigen::new(m);
    e.eigenvectors.column(e.eigenvalues.imax()).into()
}
