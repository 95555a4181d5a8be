//! The cost V (eqs 22–25): which samples, with which weights, and what each piece of time adds.

use alloc::vec::Vec;
use nalgebra::{ComplexField, Matrix4x6, Matrix6, Vector3, Vector4, Vector6};
use serde::{Deserialize, Serialize};

use super::{
    axes::{AxisPair, Tangent, stack},
    residual::{NormalEquations, acc_row, gyr_normal_equations, gyr_residual},
};
use crate::Xyz;

/// Samples closer in time than this are one *piece*, s. The residuals of a piece share their causes (one movement, one
/// bias), so a piece counts as one observation where uncertainty is judged.
pub const PIECE_S: f64 = 1.0;

/// The cost V of eqs 22–25 over a set of gyroscope samples and a set of accelerometer samples.
///
/// The gyroscope samples are kept; of the accelerometer samples only, for each piece of time, the 6×6 Gram matrix `AᵀA` of
/// eq. 27, since `Σ e_a² = w_a² jᵀ(AᵀA)j`.
#[derive(Clone, Debug)]
pub struct HingeCost {
    /// x, y, z of sensor 1, then of sensor 2: one vector each, so that many samples are handled side by side.
    gyr: [Vec<f64>; 6],
    /// Number of each piece and the sample at which it starts.
    gyr_pieces: Vec<(f64, usize)>,
    /// `Σ w² (‖ω1‖ − ‖ω2‖)²`: the gyroscope residual without any axis.
    plain_energy: f64,
    acc_gram: Matrix6<f64>,
    acc_sum: Vector6<f64>,
    acc_count: usize,
    acc_pieces: Vec<AccPiece>,
    weights: Weights,
}

/// The accelerometer rows of one piece of time.
#[derive(Clone, Copy, Debug)]
struct AccPiece {
    number: f64,
    gram: Matrix6<f64>,
    sum: Vector6<f64>,
}

/// How the residuals are weighted against each other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Weights {
    /// `w_0` of eq. 70: `w_ω² = w_0`, `w_a² = 1/w_0`.
    pub ratio: f64,
    /// What a gyroscope residual gets wrong grows with the rates (scale factors, soft tissue, timing), so it counts
    /// `c/(c + ‖ω1‖ + ‖ω2‖)` with this c, rad/s; infinite: all alike, as published.
    pub rate_scale: f64,
    /// The accelerations along the axis may differ by a constant (their biases), known beforehand to be no larger than what
    /// so many samples would tell; infinite: by nothing, as published.
    pub offset_prior: f64,
}

impl Weights {
    /// As published: eq. 70 and nothing else.
    pub fn published(ratio: f64) -> Self {
        Self { ratio, rate_scale: f64::INFINITY, offset_prior: f64::INFINITY }
    }

    /// What the sum of so many residuals is multiplied with to give the constant difference.
    fn mean_share(&self, count: usize) -> f64 {
        let weight = count as f64 + self.offset_prior;
        if weight > 0.0 { 1.0 / weight } else { 0.0 }
    }
}

impl HingeCost {
    /// The cost over simultaneous angular rates `(time, ω1, ω2)` (s, rad/s) and accelerations `(time, a1, a2)` (s, m/s²), each
    /// in the order of time.
    pub fn new<'a>(
        weights: Weights,
        gyr: impl Iterator<Item = (f64, &'a Xyz, &'a Xyz)>,
        acc: impl Iterator<Item = (f64, &'a Xyz, &'a Xyz)>,
    ) -> Self {
        let (mut gyr, mut acc) = (gyr.peekable(), acc.peekable());
        let origin = gyr.peek().map_or(f64::INFINITY, |g| g.0).min(acc.peek().map_or(f64::INFINITY, |a| a.0));
        let piece_of = |time: f64| ComplexField::floor((time - origin) / PIECE_S);
        let mut channels: [Vec<f64>; 6] = Default::default();
        let (least, most) = gyr.size_hint();
        channels.iter_mut().for_each(|channel| channel.reserve(most.unwrap_or(least)));
        let mut plain_energy = 0.0;
        let mut gyr_pieces: Vec<(f64, usize)> = Vec::new();
        for (time, gyr1, gyr2) in gyr {
            let piece = piece_of(time);
            if gyr_pieces.last().is_none_or(|last| last.0 != piece) {
                gyr_pieces.push((piece, channels[0].len()));
            }
            let (rate1, rate2) = (norm(gyr1), norm(gyr2));
            let weight =
                if weights.rate_scale.is_finite() { weights.rate_scale / (weights.rate_scale + rate1 + rate2) } else { 1.0 };
            let difference = weight * (rate1 - rate2);
            plain_energy += difference * difference;
            // The residual is homogeneous in the rates: weighted rates give the weighted residual.
            for (k, channel) in channels.iter_mut().enumerate() {
                channel.push(weight * if k < 3 { gyr1[k] } else { gyr2[k - 3] });
            }
        }
        let mut acc_pieces: Vec<AccPiece> = Vec::new();
        let mut acc_count = 0;
        for (time, acc1, acc2) in acc {
            let number = piece_of(time);
            if acc_pieces.last().is_none_or(|last| last.number != number) {
                acc_pieces.push(AccPiece { number, gram: Matrix6::zeros(), sum: Vector6::zeros() });
            }
            let row = acc_row(acc1, acc2);
            if let Some(piece) = acc_pieces.last_mut() {
                piece.gram += row * row.transpose();
                piece.sum += row;
            }
            acc_count += 1;
        }
        let gram: Matrix6<f64> = acc_pieces.iter().map(|piece| piece.gram).sum();
        let acc_sum: Vector6<f64> = acc_pieces.iter().map(|piece| piece.sum).sum();
        Self {
            gyr: channels,
            gyr_pieces,
            plain_energy,
            acc_gram: gram - acc_sum * acc_sum.transpose() * weights.mean_share(acc_count),
            acc_sum,
            acc_count,
            acc_pieces,
            weights,
        }
    }

    /// `w_ω²` and `w_a²`.
    fn squared_weights(&self) -> (f64, f64) {
        (self.weights.ratio, 1.0 / self.weights.ratio)
    }

    /// `w_a²`.
    pub fn acc_weight(&self) -> f64 {
        self.squared_weights().1
    }

    /// The best constant difference of the accelerations along the axes, m/s²; zero as published.
    pub fn acc_offset(&self, axes: &AxisPair) -> f64 {
        stack(axes).dot(&self.acc_sum) * self.weights.mean_share(self.acc_count)
    }

    /// Whether every cost will be a finite number: the data are finite and do not overflow.
    pub fn is_finite(&self) -> bool {
        self.plain_energy.is_finite() && self.acc_gram.iter().all(|x| x.is_finite())
    }

    /// Rms of the gyroscope residual at `axes` over the rms of the plain difference of the two rates: near 1 or above, the axes
    /// explain nothing. Infinite where the sensors do not turn.
    pub fn unexplained(&self, axes: &AxisPair) -> f64 {
        if self.plain_energy > 0.0 {
            ComplexField::sqrt(2.0 * self.gyr_normal_equations(axes, &axes.tangent()).half_cost / self.plain_energy)
        } else {
            f64::INFINITY
        }
    }

    /// Number of gyroscope samples.
    pub fn gyr_count(&self) -> usize {
        self.gyr[0].len()
    }

    /// Number of accelerometer samples.
    pub fn acc_count(&self) -> usize {
        self.acc_count
    }

    /// `AᵀA` of eq. 27 (6×6), less what the constant difference explains.
    pub fn acc_gram(&self) -> &Matrix6<f64> {
        &self.acc_gram
    }

    /// Sum of the squares of the accelerometer residuals as published (eq. 25, unweighted, no constant difference).
    pub fn acc_squares(&self, axes: &AxisPair) -> f64 {
        let j = stack(axes);
        self.acc_pieces.iter().map(|piece| j.dot(&(piece.gram * j))).sum()
    }

    /// The gyroscope samples in the order they came, each times its rate weight.
    pub fn gyr_samples(&self) -> impl Iterator<Item = (Vector3<f64>, Vector3<f64>)> + '_ {
        let [x1, y1, z1, x2, y2, z2] = &self.gyr;
        let one = x1.iter().zip(y1).zip(z1).map(|((x, y), z)| Vector3::new(*x, *y, *z));
        let two = x2.iter().zip(y2).zip(z2).map(|((x, y), z)| Vector3::new(*x, *y, *z));
        one.zip(two)
    }

    /// The same cost on evenly spaced gyroscope samples, about `count` of them, and the accelerometers' at the same share: a
    /// map of the same valleys that is cheaper to walk.
    pub fn thinned(&self, count: usize) -> Self {
        let stride = (self.gyr_count() / count.max(1)).max(1);
        let gyr = self.gyr.each_ref().map(|channel| channel.iter().step_by(stride).copied().collect());
        Self { gyr, gyr_pieces: Vec::new(), acc_gram: self.acc_gram / stride as f64, acc_pieces: Vec::new(), ..*self }
    }

    /// Cost, gradient and Gauss–Newton Hessian of both parts at `axes`, weighted.
    pub fn normal_equations(&self, axes: &AxisPair, tangent: &Tangent) -> NormalEquations {
        self.weighted(&self.gyr_normal_equations(axes, tangent), &self.acc_normal_equations(axes, tangent))
    }

    /// The sum of both parts with their weights.
    pub fn weighted(&self, gyr: &NormalEquations, acc: &NormalEquations) -> NormalEquations {
        let (wg, wa) = self.squared_weights();
        NormalEquations {
            half_cost: wg * gyr.half_cost + wa * acc.half_cost,
            sum: 0.0, // of unlike kinds it has no meaning
            gradient: gyr.gradient * wg + acc.gradient * wa,
            hessian: gyr.hessian * wg + acc.hessian * wa,
        }
    }

    /// The gyroscope part (eqs 24, 36–37) without its weight.
    pub fn gyr_normal_equations(&self, axes: &AxisPair, tangent: &Tangent) -> NormalEquations {
        gyr_normal_equations(self.gyr.each_ref().map(Vec::as_slice), axes, tangent)
    }

    /// The accelerometer part (eqs 25, 39) without its weight, from the Gram matrix alone.
    pub fn acc_normal_equations(&self, axes: &AxisPair, tangent: &Tangent) -> NormalEquations {
        let j = stack(axes);
        let basis = tangent.stacked();
        let gram_j = self.acc_gram * j;
        NormalEquations {
            half_cost: 0.5 * j.dot(&gram_j),
            sum: j.dot(&self.acc_sum),
            gradient: basis.transpose() * gram_j,
            hessian: basis.transpose() * self.acc_gram * basis,
        }
    }

    /// What each piece of time adds: to the cost and, as weighted scores `Σ w² J e`, to the gradient; in order.
    pub fn pieces(&self, axes: &AxisPair, tangent: &Tangent) -> Vec<Piece> {
        let wg = self.squared_weights().0;
        let ends = self.gyr_pieces.iter().skip(1).map(|p| p.1).chain([self.gyr_count()]);
        let gyr = self.gyr_pieces.iter().zip(ends).map(|(&(number, start), end)| {
            let samples = self.gyr.each_ref().map(|channel| &channel[start..end]);
            let normal = gyr_normal_equations(samples, axes, tangent);
            Piece { number, cost: 2.0 * wg * normal.half_cost, score: normal.gradient * wg }
        });
        let mut all: Vec<Piece> = gyr.chain(self.acc_pieces(axes, tangent)).collect();
        all.sort_by(|a, b| a.number.total_cmp(&b.number));
        let join = |piece: &[Piece]| Piece {
            number: piece[0].number,
            cost: piece.iter().map(|p| p.cost).sum(),
            score: piece.iter().map(|p| p.score).sum(),
        };
        all.chunk_by(|a, b| a.number == b.number).map(join).collect()
    }

    /// What the accelerometer rows of each piece of time add.
    pub fn acc_pieces(&self, axes: &AxisPair, tangent: &Tangent) -> impl Iterator<Item = Piece> + '_ {
        let wa = self.squared_weights().1;
        let (j, basis, offset) = (stack(axes), tangent.stacked(), self.acc_offset(axes));
        self.acc_pieces.iter().map(move |piece| {
            let gram_j = piece.gram * j;
            Piece {
                number: piece.number,
                cost: wa * (j.dot(&gram_j) - offset * j.dot(&piece.sum)),
                score: basis.transpose() * (gram_j - piece.sum * offset) * wa,
            }
        })
    }

    /// How the gradient answers to constant offsets: of the six gyroscope channels (4×6, per rad/s) and of the difference of
    /// the accelerations along the axis (4, per m/s²).
    pub fn offset_sensitivity(&self, axes: &AxisPair, tangent: &Tangent) -> (Matrix4x6<f64>, Vector4<f64>) {
        let mut gyr = Matrix4x6::zeros();
        for (gyr1, gyr2) in self.gyr_samples() {
            // w = c/(c + n) from the weighted n' = w n.
            let weight = 1.0 - (gyr1.norm() + gyr2.norm()) / self.weights.rate_scale;
            let (_, jac) = gyr_residual(&gyr1, &gyr2, axes, tangent);
            let across = |gyr: &Vector3<f64>, b: &nalgebra::Matrix3x2<f64>| {
                let p = b * (b.transpose() * gyr);
                p.try_normalize(1e-150).unwrap_or_default()
            };
            let (d1, d2) = (across(&gyr1, &tangent.b1), across(&gyr2, &tangent.b2));
            let response = Vector6::new(d1.x, d1.y, d1.z, -d2.x, -d2.y, -d2.z) * (weight * self.squared_weights().0);
            gyr += jac * response.transpose();
        }
        // What the profiled offset does not take up.
        let left = 1.0 - self.acc_count as f64 * self.weights.mean_share(self.acc_count);
        (gyr, tangent.stacked().transpose() * self.acc_sum * (left * self.squared_weights().1))
    }
}

/// What one piece of time adds to the cost and its gradient.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    /// Which piece: its start over [`PIECE_S`].
    pub number: f64,
    /// Weighted squared residuals.
    pub cost: f64,
    /// `Σ w² J e`.
    pub score: Vector4<f64>,
}

fn norm(v: &Xyz) -> f64 {
    ComplexField::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
}
