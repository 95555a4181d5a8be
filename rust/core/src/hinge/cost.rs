//! Residuals and Jacobians of the hinge constraints (eqs 24–25 with the second accelerometer as corrected, 36–39), as the
//! normal equations of a step on the tangent planes of the two axes.

use alloc::vec::Vec;
use nalgebra::{ComplexField, Matrix3, Matrix4, Matrix4x6, Matrix6, Matrix6x4, Vector2, Vector3, Vector4, Vector6};
use serde::{Deserialize, Serialize};

use crate::{
    Xyz,
    so3::{retract, tangent_basis},
};

/// The hinge axis in both sensor frames, unit vectors with one common sign.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisPair {
    /// In sensor frame 1.
    pub j1: Vector3<f64>,
    /// In sensor frame 2.
    pub j2: Vector3<f64>,
}

impl AxisPair {
    /// Both vectors scaled to unit length; a vector without a direction (zero, not finite) becomes x.
    pub fn new(j1: Vector3<f64>, j2: Vector3<f64>) -> Self {
        let unit = |v: Vector3<f64>| {
            let scaled = v / v.amax(); // so that no square overflows
            if scaled.iter().all(|x| x.is_finite()) { scaled.normalize() } else { Vector3::x() }
        };
        Self { j1: unit(j1), j2: unit(j2) }
    }

    /// The opposite sign pairing, where Algorithm 1 starts again (eq. 28).
    pub fn other_sign_pair(&self) -> Self {
        Self { j1: self.j1, j2: -self.j2 }
    }

    /// The same axis with the overall sign turned.
    pub fn flipped(&self) -> Self {
        Self { j1: -self.j1, j2: -self.j2 }
    }

    /// The canonical one of the two overall signs: the largest component of `j1` is positive.
    pub fn canonical(&self) -> Self {
        if self.j1[self.j1.iamax()] < 0.0 { self.flipped() } else { *self }
    }

    /// The tangent planes of both axes.
    pub fn tangent(&self) -> Tangent {
        Tangent { b1: tangent_basis(&self.j1), b2: tangent_basis(&self.j2) }
    }

    /// The pair reached by a tangent step (two components for each axis).
    pub fn step(&self, tangent: &Tangent, step: &Vector4<f64>) -> Self {
        Self {
            j1: retract(&self.j1, &tangent.b1, &Vector2::new(step[0], step[1])),
            j2: retract(&self.j2, &tangent.b2, &Vector2::new(step[2], step[3])),
        }
    }
}

/// Orthonormal bases of the tangent planes at an [`AxisPair`].
#[derive(Clone, Copy, Debug)]
pub struct Tangent {
    /// At `j1`, in sensor frame 1.
    pub b1: nalgebra::Matrix3x2<f64>,
    /// At `j2`, in sensor frame 2.
    pub b2: nalgebra::Matrix3x2<f64>,
}

impl Tangent {
    /// The 6×4 matrix that takes a tangent step to the stacked change of `(j1, j2)`.
    pub fn stacked(&self) -> Matrix6x4<f64> {
        let mut b = Matrix6x4::zeros();
        b.fixed_view_mut::<3, 2>(0, 0).copy_from(&self.b1);
        b.fixed_view_mut::<3, 2>(3, 2).copy_from(&self.b2);
        b
    }
}

/// Samples closer in time than this are one *piece*, s. The residuals of a piece share their causes (one movement, one
/// bias), so a piece counts as one observation where uncertainty is judged.
pub const PIECE_S: f64 = 1.0;

/// Half the cost, its gradient and its Gauss–Newton Hessian in the tangent planes: `V/2`, `Jᵀe`, `JᵀJ`.
#[derive(Clone, Copy, Debug)]
pub struct NormalEquations {
    /// Half the sum of squared residuals.
    pub half_cost: f64,
    /// Sum of the residuals (of one kind, unweighted).
    pub sum: f64,
    /// `Jᵀe`.
    pub gradient: Vector4<f64>,
    /// `JᵀJ`.
    pub hessian: Matrix4<f64>,
}

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
            for (channel, value) in channels.iter_mut().zip(gyr1.iter().chain(gyr2)) {
                // The residual is homogeneous in the rates: weighted rates give the weighted residual.
                channel.push(weight * value);
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
                p.try_normalize(TINY).unwrap_or_default()
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

fn gyr_normal_equations(gyr: [&[f64]; 6], axes: &AxisPair, tangent: &Tangent) -> NormalEquations {
    let frame = [frame_rows(&axes.j1, &tangent.b1), frame_rows(&axes.j2, &tangent.b2)];
    let s = sum_gyr(gyr, &frame);
    let hessian = Matrix4::new(
        s[5], s[6], -s[7], -s[8], //
        s[6], s[9], -s[10], -s[11], //
        -s[7], -s[10], s[12], s[13], //
        -s[8], -s[11], s[13], s[14],
    );
    NormalEquations { half_cost: 0.5 * s[0], sum: s[15], gradient: Vector4::new(-s[1], -s[2], s[3], s[4]), hessian }
}

/// The axes stacked, `[j1; j2]`.
pub fn stack(axes: &AxisPair) -> Vector6<f64> {
    Vector6::new(axes.j1.x, axes.j1.y, axes.j1.z, axes.j2.x, axes.j2.y, axes.j2.z)
}

/// A row of A: `[a1ᵀ, −a2ᵀ]` (eq. 53).
pub fn acc_row(acc1: &Xyz, acc2: &Xyz) -> Vector6<f64> {
    Vector6::new(acc1[0], acc1[1], acc1[2], -acc2[0], -acc2[1], -acc2[2])
}

/// Unweighted gyroscope residual (eq. 24) and its tangent Jacobian for one sample.
///
/// With `(u, v, w) = (b1·ω, b2·ω, j·ω)` the norm is `‖ω×j‖ = √(u²+v²)` and its tangent gradient `−w (u, v)/√(u²+v²)`: eq. 37
/// written in the frame of the axis, free of cancellation. Where ω is parallel to j the norm has no gradient and that
/// sensor's block is zero.
pub fn gyr_residual(gyr1: &Vector3<f64>, gyr2: &Vector3<f64>, axes: &AxisPair, tangent: &Tangent) -> (f64, Vector4<f64>) {
    let side = |gyr: &Vector3<f64>, j: &Vector3<f64>, b: &nalgebra::Matrix3x2<f64>| {
        let p = b.transpose() * gyr;
        let n = p.norm();
        let slope = if n > 0.0 { -j.dot(gyr) / n } else { 0.0 };
        (n, p * slope)
    };
    let (n1, d1) = side(gyr1, &axes.j1, &tangent.b1);
    let (n2, d2) = side(gyr2, &axes.j2, &tangent.b2);
    (n1 - n2, Vector4::new(d1.x, d1.y, -d2.x, -d2.y))
}

/// Rows b1, b2, j of the frame of an axis.
fn frame_rows(j: &Vector3<f64>, b: &nalgebra::Matrix3x2<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[b.column(0).into(), b.column(1).into(), *j]).transpose()
}

/// `[Σe², Σ d e (4), Σ d dᵀ (10, upper triangle by rows), Σe]` over all samples, where `J = (−d₁, −d₂, d₃, d₄)`: the signs wait
/// until the sums are done.
fn sum_gyr(gyr: [&[f64]; 6], frame: &[Matrix3<f64>; 2]) -> [f64; 16] {
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has the feature that the function was compiled for, as just asked.
        return unsafe { sum_gyr_avx2(gyr, frame) };
    }
    sum_gyr_chunks(gyr, frame)
}

/// The same source with wider registers; no fused operations, so the same bits.
#[cfg(all(feature = "std", target_arch = "x86_64"))]
#[target_feature(enable = "avx2")]
fn sum_gyr_avx2(gyr: [&[f64]; 6], frame: &[Matrix3<f64>; 2]) -> [f64; 16] {
    sum_gyr_chunks(gyr, frame)
}

/// Samples that go through the arithmetic together before they are summed: enough to keep the vector units busy, few enough
/// to stay in the nearest cache.
const CHUNK: usize = 32;
/// Partial sums of one total. Fixed, so that the order of every sum is the same on every machine.
const LANES: usize = 4;
type Chunk = [f64; CHUNK];

#[inline(always)]
fn sum_gyr_chunks(gyr: [&[f64]; 6], frame: &[Matrix3<f64>; 2]) -> [f64; 16] {
    let mut sums = [[0.0; LANES]; 16];
    let mut work = Work { e: [0.0; CHUNK], other: [0.0; CHUNK], d: [[0.0; CHUNK]; 4] };
    let mut tail = [[0.0; CHUNK]; 6]; // zero rates contribute exactly nothing
    let count = gyr[0].len();
    let mut start = 0;
    while start < count {
        let chunk: [&Chunk; 6] = if start + CHUNK <= count {
            gyr.map(|channel| channel[start..].first_chunk().unwrap_or(&[0.0; CHUNK]))
        } else {
            for (padded, channel) in tail.iter_mut().zip(gyr) {
                padded[..count - start].copy_from_slice(&channel[start..]);
            }
            tail.each_ref()
        };
        add_chunk(&mut sums, &mut work, chunk, frame);
        start += CHUNK;
    }
    sums.map(|s| (s[0] + s[1]) + (s[2] + s[3]))
}

/// Room for the residuals and derivatives of one chunk, made once for all.
struct Work {
    e: Chunk,
    other: Chunk,
    d: [Chunk; 4],
}

#[inline(always)]
fn add_chunk(sums: &mut [[f64; LANES]; 16], work: &mut Work, gyr: [&Chunk; 6], frame: &[Matrix3<f64>; 2]) {
    let Work { e, other, d } = work;
    let [d1, d2, d3, d4] = d;
    norm_and_descent([gyr[0], gyr[1], gyr[2]], &frame[0], e, d1, d2);
    norm_and_descent([gyr[3], gyr[4], gyr[5]], &frame[1], other, d3, d4);
    for (e, other) in e.iter_mut().zip(other) {
        *e -= *other;
    }
    add_products(&mut sums[0], e, e);
    add_products(&mut sums[15], e, &[1.0; CHUNK]);
    let mut next = 5;
    for a in 0..4 {
        add_products(&mut sums[1 + a], &d[a], e);
        for b in a..4 {
            add_products(&mut sums[next], &d[a], &d[b]);
            next += 1;
        }
    }
}

#[inline(always)]
fn add_products(sum: &mut [f64; LANES], a: &Chunk, b: &Chunk) {
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        for l in 0..LANES {
            sum[l] += a[l] * b[l];
        }
    }
}

/// Norms below this are as good as zero: ω is parallel to the axis, and dividing by it must stay finite.
const TINY: f64 = 1e-150;

/// `‖ω×j‖` and minus its two tangent derivatives for a chunk of samples (see [`gyr_residual`]).
#[inline(always)]
fn norm_and_descent(gyr: [&Chunk; 3], rows: &Matrix3<f64>, norm: &mut Chunk, d1: &mut Chunk, d2: &mut Chunk) {
    let [x, y, z] = gyr;
    for k in 0..CHUNK {
        let along = |r: usize| rows[(r, 0)] * x[k] + rows[(r, 1)] * y[k] + rows[(r, 2)] * z[k];
        let (u, v, w) = (along(0), along(1), along(2));
        let n = ComplexField::sqrt(u * u + v * v);
        let slope = w / if n > TINY { n } else { TINY };
        norm[k] = n;
        d1[k] = slope * u;
        d2[k] = slope * v;
    }
}
