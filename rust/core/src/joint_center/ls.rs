//! LS (eqs 9–14): where the relative orientation is known the joint-centre accelerations themselves must agree, and that is
//! linear: `a1 − b1 − K1 r1 = R12 (a2 − b2 − K2 r2)`, written in the frame of sensor 1.

use alloc::vec::Vec;
use nalgebra::{ComplexField, Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::{
    Matrix12, Unknowns,
    estimate::{Estimate, free_of, open_biases, slide, still_open},
    loss::Loss,
    moments::{Moments, Side},
    observability::{Evidence, Judged, LEAST_RESIDUAL, PIECE_S},
    solve::{Knowledge, Solution, Status},
};

/// The residual `p1 − R12 p2` with `p = A − B b − C r`, and its derivative.
pub fn residual(sides: &[Side; 2], rotation: &Matrix3<f64>, x: &Unknowns) -> (Vector3<f64>, SMatrix<f64, 3, 12>) {
    let [one, two] = sides;
    let mut slope = SMatrix::<f64, 3, 12>::zeros();
    slope.fixed_columns_mut::<3>(0).copy_from(&-one.c);
    slope.fixed_columns_mut::<3>(3).copy_from(&(rotation * two.c));
    slope.fixed_columns_mut::<3>(6).copy_from(&-one.b);
    slope.fixed_columns_mut::<3>(9).copy_from(&(rotation * two.b));
    (one.a - rotation * two.a + slope * x, slope)
}

/// Minimises `Σ ‖e‖²` (eq. 13), with biases under their prior where these are asked for; `q_12` has one rotation a moment.
/// Directions that the motion did not determine (or the given axis leaves open) are 0: as the pseudo-inverse of eq. 14 has it.
pub fn estimate(
    moments: &Moments,
    q_12: &[UnitQuaternion<f64>],
    knowledge: &Knowledge,
    axis: Option<[Vector3<f64>; 2]>,
    undetermined_std: f64,
) -> Estimate {
    let rows: Vec<_> =
        (0..moments.len()).zip(q_12).map(|(k, q)| (moments.at(k), q.to_rotation_matrix().into_inner())).collect();
    let mut sums = Sums { information: Matrix12::zeros(), gradient: Unknowns::zeros(), at_zero: 0.0, count: rows.len() };
    for (sides, rotation) in &rows {
        let (e, slope) = residual(sides, rotation, &Unknowns::zeros());
        sums.information += slope.tr_mul(&slope);
        sums.gradient += slope.tr_mul(&e);
        sums.at_zero += e.norm_squared();
    }
    let mut held: Vec<_> = axis.map(slide).into_iter().collect();
    let first = sums.solve(knowledge, &held);
    let covariance = |x: &Unknowns| {
        let mut scores: Vec<Unknowns> = Vec::new();
        let mut scatter = Matrix12::zeros();
        let mut present = f64::NAN;
        for ((sides, rotation), time) in rows.iter().zip(moments.time_s()) {
            let (e, slope) = residual(sides, rotation, x);
            let piece = ComplexField::floor(time / PIECE_S);
            if piece != present {
                present = piece;
                scores.push(Unknowns::zeros());
            }
            let score = slope.tr_mul(&e);
            scatter += score * score.transpose();
            if let Some(sum) = scores.last_mut() {
                *sum += score;
            }
        }
        let judged = Judged { scores: &scores, scatter: &scatter, hessian: &sums.information, count: rows.len() as f64 };
        let rms = ComplexField::sqrt(sums.cost(x) / (3 * rows.len()).max(1) as f64);
        (judged.covariance(sums.weight(x, knowledge), rms, knowledge), scores.len())
    };
    let open = still_open(&covariance(&first).0, &held, undetermined_std);
    held.extend(open);
    let x = sums.solve(knowledge, &held);
    let (covariance, pieces) = covariance(&x);
    let cost = sums.cost(&x);
    let mut no_levers = x;
    no_levers.fixed_rows_mut::<6>(0).fill(0.0);
    let before = sums.cost(&no_levers);
    let evidence = Evidence {
        covariance,
        residual_std: ComplexField::sqrt(cost / (3 * rows.len()).max(1) as f64),
        unexplained: if before > 0.0 { ComplexField::sqrt(cost / before) } else { 1.0 },
        pieces,
    };
    let open_bias = open_biases(&evidence, knowledge);
    let finite = x.iter().all(|v| v.is_finite());
    let status = if finite { Status::Converged } else { Status::NumericalError };
    let solution = Solution { x, cost, merit: cost, status, iterations: 1, loss: Loss::Square };
    Estimate { solution, evidence, open: held, open_bias }
}

struct Sums {
    information: Matrix12,
    gradient: Unknowns,
    at_zero: f64,
    count: usize,
}

impl Sums {
    fn cost(&self, x: &Unknowns) -> f64 {
        (self.at_zero + 2.0 * self.gradient.dot(x) + x.dot(&(self.information * x))).max(0.0)
    }

    /// Inverse residual variance of one channel, correlation considered.
    fn weight(&self, x: &Unknowns, knowledge: &Knowledge) -> f64 {
        let count = (3 * self.count).max(1) as f64;
        count / (self.cost(x) + count * LEAST_RESIDUAL * LEAST_RESIDUAL * 1e-6) / knowledge.correlated
    }

    fn solve(&self, knowledge: &Knowledge, held: &[SVector<f64, 6>]) -> Unknowns {
        let mut free = free_of(held);
        if !knowledge.biases() {
            free.fixed_view_mut::<6, 6>(6, 6).fill(0.0);
        }
        let prior = Matrix12::from_diagonal(&knowledge.information());
        let mut x = Unknowns::zeros();
        if !(self.at_zero.is_finite() && self.information.iter().all(|v| v.is_finite())) {
            return Unknowns::repeat(f64::NAN);
        }
        // What is known beforehand weighs against the scale of the residuals, which the fit itself tells.
        for _ in 0..if knowledge.biases() { 5 } else { 1 } {
            let weight = self.weight(&x, knowledge);
            let within = free * (self.information * weight + prior) * free;
            if !within.iter().all(|v| v.is_finite()) {
                return Unknowns::repeat(f64::NAN);
            }
            let Ok(inverse) = within.pseudo_inverse(1e-13 * within.trace()) else { return x };
            x = -(inverse * (free * self.gradient * weight));
        }
        x
    }
}
