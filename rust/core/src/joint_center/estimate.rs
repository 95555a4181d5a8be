//! SS and SA from the samples to an answer: all starts, the minimum, what it is worth, and what was left open.

use alloc::vec::Vec;
use nalgebra::{SVector, Vector3};

use super::{
    Matrix12, Unknowns,
    loss::Loss,
    moments::Moments,
    observability::{Evidence, LEAST_RESIDUAL, beyond, evidence, open_levers},
    residual::sums,
    solve::{Knowledge, Method, Problem, Solution, Status},
};

/// What is asked.
#[derive(Clone, Copy, Debug)]
pub struct Request {
    /// SS, SA, or between.
    pub method: Method,
    /// What is known beforehand.
    pub knowledge: Knowledge,
    /// A hinge axis in both sensor frames with one sign: the place along it is not asked.
    pub axis: Option<[Vector3<f64>; 2]>,
    /// Directions in which the centre would be less certain than this are called undetermined, m.
    pub undetermined_std: f64,
    /// Whether the smallest centre is sought along these; else what the descent ended with stands.
    pub minimum_norm: bool,
    /// Most Newton steps of one descent.
    pub max_iterations: usize,
}

/// What was found.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// The minimum; of undetermined directions the smallest.
    pub solution: Solution,
    /// What it is worth.
    pub evidence: Evidence,
    /// Directions of the stacked lever arms that the motion did not determine.
    pub open: Vec<SVector<f64, 6>>,
    /// Directions of the stacked biases.
    pub open_bias: Vec<SVector<f64, 6>>,
}

/// Share of what was known beforehand below which a bias counts as determined.
const BIAS_TOLD: f64 = 0.5;

/// Estimates the unknowns from `moments`; `go_on` is asked before each step.
pub fn estimate(moments: &Moments, request: &Request, go_on: &mut dyn FnMut() -> bool) -> Estimate {
    let mut held: Vec<_> = request.axis.map(slide).into_iter().collect();
    let asked = held.len();
    let mut problem =
        Problem { moments, knowledge: request.knowledge, free: free_of(&held), max_iterations: request.max_iterations };
    let mut solution = search(&problem, request.method, go_on);
    let mut found = evidence(moments, &solution.x, solution.loss, &request.knowledge);
    let open = still_open(&found.covariance, &held, request.undetermined_std);
    held.extend(open);
    let ended = matches!(solution.status, Status::Interrupted | Status::NumericalError);
    if held.len() > asked && request.minimum_norm && !ended {
        problem.free = free_of(&held);
        let smallest = problem.minimise(request.method, problem.free * solution.x, go_on);
        // Much worse means that the way led out of the valley.
        let noise = moments.len() as f64 * smallest.loss.of_size(7.0 * LEAST_RESIDUAL);
        if held.len() == 6 || smallest.cost <= 2.0 * solution.cost + noise {
            solution = smallest;
            found = evidence(moments, &solution.x, solution.loss, &request.knowledge);
        }
    }
    let open_bias = open_biases(&found, &request.knowledge);
    Estimate { solution, evidence: found, open: held, open_bias }
}

/// Along a hinge both centres may slide by the same amount, and no residual changes.
pub(super) fn slide([j1, j2]: [Vector3<f64>; 2]) -> SVector<f64, 6> {
    let mut slide = SVector::<f64, 6>::zeros();
    slide.fixed_rows_mut::<3>(0).copy_from(&j1);
    slide.fixed_rows_mut::<3>(3).copy_from(&j2);
    slide.normalize()
}

/// Directions of the lever arms, beyond those held, that are open.
pub(super) fn still_open(covariance: &Matrix12, held: &[SVector<f64, 6>], limit: f64) -> Vec<SVector<f64, 6>> {
    let across = held_projector(held);
    // What is held is neither certain nor uncertain: as sure as the average of the others keeps it out of every comparison.
    let levers = covariance.fixed_view::<6, 6>(0, 0).into_owned();
    let rest = across * levers * across;
    let middle = rest.trace() / (6 - held.len()).max(1) as f64;
    let filled = held.iter().fold(rest, |sum, v| sum + v * v.transpose() * middle.min(limit * limit));
    let open = open_levers(&filled, limit);
    open.into_iter().filter(|v| (across * v).norm() > 0.9).map(|v| (across * v).normalize()).collect()
}

/// Directions of the biases of which the samples tell little more than was known.
pub(super) fn open_biases(evidence: &Evidence, knowledge: &Knowledge) -> Vec<SVector<f64, 6>> {
    if !knowledge.biases() {
        return Vec::new();
    }
    beyond(&evidence.covariance.fixed_view::<6, 6>(6, 6).into_owned(), BIAS_TOLD * knowledge.bias_std)
}

/// The way to the valley is searched on about so many samples.
const COARSE_SAMPLES: usize = 384;

/// The best minimum from starts that need no luck: the lever arms without biases from zero, then everything from there and
/// from its mirror images, since the norms hardly tell a lever arm from its opposite where a joint moves little.
fn search(problem: &Problem<'_>, method: Method, go_on: &mut dyn FnMut() -> bool) -> Solution {
    let few = problem.moments.thinned(COARSE_SAMPLES);
    let share = few.len() as f64 / problem.moments.len().max(1) as f64;
    let knowledge = Knowledge { correlated: (problem.knowledge.correlated * share).max(1.0), ..problem.knowledge };
    let coarse = Problem { moments: &few, knowledge, ..*problem };
    let without = Problem { knowledge: Knowledge { bias_std: 0.0, ..knowledge }, ..coarse };
    let first = without.minimise(Method::Squares, Unknowns::zeros(), go_on);
    let mut best: Option<Solution> = None;
    for (sign1, sign2) in [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
        let mut start = first.x;
        start.fixed_rows_mut::<3>(0).scale_mut(sign1);
        start.fixed_rows_mut::<3>(3).scale_mut(sign2);
        let found = coarse.minimise(method, problem.free * start, go_on);
        if found.status == Status::Interrupted {
            return found;
        }
        if best.is_none_or(|b| found.merit < b.merit) {
            best = Some(found);
        }
        // A lever arm that explains nearly all has no rival.
        let explained = sums(&few, &found.x, Loss::Square, false).cost;
        if explained < EXPLAINED * sums(&few, &Unknowns::zeros(), Loss::Square, false).cost {
            break;
        }
    }
    let start = best.map_or_else(Unknowns::zeros, |b| b.x);
    if problem.moments.len() < COARSE_SAMPLES * MIDDLE_SHARE * 2 {
        return problem.minimise(method, start, go_on);
    }
    // Once more half way, on an eighth: spares passes over all.
    let middle = problem.moments.runs(MIDDLE_SHARE);
    let halfway = Problem { moments: &middle, ..*problem };
    let found = halfway.minimise(method, start, go_on);
    if found.status == Status::Interrupted { found } else { problem.minimise(method, found.x, go_on) }
}

/// Share of the squares at zero lever arms that is next to nothing.
const EXPLAINED: f64 = 0.1;
/// See [`search`].
const MIDDLE_SHARE: usize = 8;

fn held_projector(held: &[SVector<f64, 6>]) -> nalgebra::SMatrix<f64, 6, 6> {
    held.iter().fold(nalgebra::SMatrix::identity(), |p, v| p - v * v.transpose())
}

/// Projector on what is not held.
pub(super) fn free_of(held: &[SVector<f64, 6>]) -> Matrix12 {
    let mut free = Matrix12::identity();
    free.fixed_view_mut::<6, 6>(0, 0).copy_from(&held_projector(held));
    free
}
