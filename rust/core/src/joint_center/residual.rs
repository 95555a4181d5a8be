//! The residual of eq. 16 and its derivatives (eqs 17–19), summed over all samples in one pass; K(ω, ω̇) is never stored.

use alloc::vec::Vec;
use nalgebra::{ComplexField, Vector3};

use super::{
    Matrix12, Unknowns,
    loss::{CHUNK, Chunk, Loss},
    moments::{Moments, Side},
    part,
};
use crate::rigid_body::{joint_center_acceleration, lever_matrix};

/// Sums over all samples at one point.
#[derive(Clone, Copy, Debug)]
pub struct Sums {
    /// `Σ ρ(e)`.
    pub cost: f64,
    /// `Σ |e|`.
    pub absolute: f64,
    /// `Σ ρ'(e) J`.
    pub gradient: Unknowns,
    /// `Σ h JᵀJ` with the curvature h of the loss; of the biases only where these are asked for.
    pub hessian: Matrix12,
}

/// Residual of eq. 16 and its derivatives for one sample. Where a joint-centre acceleration vanishes its norm has no
/// derivative and that sensor's is zero.
pub fn residual(sides: &[Side; 2], x: &Unknowns) -> (f64, Unknowns) {
    let mut e = 0.0;
    let mut slope = Unknowns::zeros();
    for (sensor, [gyr, gyr_dot, acc]) in sides.iter().enumerate() {
        let sign = [1.0, -1.0][sensor];
        let at_center = joint_center_acceleration(&(acc - part(x, 2 + sensor)), gyr, gyr_dot, &part(x, sensor));
        let norm = at_center.norm();
        let direction = if norm > 0.0 { at_center / norm } else { Vector3::zeros() };
        e += sign * norm;
        let along = lever_matrix(gyr, gyr_dot).tr_mul(&direction);
        slope.fixed_rows_mut::<3>(3 * sensor).copy_from(&(along * -sign));
        slope.fixed_rows_mut::<3>(6 + 3 * sensor).copy_from(&(direction * -sign));
    }
    (e, slope)
}

/// The sums at `x`; `biases`: also with respect to the biases.
pub fn sums(moments: &Moments, x: &Unknowns, loss: Loss, biases: bool) -> Sums {
    let raw = dispatch(moments, x, loss, biases);
    let count = if biases { 12 } else { 6 };
    let mut sums = Sums { cost: raw[0], absolute: raw[1], gradient: Unknowns::zeros(), hessian: Matrix12::zeros() };
    let mut next = 2 + count;
    for a in 0..count {
        sums.gradient[a] = raw[2 + a];
        for b in a..count {
            (sums.hessian[(a, b)], sums.hessian[(b, a)]) = (raw[next], raw[next]);
            next += 1;
        }
    }
    sums
}

/// What is summed over all samples to judge a solution.
#[derive(Clone, Debug)]
pub struct Spread {
    /// `Σ ρ(e)`, `Σ |e|`, `Σ e²`.
    pub cost: f64,
    /// `Σ |e|`.
    pub absolute: f64,
    /// `Σ e²`.
    pub squares: f64,
    /// `Σ e²` at zero lever arms.
    pub without_levers: f64,
    /// `Σ h JᵀJ`.
    pub hessian: Matrix12,
    /// `Σ ρ'(e) J` over each piece of time, in order.
    pub scores: Vec<Unknowns>,
}

/// The sums at `x` by which a solution is judged; samples whose `piece` (of their time) agrees are one piece.
pub fn spread(moments: &Moments, x: &Unknowns, loss: Loss, biases: bool, piece: impl Fn(f64) -> f64) -> Spread {
    let sums = sums(moments, x, loss, biases);
    let mut spread = Spread {
        cost: sums.cost,
        absolute: sums.absolute,
        squares: 0.0,
        without_levers: 0.0,
        hessian: sums.hessian,
        scores: Vec::new(),
    };
    let mut work = Work::default();
    let mut present = f64::NAN;
    let active = if biases { 12 } else { 6 };
    for ((block, held), times) in moments.blocks().zip(moments.time_s().chunks(CHUNK)) {
        evaluate(&mut work, block, held, &moments.gyr_bias(), x, loss);
        spread.squares += work.e.iter().map(|e| e * e).sum::<f64>();
        for (k, time) in times.iter().enumerate() {
            let norm = |from: usize, bias: Vector3<f64>| {
                (Vector3::new(block[from][k], block[from + 1][k], block[from + 2][k]) - bias).norm()
            };
            let without = norm(6, part(x, 2)) - norm(15, part(x, 3));
            spread.without_levers += without * without;
            let number = piece(*time);
            if number != present {
                present = number;
                spread.scores.push(Unknowns::zeros());
            }
            if let Some(score) = spread.scores.last_mut() {
                (0..active).for_each(|a| score[a] += work.psi[k] * work.slope[a][k]);
            }
        }
    }
    spread
}

/// Cost, absolute sum, gradient (12), upper triangle of the Hessian (78).
const SUMS: usize = 2 + 12 + 78;
/// Partial sums of one total. Fixed, so that the order of every sum is the same on every machine.
const LANES: usize = 4;

fn dispatch(moments: &Moments, x: &Unknowns, loss: Loss, biases: bool) -> [f64; SUMS] {
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has the feature that the function was compiled for, as just asked.
        return unsafe { sum_avx2(moments, x, loss, biases) };
    }
    sum_chunks(moments, x, loss, biases)
}

/// The same source with wider registers; no fused operations, so the same bits.
#[cfg(all(feature = "std", target_arch = "x86_64"))]
#[target_feature(enable = "avx2")]
fn sum_avx2(moments: &Moments, x: &Unknowns, loss: Loss, biases: bool) -> [f64; SUMS] {
    sum_chunks(moments, x, loss, biases)
}

/// Room for one chunk, made once for all.
struct Work {
    e: Chunk,
    other: Chunk,
    rho: Chunk,
    psi: Chunk,
    curvature: Chunk,
    /// The derivatives, and these times the curvature.
    slope: [Chunk; 12],
    curved: Chunk,
}

impl Default for Work {
    fn default() -> Self {
        let zero = [0.0; CHUNK];
        Self { e: zero, other: zero, rho: zero, psi: zero, curvature: zero, slope: [zero; 12], curved: zero }
    }
}

#[inline(always)]
fn sum_chunks(moments: &Moments, x: &Unknowns, loss: Loss, biases: bool) -> [f64; SUMS] {
    let mut sums = [[0.0; LANES]; SUMS];
    let mut work = Work::default();
    for (block, held) in moments.blocks() {
        evaluate(&mut work, block, held, &moments.gyr_bias(), x, loss);
        if biases { add::<12>(&mut sums, &mut work) } else { add::<6>(&mut sums, &mut work) }
    }
    sums.map(|s| (s[0] + s[1]) + (s[2] + s[3]))
}

/// Residuals, their losses and derivatives for one block; those beyond `held` count nothing.
#[inline(always)]
fn evaluate(work: &mut Work, block: &[Chunk; 18], held: usize, gyr_bias: &[Vector3<f64>; 2], x: &Unknowns, loss: Loss) {
    let [r1, r2, b1, b2] = [part(x, 0), part(x, 1), part(x, 2), part(x, 3)];
    let Work { e, other, rho, psi, curvature, slope, .. } = work;
    let (of_r, of_b) = slope.split_at_mut(6);
    norm_and_slopes(&block[..9], &gyr_bias[0], &r1, &b1, 1.0, e, &mut of_r[..3], &mut of_b[..3]);
    norm_and_slopes(&block[9..], &gyr_bias[1], &r2, &b2, -1.0, other, &mut of_r[3..], &mut of_b[3..]);
    for k in 0..CHUNK {
        e[k] -= other[k];
    }
    loss.apply(e, rho, psi, curvature);
    for k in held..CHUNK {
        (e[k], rho[k], psi[k], curvature[k]) = (0.0, 0.0, 0.0, 0.0);
    }
}

/// Norms below this are as good as zero; dividing by it must stay finite.
const TINY: f64 = 1e-150;

/// `‖a − b − K r‖` and its derivatives `−Kᵀu` and `−u` times `sign`, where u is the direction and
/// `Kᵀu = ω(ω·u) − ‖ω‖²u − ω̇×u`.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "one side of the residual, called twice")]
fn norm_and_slopes(
    side: &[Chunk],
    gyr_bias: &Vector3<f64>,
    r: &Vector3<f64>,
    b: &Vector3<f64>,
    sign: f64,
    norm: &mut Chunk,
    of_r: &mut [Chunk],
    of_b: &mut [Chunk],
) {
    let ([wx, wy, wz, dx, dy, dz, ax, ay, az], [rx, ry, rz], [bx, by, bz]) = (side, of_r, of_b) else { return };
    for k in 0..CHUNK {
        let (wx, wy, wz) = (wx[k] - gyr_bias.x, wy[k] - gyr_bias.y, wz[k] - gyr_bias.z);
        let (dx, dy, dz) = (dx[k], dy[k], dz[k]);
        let square = wx * wx + wy * wy + wz * wz;
        let along = wx * r.x + wy * r.y + wz * r.z;
        let ex = ax[k] - b.x - (wx * along - square * r.x + (dy * r.z - dz * r.y));
        let ey = ay[k] - b.y - (wy * along - square * r.y + (dz * r.x - dx * r.z));
        let ez = az[k] - b.z - (wz * along - square * r.z + (dx * r.y - dy * r.x));
        let n = ComplexField::sqrt(ex * ex + ey * ey + ez * ez);
        let scale = -sign / if n > TINY { n } else { TINY };
        let (ux, uy, uz) = (ex * scale, ey * scale, ez * scale);
        let turned = wx * ux + wy * uy + wz * uz;
        norm[k] = n;
        rx[k] = wx * turned - square * ux - (dy * uz - dz * uy);
        ry[k] = wy * turned - square * uy - (dz * ux - dx * uz);
        rz[k] = wz * turned - square * uz - (dx * uy - dy * ux);
        (bx[k], by[k], bz[k]) = (ux, uy, uz);
    }
}

#[inline(always)]
fn add<const P: usize>(sums: &mut [[f64; LANES]; SUMS], work: &mut Work) {
    let Work { e, rho, psi, curvature, slope, curved, .. } = work;
    for (r, e) in rho.as_chunks::<LANES>().0.iter().zip(e.as_chunks::<LANES>().0) {
        for l in 0..LANES {
            sums[0][l] += r[l];
            sums[1][l] += ComplexField::abs(e[l]);
        }
    }
    let mut next = 2 + P;
    for a in 0..P {
        add_products(&mut sums[2 + a], psi, &slope[a]);
        for k in 0..CHUNK {
            curved[k] = curvature[k] * slope[a][k];
        }
        for b in a..P {
            add_products(&mut sums[next], curved, &slope[b]);
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
