//! The residual of eq. 16 and its derivatives (eqs 17–19), summed over all samples in one pass; K(ω, ω̇) is never stored.

use alloc::vec::Vec;
use nalgebra::{ComplexField, SVector, Vector3};

use super::{
    Matrix12, Unknowns,
    loss::{CHUNK, Chunk, Loss},
    moments::{Moments, Side},
    part,
};
use crate::wide::wide;

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

/// Residual of eq. 16 and its derivatives for one instant. Where a joint-centre acceleration vanishes its norm has no
/// derivative and that sensor's is zero.
pub fn residual(sides: &[Side; 2], x: &Unknowns) -> (f64, Unknowns) {
    let mut e = 0.0;
    let mut slope = Unknowns::zeros();
    for (sensor, side) in sides.iter().enumerate() {
        let sign = [1.0, -1.0][sensor];
        let (norm, direction) = norm_and_direction(&at_center(side, x, sensor));
        e += sign * norm;
        slope.fixed_rows_mut::<3>(3 * sensor).copy_from(&(side.c.tr_mul(&direction) * -sign));
        slope.fixed_rows_mut::<3>(6 + 3 * sensor).copy_from(&(side.b.tr_mul(&direction) * -sign));
    }
    (e, slope)
}

/// Derivatives of the residual with respect to what is not estimated: the gyroscope bias of sensor 1 (3) and 2 (3), the scale
/// factors of gyroscope 1, 2 and accelerometer 1, 2. `∂(K r)/∂ω = ω(·r) + (ω·)r − 2r(ω·)` applied to u.
pub fn considered(sides: &[Side; 2], x: &Unknowns) -> SVector<f64, 10> {
    let mut slope = SVector::<f64, 10>::zeros();
    for (sensor, side) in sides.iter().enumerate() {
        let sign = [1.0, -1.0][sensor];
        let (_, u) = norm_and_direction(&at_center(side, x, sensor));
        let (r, w) = (part(x, sensor), side.gyr);
        // A bias that is not taken off adds to ω what the truth has less of.
        let turned = u * w.dot(&r) + r * u.dot(&w) - w * (2.0 * u.dot(&r));
        slope.fixed_rows_mut::<3>(3 * sensor).copy_from(&(turned * -sign));
        slope[6 + sensor] = -sign * 2.0 * u.dot(&(side.c * r));
        slope[8 + sensor] = sign * u.dot(&side.a);
    }
    slope
}

/// `p = A − B b − C r`.
fn at_center(side: &Side, x: &Unknowns, sensor: usize) -> Vector3<f64> {
    side.a - side.b * part(x, 2 + sensor) - side.c * part(x, sensor)
}

fn norm_and_direction(p: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let norm = p.norm();
    (norm, if norm > 0.0 { p / norm } else { Vector3::zeros() })
}

/// The sums at `x`; `biases`: also with respect to the biases.
pub fn sums(moments: &Moments, x: &Unknowns, loss: Loss, biases: bool) -> Sums {
    collect(&sum(moments, x, loss, biases), biases)
}

fn collect(raw: &[f64; SUMS], biases: bool) -> Sums {
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
    /// `Σ ρ(e)`.
    pub cost: f64,
    /// `Σ |e|`.
    pub absolute: f64,
    /// `Σ e²`.
    pub squares: f64,
    /// `Σ e²` over that at zero lever arms, of some samples; 1 where both are 0.
    pub unexplained: f64,
    /// `Σ h JᵀJ`.
    pub hessian: Matrix12,
    /// `Σ ρ'² JᵀJ`.
    pub scatter: Matrix12,
    /// `Σ ρ' J` over each piece of time, in order.
    pub scores: Vec<Unknowns>,
}

wide! {
    /// The sums at `x` by which a solution is judged; samples whose `piece` (of their time) agrees are one piece.
    pub fn spread(moments: &Moments, x: &Unknowns, loss: Loss, biases: bool, piece: impl Fn(f64) -> f64) -> Spread = spread_chunks;
}

/// Of so many blocks one is compared with no lever arms at all.
const COMPARED: usize = 4;

#[inline(always)]
fn spread_chunks(moments: &Moments, x: &Unknowns, loss: Loss, biases: bool, piece: impl Fn(f64) -> f64) -> Spread {
    let mut totals = [[[0.0; LANES]; SUMS]; 2];
    let (mut squares, mut with_levers, mut without_levers) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    let mut scores: Vec<Unknowns> = Vec::new();
    let mut present = f64::NAN;
    let mut work = Work::default();
    let active = if biases { 12 } else { 6 };
    let mut no_levers = *x;
    no_levers.fixed_rows_mut::<6>(0).fill(0.0);
    for (n, ((block, held), times)) in moments.blocks().zip(moments.time_s().chunks(CHUNK)).enumerate() {
        let compared = n % COMPARED == 0;
        if compared {
            evaluate(&mut work, block, held, &no_levers, Loss::Square);
            add_products(&mut without_levers, &work.e, &work.e);
        }
        evaluate(&mut work, block, held, x, loss);
        add_products(&mut squares, &work.e, &work.e);
        if compared {
            add_products(&mut with_levers, &work.e, &work.e);
        }
        let mut from = 0;
        while let Some(time) = times.get(from) {
            let number = piece(*time);
            if number != present {
                present = number;
                scores.push(Unknowns::zeros());
            }
            // Time ascends: a block that ends in this piece is all of this piece.
            let ends_in_it = times.last().is_some_and(|last| piece(*last) == number);
            let to =
                if ends_in_it { times.len() } else { from + times[from..].iter().take_while(|t| piece(**t) == number).count() };
            if let Some(score) = scores.last_mut() {
                for a in 0..active {
                    score[a] += (from..to).map(|k| work.psi[k] * work.slope[a][k]).sum::<f64>();
                }
            }
            from = to;
        }
        add_active(&mut totals[0], &mut work, biases);
        for k in 0..CHUNK {
            work.curvature[k] = work.psi[k] * work.psi[k];
        }
        add_active(&mut totals[1], &mut work, biases);
    }
    let [at, of_scores] = totals.map(|t| collect(&t.map(whole), biases));
    let (cost, absolute, hessian, scatter) = (at.cost, at.absolute, at.hessian, of_scores.hessian);
    let (with, without) = (whole(with_levers), whole(without_levers));
    let unexplained = if without > 0.0 { with / without } else { 1.0 };
    Spread { cost, absolute, squares: whole(squares), unexplained, hessian, scatter, scores }
}

#[inline(always)]
fn add_active(sums: &mut [[f64; LANES]; SUMS], work: &mut Work, biases: bool) {
    if biases { add::<12>(sums, work) } else { add::<6>(sums, work) }
}

/// Cost, absolute sum, gradient (12), upper triangle of the Hessian (78).
const SUMS: usize = 2 + 12 + 78;
/// Partial sums of one total. Fixed, so that the order of every sum is the same on every machine.
const LANES: usize = 8;

wide! {
    fn sum(moments: &Moments, x: &Unknowns, loss: Loss, biases: bool) -> [f64; SUMS] = sum_chunks;
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
        evaluate(&mut work, block, held, x, loss);
        add_active(&mut sums, &mut work, biases);
    }
    sums.map(whole)
}

fn whole(s: [f64; LANES]) -> f64 {
    ((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7]))
}

/// Residuals, their losses and derivatives for one block; those beyond `held` count nothing.
#[inline(always)]
fn evaluate(work: &mut Work, block: &[Chunk], held: usize, x: &Unknowns, loss: Loss) {
    let Work { e, other, rho, psi, curvature, slope, .. } = work;
    let (of_r, of_b) = slope.split_at_mut(6);
    let (one, two) = block.split_at(block.len() / 2);
    norm_and_slopes(one, &part(x, 0), &part(x, 2), 1.0, e, &mut of_r[..3], &mut of_b[..3]);
    norm_and_slopes(two, &part(x, 1), &part(x, 3), -1.0, other, &mut of_r[3..], &mut of_b[3..]);
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

/// The norm of `p = A − B b − C r` and its derivatives `−Cᵀu` and `−Bᵀu` times `sign`, where u is the direction of p.
#[inline(always)]
fn norm_and_slopes(
    side: &[Chunk],
    r: &Vector3<f64>,
    b: &Vector3<f64>,
    sign: f64,
    norm: &mut Chunk,
    of_r: &mut [Chunk],
    of_b: &mut [Chunk],
) {
    let ([rx, ry, rz], [bx, by, bz]) = (of_r, of_b) else { return };
    match side {
        // Raw: K(ω, ω̇) on the fly, `K r = ω(ω·r) − ‖ω‖²r + ω̇×r` and `Kᵀu = ω(ω·u) − ‖ω‖²u − ω̇×u`.
        [wx, wy, wz, dx, dy, dz, ax, ay, az] => {
            for k in 0..CHUNK {
                let (wx, wy, wz, dx, dy, dz) = (wx[k], wy[k], wz[k], dx[k], dy[k], dz[k]);
                let square = wx * wx + wy * wy + wz * wz;
                let along = wx * r.x + wy * r.y + wz * r.z;
                let px = ax[k] - b.x - (wx * along - square * r.x + (dy * r.z - dz * r.y));
                let py = ay[k] - b.y - (wy * along - square * r.y + (dz * r.x - dx * r.z));
                let pz = az[k] - b.z - (wz * along - square * r.z + (dx * r.y - dy * r.x));
                let n = ComplexField::sqrt(px * px + py * py + pz * pz);
                let scale = -sign / if n > TINY { n } else { TINY };
                let (ux, uy, uz) = (px * scale, py * scale, pz * scale);
                let turned = wx * ux + wy * uy + wz * uz;
                norm[k] = n;
                rx[k] = wx * turned - square * ux - (dy * uz - dz * uy);
                ry[k] = wy * turned - square * uy - (dz * ux - dx * uz);
                rz[k] = wz * turned - square * uz - (dx * uy - dy * ux);
                (bx[k], by[k], bz[k]) = (ux, uy, uz);
            }
        }
        [ax, ay, az, b0, b1, b2, b3, b4, b5, b6, b7, b8, c0, c1, c2, c3, c4, c5, c6, c7, c8, _, _, _] => {
            for k in 0..CHUNK {
                let px = ax[k] - (b0[k] * b.x + b3[k] * b.y + b6[k] * b.z) - (c0[k] * r.x + c3[k] * r.y + c6[k] * r.z);
                let py = ay[k] - (b1[k] * b.x + b4[k] * b.y + b7[k] * b.z) - (c1[k] * r.x + c4[k] * r.y + c7[k] * r.z);
                let pz = az[k] - (b2[k] * b.x + b5[k] * b.y + b8[k] * b.z) - (c2[k] * r.x + c5[k] * r.y + c8[k] * r.z);
                let n = ComplexField::sqrt(px * px + py * py + pz * pz);
                let scale = -sign / if n > TINY { n } else { TINY };
                let (ux, uy, uz) = (px * scale, py * scale, pz * scale);
                norm[k] = n;
                rx[k] = c0[k] * ux + c1[k] * uy + c2[k] * uz;
                ry[k] = c3[k] * ux + c4[k] * uy + c5[k] * uz;
                rz[k] = c6[k] * ux + c7[k] * uy + c8[k] * uz;
                bx[k] = b0[k] * ux + b1[k] * uy + b2[k] * uz;
                by[k] = b3[k] * ux + b4[k] * uy + b5[k] * uz;
                bz[k] = b6[k] * ux + b7[k] * uy + b8[k] * uz;
            }
        }
        _ => {}
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
        for other in &slope[a..P] {
            add_products(&mut sums[next], curved, other);
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
