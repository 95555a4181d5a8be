//! Residuals and Jacobians of the hinge constraints (eqs 24–25 with the second accelerometer as corrected, 36–39), summed to the
//! normal equations of a step on the tangent planes of the two axes.

use nalgebra::{ComplexField, Matrix3, Matrix4, Vector3, Vector4, Vector6};

use super::axes::{AxisPair, Tangent};
use crate::{Xyz, wide::wide};

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

/// The gyroscope part (eqs 24, 36–37), unweighted, over channels x, y, z of sensor 1, then of sensor 2.
pub fn gyr_normal_equations(gyr: [&[f64]; 6], axes: &AxisPair, tangent: &Tangent) -> NormalEquations {
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

wide! {
    /// `[Σe², Σ d e (4), Σ d dᵀ (10, upper triangle by rows), Σe]` over all samples, where `J = (−d₁, −d₂, d₃, d₄)`: the signs
    /// wait until the sums are done.
    fn sum_gyr(gyr: [&[f64]; 6], frame: &[Matrix3<f64>; 2]) -> [f64; 16] = sum_gyr_chunks;
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
