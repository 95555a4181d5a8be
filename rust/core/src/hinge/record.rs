//! What a stream says of itself at one moment: estimate, rivals, and the witnesses that decisions are made from.

use alloc::vec::Vec;
use nalgebra::{ComplexField, Matrix6};

use super::{
    axes::AxisPair,
    cost::{HingeCost, Piece, Weights},
    evidence::{Evidence, offset_covariances},
    residual::gyr_residual,
    sign::PAIRING_DECIDED,
    solve::{Minimum, SolveOptions, refine},
};
use crate::{Xyz, so3::angle_between};

/// One estimate and everything that bears on whether to believe it.
#[derive(Clone, Debug)]
pub struct Record {
    /// Time of the latest sample, s.
    pub time_s: f64,
    /// The estimate first, then the other minima.
    pub minima: Vec<Minimum>,
    /// Covariances and residuals.
    pub evidence: Evidence,
    /// What gyroscope offsets do: see [`offset_covariances`].
    pub gyr_offset_covariance: Matrix6<f64>,
    /// What an acceleration offset does.
    pub acc_offset_covariance: Matrix6<f64>,
    /// How much more the opposite pairing leaves unexplained in planar motion (logarithm; see the module `sign`).
    pub pairing: f64,
    /// How much more the opposite pairing costs the accelerometers.
    pub acc_pairing: Contrast,
    /// The strongest other minimum that is neither close nor refuted by its pairing.
    pub rival: Option<Contrast>,
    /// What the moving instants say.
    pub witness: Witness,
    /// Gyroscope and accelerometer samples used.
    pub samples: (usize, usize),
}

/// One hypothesis against another by their costs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contrast {
    /// Mean difference of the cost over pieces of time in standard errors.
    pub significance: f64,
    /// Cost of the worse over cost of the better.
    pub ratio: f64,
}

/// Whether a hinge explains the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Witness {
    /// Rms of `‖ω1×j1‖ − ‖ω2×j2‖` over rms of `j2·ω2 − j1·ω1` over moving instants: of the whole past or of the recent, the
    /// larger. None without motion.
    pub misfit: Option<f64>,
    /// Rms of `j2·ω2 − j1·ω1` over moving instants, rad/s.
    pub relative_rate: f64,
    /// How long the joint has moved, s.
    pub moving_s: f64,
}

/// Minima farther from the estimate than this in one axis are rivals, rad (10°).
const RIVAL_ANGLE: f64 = 0.175;
/// Power of an acceleration residual that noise leaves anyway, (m/s²)².
const ACC_FLOOR: f64 = 0.01;

impl Record {
    /// The record of a stream at `time_s`.
    pub fn new(time_s: f64, cost: &HingeCost, minima: &[Minimum], pairing: f64, witness: Witness) -> Self {
        let axes = minima[0].axes;
        let other = axes.other_sign_pair();
        let acc = |axes: &AxisPair| cost.acc_pieces(axes, &axes.tangent()).collect::<Vec<_>>();
        let floor = cost.acc_count() as f64 * ACC_FLOOR * cost.acc_weight();
        let (gyr_offset_covariance, acc_offset_covariance) = offset_covariances(&axes, cost);
        Self {
            time_s,
            gyr_offset_covariance,
            acc_offset_covariance,
            minima: minima.to_vec(),
            evidence: Evidence::at(&axes, cost),
            pairing,
            acc_pairing: contrast(&acc(&axes), &acc(&other), floor),
            rival: rival(cost, minima, pairing),
            witness,
            samples: (cost.gyr_count(), cost.acc_count()),
        }
    }
}

/// The other minimum that is least significantly worse than the first.
fn rival(cost: &HingeCost, minima: &[Minimum], pairing: f64) -> Option<Contrast> {
    let pieces = |axes: &AxisPair| cost.pieces(axes, &axes.tangent());
    let axes = minima[0].axes;
    let best = pieces(&axes);
    let away = |a: &AxisPair| {
        let line = |x: f64| x.min(core::f64::consts::PI - x);
        line(angle_between(&a.j1, &axes.j1)).max(line(angle_between(&a.j2, &axes.j2)))
    };
    let opposite = |a: &AxisPair| a.j1.dot(&axes.j1) * a.j2.dot(&axes.j2) < 0.0;
    minima[1..]
        .iter()
        .filter(|m| away(&m.axes) > RIVAL_ANGLE && !(pairing > PAIRING_DECIDED && opposite(&m.axes)))
        .map(|m| contrast(&best, &pieces(&m.axes), 0.0))
        .min_by(|a, b| a.significance.total_cmp(&b.significance))
}

/// Costs of the same pieces of time under two hypotheses.
fn contrast(better: &[Piece], worse: &[Piece], floor: f64) -> Contrast {
    let difference = |(a, b): (&Piece, &Piece)| b.cost - a.cost;
    let (mut sum, mut squares) = (0.0, 0.0);
    for d in better.iter().zip(worse).map(difference) {
        sum += d;
        squares += d * d;
    }
    let total = |pieces: &[Piece]| pieces.iter().map(|p| p.cost).sum::<f64>() + floor;
    let (low, high) = (total(better), total(worse));
    Contrast {
        significance: if squares > 0.0 { sum / ComplexField::sqrt(squares) } else { 0.0 },
        ratio: if low > 0.0 { high / low } else { 1.0 },
    }
}

/// What moving instants say about `axes`: the whole past's, and the recent where there are enough.
pub fn witness<'a>(
    past: impl Iterator<Item = &'a [Xyz; 2]>,
    recent: Option<impl Iterator<Item = &'a [Xyz; 2]>>,
    moving_s: f64,
    axes: &AxisPair,
) -> Witness {
    let (misfit, relative_rate) = residual_and_rate(past, axes);
    let recent = recent.and_then(|recent| residual_and_rate(recent, axes).0);
    Witness { misfit: misfit.map(|m| recent.map_or(m, |r| m.max(r))), relative_rate, moving_s }
}

/// Misfit and rms relative rate over the given instants.
fn residual_and_rate<'a>(instants: impl Iterator<Item = &'a [Xyz; 2]>, axes: &AxisPair) -> (Option<f64>, f64) {
    let tangent = axes.tangent();
    let (mut residual, mut relative, mut count) = (0.0, 0.0, 0.0);
    for [gyr1, gyr2] in instants {
        let (gyr1, gyr2) = ((*gyr1).into(), (*gyr2).into());
        let e = gyr_residual(&gyr1, &gyr2, axes, &tangent).0;
        let rate = axes.j2.dot(&gyr2) - axes.j1.dot(&gyr1);
        residual += e * e;
        relative += rate * rate;
        count += 1.0;
    }
    let misfit = (relative > 0.0).then(|| ComplexField::sqrt(residual / relative));
    (misfit, if count > 0.0 { ComplexField::sqrt(relative / count) } else { 0.0 })
}

/// A hinge fitted to a few present instants alone, beside the axes that were believed before.
#[derive(Clone, Copy, Debug)]
pub struct Refit {
    /// Misfit of the present instants under the axes from before.
    pub misfit_before: f64,
    /// Misfit under their own axes.
    pub misfit: f64,
    /// Their own axes.
    pub axes: AxisPair,
    /// Covariance of these, residuals taken as correlated over about five instants, rad².
    pub covariance: Matrix6<f64>,
}

/// Fits present instants from where `before` says; None where they say nothing.
pub fn refit<'a>(present: impl Iterator<Item = &'a [Xyz; 2]> + Clone, before: &AxisPair) -> Option<Refit> {
    /// Residual that rounding and noise leave anyway, rad/s.
    const FLOOR: f64 = 0.02;
    let instants = present.clone().enumerate().map(|(k, [a, b])| (k as f64, a, b));
    let cost = HingeCost::new(Weights::published(1.0), instants, core::iter::empty());
    let fitted = *refine(&cost, &[*before], &SolveOptions::default()).best();
    let n = cost.gyr_count() as f64;
    let tangent = fitted.axes.tangent();
    let information = cost.gyr_normal_equations(&fitted.axes, &tangent).hessian;
    let variance = (fitted.cost / n + FLOOR * FLOOR) * 5.0;
    let basis = tangent.stacked();
    Some(Refit {
        misfit_before: residual_and_rate(present.clone(), before).0?,
        misfit: residual_and_rate(present, &fitted.axes).0?,
        axes: fitted.axes,
        covariance: basis * (super::evidence::inverse(information)? * variance) * basis.transpose(),
    })
}
