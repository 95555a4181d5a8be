//! SS (eq. 15) and SA (eq. 20): Newton steps with backtracking on the logarithm of the cost, which needs no scale of the
//! residuals to be weighed against what is known beforehand.

use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

use super::{
    Matrix12, Unknowns,
    loss::Loss,
    moments::Moments,
    residual::{Sums, sums},
};

/// What is minimised.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// The sum of squares (eq. 15).
    Squares,
    /// Squares of small residuals, absolute values of large ones (Huber).
    Huber,
    /// The sum of absolute values (eq. 20).
    Absolute,
}

/// What is known before the samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Knowledge {
    /// Standard deviation of an accelerometer bias, m/s²; 0: there are none, as published.
    pub bias_std: f64,
    /// Standard deviation of a lever arm, m; infinite: nothing known, as published.
    pub lever_std: f64,
    /// Neighbouring residuals of which so many tell as much as one alone.
    pub correlated: f64,
    /// Standard deviation of each gyroscope bias channel, rad/s: not estimated, but considered in the covariance.
    pub gyr_bias_std: f64,
}

impl Knowledge {
    /// As published: no biases, nothing known of the lever arms.
    pub const PUBLISHED: Self = Self { bias_std: 0.0, lever_std: f64::INFINITY, correlated: 1.0, gyr_bias_std: 0.0 };

    pub(crate) fn biases(&self) -> bool {
        self.bias_std > 0.0
    }

    /// Information of each unknown.
    pub(crate) fn information(&self) -> Unknowns {
        let inverse = |std: f64| if std > 0.0 { 1.0 / (std * std) } else { 0.0 };
        Unknowns::from_fn(|k, _| inverse(if k < 6 { self.lever_std } else { self.bias_std }))
    }
}

/// Why a descent ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Status {
    /// No step is left that would gain anything.
    Converged,
    /// No shorter step lowered the cost, though one was predicted to.
    Stalled,
    /// The iterations ran out.
    MaxIterations,
    /// The cost is not a finite number: the data overflow.
    NumericalError,
    /// The caller asked to stop.
    Interrupted,
}

/// Where a descent ended.
#[derive(Clone, Copy, Debug)]
pub struct Solution {
    /// The minimum.
    pub x: Unknowns,
    /// Sum of `e²` (SS), of Huber's costs, or of `|e|` (SA) there, (m/s²)² or m/s².
    pub cost: f64,
    /// Minus the logarithm of the likelihood, up to a constant.
    pub merit: f64,
    /// Why the descent ended.
    pub status: Status,
    /// Newton steps over all samples.
    pub iterations: usize,
    /// The loss at the end: its threshold or smoothing, m/s².
    pub loss: Loss,
}

/// A cost over samples, and the subspace in which it is minimised.
#[derive(Clone, Copy)]
pub struct Problem<'a> {
    /// The samples.
    pub moments: &'a Moments,
    /// What is known beforehand.
    pub knowledge: Knowledge,
    /// Projector on the directions that are free; the others keep their value.
    pub free: Matrix12,
    /// Most Newton steps.
    pub max_iterations: usize,
}

/// Below this a residual is rounding, m/s²: keeps the logarithm of a perfect fit finite.
const ROUNDING: f64 = 1e-12;
/// Newton steps end where the next would gain less than this in log-likelihood: a hundredth of a standard deviation.
const GAIN: f64 = 5e-5;
/// SA ends where smoothing is proved to cost less than this share.
const SMOOTHING_GAIN: f64 = 2e-7;
/// By so much the smoothing shrinks at a time.
const SMOOTHING_STEP: f64 = 0.2;
/// See [`Loss::Absolute`].
const MAJORISING_SHARE: f64 = 0.02;
/// Huber's threshold in standard deviations of a Gaussian: 95 % efficient (Huber 1981).
const HUBER: f64 = 1.345;

struct Point {
    /// Log-likelihood up to sign and constant.
    merit: f64,
    gradient: Unknowns,
    hessian: Matrix12,
    sums: Sums,
}

impl<'a> Problem<'a> {
    fn evaluate(&self, x: &Unknowns, loss: Loss) -> Point {
        let sums = sums(self.moments, x, loss, self.knowledge.biases());
        let count = self.moments.len() as f64;
        let information = self.knowledge.information();
        let effective = count / (loss.power() * self.knowledge.correlated);
        let cost = sums.cost + count * loss.of(ROUNDING).0;
        let weight = effective / cost;
        let pull = information.component_mul(x);
        let mut hessian = sums.hessian * weight;
        (0..12).for_each(|k| hessian[(k, k)] += information[k]);
        Point {
            merit: effective * ComplexField::ln(cost) + 0.5 * x.dot(&pull),
            gradient: self.free * (sums.gradient * weight + pull),
            hessian,
            sums,
        }
    }

    /// The Newton step within the free subspace.
    fn step(&self, point: &Point) -> Option<Unknowns> {
        let held = Matrix12::identity() - self.free;
        let scale = point.hessian.trace();
        let hessian = self.free * point.hessian * self.free + held * scale;
        // A trace of damping leaves alone what nothing depends on.
        let step =
            -(hessian + Matrix12::identity() * (1e-12 * scale).max(f64::MIN_POSITIVE)).cholesky()?.solve(&point.gradient);
        Some(self.free * step)
    }

    /// Descends from `x`, until `tolerance` in log-likelihood.
    fn descend(&self, x: Unknowns, loss: Loss, tolerance: f64, left: &mut Left<'_>) -> (Unknowns, Point, Status) {
        let mut x = x;
        let mut here = self.evaluate(&x, loss);
        loop {
            if !here.merit.is_finite() {
                return (x, here, Status::NumericalError);
            }
            // A perfect fit leaves nothing but rounding to descend on.
            if here.sums.absolute <= self.moments.len() as f64 * ROUNDING {
                return (x, here, Status::Converged);
            }
            let Some(step) = self.step(&here) else { return (x, here, Status::NumericalError) };
            let predicted = -here.gradient.dot(&step);
            if predicted <= tolerance {
                return (x, here, Status::Converged);
            }
            if let Some(end) = left.spend() {
                return (x, here, end);
            }
            match self.backtrack(&x, &here, &step, predicted, loss) {
                Some((next, there)) => (x, here) = (next, there),
                // Near the floor of rounding the cost cannot tell the points apart: that is the minimum.
                None if predicted <= 1e-6 => return (x, here, Status::Converged),
                None => return (x, here, Status::Stalled),
            }
        }
    }

    /// Halves the step until the merit falls by a share of what the gradient promises (Armijo).
    fn backtrack(&self, x: &Unknowns, here: &Point, step: &Unknowns, predicted: f64, loss: Loss) -> Option<(Unknowns, Point)> {
        let mut alpha = 1.0;
        for _ in 0..30 {
            let next = x + step * alpha;
            let there = self.evaluate(&next, loss);
            if there.merit <= here.merit - 1e-4 * alpha * predicted {
                return Some((next, there));
            }
            alpha *= 0.5;
        }
        None
    }

    /// The minimum of `method` near `start`.
    pub fn minimise(&self, method: Method, start: Unknowns, go_on: &mut dyn FnMut() -> bool) -> Solution {
        self.follow(method, start, &mut Left { steps: self.max_iterations, used: 0, go_on })
    }

    fn follow(&self, method: Method, start: Unknowns, left: &mut Left<'_>) -> Solution {
        let end = |(x, point, status): (Unknowns, Point, Status), loss: Loss, left: &Left<'_>| Solution {
            x,
            cost: if let Loss::Absolute(..) = loss { point.sums.absolute } else { 2.0 * point.sums.cost },
            merit: point.merit,
            status,
            iterations: left.used,
            loss,
        };
        let count = self.moments.len() as f64;
        let squares = Loss::Square;
        // Robust losses start from the valley of the squares: these need no scale.
        let rough = if method == Method::Squares { GAIN } else { 1e-2 * count / self.knowledge.correlated };
        let first = self.descend(start, squares, rough, left);
        let ended = |status: Status| !matches!(status, Status::Converged | Status::Stalled);
        if method == Method::Squares || ended(first.2) {
            return end(first, squares, left);
        }
        let mean = first.1.sums.absolute / count.max(1.0);
        if method == Method::Huber {
            // 1.4826 × the median would be the robust scale; of a Gaussian the mean tells the same, and once more from a
            // robust fit it does so of heavier tails.
            let mut reached = first;
            let mut loss = Loss::Huber(HUBER * 1.2533 * mean + ROUNDING);
            for _ in 0..2 {
                reached = self.descend(reached.0, loss, GAIN, left);
                if ended(reached.2) {
                    break;
                }
                loss = Loss::Huber(HUBER * 1.2533 * reached.1.sums.absolute / count.max(1.0) + ROUNDING);
            }
            return end(reached, loss, left);
        }
        let mut epsilon = mean.max(ROUNDING);
        let mut x = first.0;
        loop {
            let loss = Loss::Absolute(epsilon, MAJORISING_SHARE);
            let reached = self.descend(x, loss, GAIN.max(1e-6 * count * epsilon / mean.max(ROUNDING)), left);
            // √(e²+ε²) exceeds |e| by no more than ε: so far may the cost be from that of the sharp minimum.
            let excess = reached.1.sums.cost - reached.1.sums.absolute;
            let sharp = excess <= SMOOTHING_GAIN * reached.1.sums.absolute || epsilon <= ROUNDING;
            if ended(reached.2) || sharp {
                return end(reached, loss, left);
            }
            x = reached.0;
            epsilon *= SMOOTHING_STEP;
        }
    }
}

/// How many steps are left, and whether the caller wants to go on.
struct Left<'a> {
    steps: usize,
    used: usize,
    go_on: &'a mut dyn FnMut() -> bool,
}

impl Left<'_> {
    fn spend(&mut self) -> Option<Status> {
        if self.used >= self.steps {
            return Some(Status::MaxIterations);
        }
        self.used += 1;
        (!(self.go_on)()).then_some(Status::Interrupted)
    }
}
