//! How much to trust links and gyroscopes: estimated from the recording itself.

use alloc::vec::Vec;
use nalgebra::{ComplexField, Vector3};

use super::{
    arrowhead::Border,
    assemble::{Problem, State},
    keys::Key,
    marginals::Marginal,
    residual::{Drift, GYR_BIASES, Link},
};

/// Scales of the residuals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Scale σ of a link residual, m/s²: Student's t, each component.
    pub link_std: f64,
    /// What the gyroscopes' errors add up to, rad/√s: both sensors together, each component.
    pub drift_std: f64,
    /// Degrees of freedom ν of Student's t; small forgives outliers.
    pub tail: f64,
    /// What the curvature of a link's cost counts for as information; see [`trust`].
    pub trust: f64,
}

/// A drift is never trusted more than this, rad/√s: no gyroscope is that good.
const LEAST_DRIFT: f64 = 2e-5;
/// Nor a link more than this, m/s².
const LEAST_LINK: f64 = 1e-4;

impl Noise {
    /// Inverse variance of the drift from a key to the next.
    pub fn drift_precision(&self, key: &Key) -> f64 {
        1.0 / (self.drift_std * self.drift_std * key.span_s + key.lost_variance)
    }

    /// `(ν+3) ln(1 + u/ν)` with `u = ‖e‖² share/σ²`.
    pub fn link_cost(&self, square: f64, share: f64) -> f64 {
        let u = square * share / (self.link_std * self.link_std);
        self.trust * (self.tail + 3.0) * ComplexField::ln_1p(u / self.tail)
    }

    /// The derivative of [`Self::link_cost`] by `square`: `(ν+3)/(ν+u) share/σ²`.
    pub fn link_weight(&self, square: f64, share: f64) -> f64 {
        let scale = share / (self.link_std * self.link_std);
        self.trust * (self.tail + 3.0) / (self.tail + square * scale) * scale
    }

    /// σ that the link residuals ask for as though the unknowns were known: `3σ² = mean of (ν+3)/(ν+u)·‖e‖² share`.
    pub fn fit_links(&mut self, problem: &Problem, state: &State) {
        let squares: Vec<f64> = problem.links(state).map(|(e, share)| e.norm_squared() * share).collect();
        if squares.is_empty() {
            return;
        }
        let mut variance = squares.iter().sum::<f64>() / (3.0 * squares.len() as f64);
        for _ in 0..20 {
            let weighed = squares.iter().map(|s| (self.tail + 3.0) / (self.tail + s / variance) * s).sum::<f64>();
            variance = (weighed / (3.0 * squares.len() as f64)).max(LEAST_LINK * LEAST_LINK);
        }
        self.link_std = ComplexField::sqrt(variance);
    }

    /// Both scales as they are most probable with the orientations integrated out: each is the mean square of its residuals
    /// over what these leave free (MacKay's fixed point). `chain` holds the marginals at `state`, the constants known, and
    /// `absorbed` what the constants take; see [`absorbed`].
    pub fn update(&self, problem: &Problem, state: &State, chain: &[Marginal], absorbed: f64) -> Self {
        let (mut link, mut drift) = ((0.0, -absorbed), (0.0, 0.0));
        for (k, (key, w)) in problem.keys.iter().zip(&state.w).enumerate() {
            let Some(m) = chain.get(k) else { break };
            if key.share > 0.0 {
                let at = Link::at(key, w, &state.x);
                let weight = self.link_weight(at.residual.norm_squared(), key.share);
                link.0 += weight * at.residual.norm_squared();
                link.1 += 3.0 - weight * (at.turn * m.own * at.turn.transpose()).trace();
            }
            if let (true, Some(next), Some(after)) = (key.span_s > 0.0, chain.get(k + 1), state.w.get(k + 1)) {
                let precision = self.drift_precision(key);
                // Turns by lost samples say nothing of the gyroscopes.
                let own = precision * self.drift_std * self.drift_std * key.span_s;
                let residual = Drift::between(key, w, after, &problem.moved(&state.x)).residual;
                let spread = m.own.trace() + next.own.trace() - 2.0 * m.with_next.trace();
                drift.0 += own * precision * residual.norm_squared();
                drift.1 += own * (3.0 - precision * spread);
            }
        }
        Self {
            link_std: bounded(self.link_std, link).max(LEAST_LINK),
            drift_std: bounded(self.drift_std, drift).max(LEAST_DRIFT),
            ..*self
        }
    }

    /// Whether another estimate is the same for all that matters.
    pub fn close_to(&self, other: &Self) -> bool {
        let near = |a: f64, b: f64| ComplexField::abs(a - b) <= 0.02 * b;
        near(self.link_std, other.link_std) && near(self.drift_std, other.drift_std)
    }
}

/// `std·√(square/free)`, but no more than a factor of 3 away.
fn bounded(std: f64, (square, free): (f64, f64)) -> f64 {
    if free > 0.0 { std * ComplexField::sqrt((square / free).clamp(1.0 / 9.0, 9.0)) } else { std }
}

/// How many channels of links lever arms and accelerometer biases have fitted. One that the data determine takes one, one that
/// the prior holds none: `1 − (Λ Σ)_ii`, with Λ the precision beforehand and Σ the covariance of the constants. In a recording
/// of seconds it is much of all there is.
pub fn absorbed(problem: &Problem, covariance: &Border) -> f64 {
    let left = problem.prior.precision * covariance * problem.prior_weight;
    (0..GYR_BIASES).map(|i| (1.0 - left[(i, i)]).clamp(0.0, 1.0)).sum()
}

/// How many neighbouring links count as one, because their errors are alike: `1 + 2 Σ ρ(lag)` of their weighted residuals,
/// over lags until the correlation has died away.
pub fn alike(problem: &Problem, state: &State) -> f64 {
    let weighted = |(e, share): (Vector3<f64>, f64)| e * problem.noise.link_weight(e.norm_squared(), share);
    let scores: Vec<Vector3<f64>> = problem.links(state).map(weighted).collect();
    let product = |lag: usize| scores.iter().zip(scores.iter().skip(lag)).map(|(a, b)| a.dot(b)).sum::<f64>();
    let power = product(0);
    let mut sum = 1.0;
    for lag in 1..=MOST_LAGS {
        let rho = if power > 0.0 { product(lag) / power } else { 0.0 };
        if rho < LEAST_RHO {
            break;
        }
        sum += 2.0 * rho;
    }
    sum
}

/// Correlation is followed over at most so many links...
const MOST_LAGS: usize = 20;
/// ...and as long as it is at least this.
const LEAST_RHO: f64 = 0.05;

/// Where the unknowns fit next to everything, this part of the links is taken as free.
const LEAST_FREE: f64 = 1e-3;

/// What the curvature of a link's cost counts for as information, all links alike. With `w e` the slope of the cost, `E w`
/// its mean Gauss–Newton curvature, `A = E ∂(w e)/∂e` the true one and `B` the variance of the slope, an estimate has the
/// variance `B/A²`, not `1/E w` (the sandwich); and `alike` neighbours count as one.
pub fn trust(problem: &Problem, state: &State, chain: &[Marginal], absorbed: f64) -> f64 {
    let noise = Noise { trust: 1.0, ..problem.noise };
    let (mut slope, mut curvature, mut weights, mut free) = (0.0, 0.0, 0.0, 0.0);
    for ((key, w), m) in problem.keys.iter().zip(&state.w).zip(chain).filter(|((key, _), _)| key.share > 0.0) {
        let link = Link::at(key, w, &state.x);
        let square = link.residual.norm_squared();
        let weight = noise.link_weight(square, key.share);
        // ∂(w e)/∂e = w I + 2 w' e eᵀ with w' = −w²/(ν+3).
        curvature += 3.0 * weight - 2.0 * weight * weight * square / (noise.tail + 3.0);
        slope += weight * weight * square;
        weights += 3.0 * weight;
        free += 1.0 - weight * (link.turn * m.own * link.turn.transpose()).trace() / 3.0;
    }
    // Residuals have been fitted: what they left free tells how much larger errors are.
    let count = problem.links(state).count() as f64;
    let free = (free - absorbed / 3.0).max(LEAST_FREE * count);
    let slope = slope * count / free;
    let trust = curvature * curvature / (slope * weights) / alike(problem, state);
    if slope > 0.0 && free > 0.0 && curvature > 0.0 { trust.min(1.0) } else { 1.0 }
}
