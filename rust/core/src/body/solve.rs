//! Levenberg–Marquardt (Moré 1978; Nielsen's rule for the damping): a step counts only where the true cost falls by a share of
//! what the quadratic model promises, and only the promise of a nearly undamped step says that the minimum is reached.

use alloc::vec::Vec;

use super::{assemble::Problem, band::Band, states::State};

/// Why the descent ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The next step would gain next to nothing.
    Converged,
    /// No shorter step lowered the cost, though one was predicted to.
    Stalled,
    /// The iterations ran out.
    MaxIterations,
    /// A number overflowed.
    NumericalError,
    /// The caller asked to stop.
    Interrupted,
}

/// How to descend.
#[derive(Clone, Copy, Debug)]
pub struct Descent {
    /// Most linear systems that are solved.
    pub max_iterations: usize,
    /// The descent ends where a step promises less than this, in log-likelihood, or than a millionth of the cost.
    pub tolerance: f64,
    /// Damping to begin with, in units of [`super::assemble`]'s usual steps.
    pub damping: f64,
}

impl Default for Descent {
    fn default() -> Self {
        Self { max_iterations: 60, tolerance: 1e-3, damping: 1e-3 }
    }
}

/// One linear system.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    /// Cost before it.
    pub cost: f64,
    /// Cost after its step; taken where it is lower.
    pub tried: f64,
    /// Fall of the cost that the damped quadratic model promised.
    pub promised: f64,
    /// Damping.
    pub damping: f64,
    /// Whether the step was taken.
    pub taken: bool,
}

/// Where the descent ended.
#[derive(Clone, Debug)]
pub struct End {
    /// The unknowns.
    pub state: State,
    /// Minus the logarithm of the posterior, up to a constant.
    pub cost: f64,
    /// Why.
    pub status: Status,
    /// The way.
    pub trials: Vec<Trial>,
}

/// Up to this the damped step promises what the plain one would.
const SLIGHT: f64 = 1e-2;
/// Less is lost in the rounding of the system.
const LEAST: f64 = 1e-8;
const MOST: f64 = 1e12;
const RELATIVE: f64 = 1e-6;
/// A step that gains so many times its promise is tried longer, by up to so much.
const MORE: f64 = 1.2;
const LONGEST: f64 = 64.0;
/// A step must keep this share of its promise.
const SHARE: f64 = 1e-3;

/// Descends from `state`. `watch` is told of every trial and says whether to go on.
///
/// The posterior has a long bent valley, tilt with drift: a full step along it climbs its side, and the next ones slide down to
/// its floor. So a step that is hardly damped and climbs is followed by others as long as each at least halves the climb, and
/// undone where they do not end below its beginning.
pub fn minimise(problem: &Problem<'_>, state: State, descent: &Descent, watch: &mut dyn FnMut(&Trial) -> bool) -> End {
    let model = problem.model;
    let mut band = Band::new(problem.moments.len(), model.sensors, model.constants());
    let mut state = state;
    let mut cost = problem.cost(&state);
    let mut trials: Vec<Trial> = Vec::new();
    let (mut damping, mut growth) = (descent.damping, 2.0);
    // Where a step has climbed to, what the first one promised, and how far above the best it ended.
    let mut ahead: Option<(State, f64, f64)> = None;
    let status = loop {
        if !cost.is_finite() {
            break Status::NumericalError;
        }
        if trials.len() >= descent.max_iterations {
            break Status::MaxIterations;
        }
        let from = ahead.as_ref().map_or(&state, |(there, ..)| there);
        let Some(Way { mut next, promised, slope, steps, border }) = step(problem, from, damping, &mut band) else {
            ahead = None;
            damping = (damping * 10.0).max(LEAST);
            if damping > MOST {
                break Status::NumericalError;
            }
            continue;
        };
        let mut tried = problem.cost(&next);
        // The parabola through the slope and both costs says how far to go where the quadratic model does not. Where the cost
        // bends more than that (lengths that contradict the joints, heavy tails), full steps leap from side to side; what climbs
        // by more than was promised is the valley's bend, not this. Along the valley's floor it bends less, and full steps creep.
        let (bend, climb) = (tried - cost + slope, tried - cost);
        let (creeps, leaps) = (climb < -MORE * promised, climb > -0.3 * promised && climb < promised && bend > 0.0);
        let mut share = if 0.5 * slope < LONGEST * bend { 0.5 * slope / bend } else { LONGEST };
        while ahead.is_none() && (creeps || leaps) && share <= LONGEST {
            let scaled = |v: &[f64]| -> Vec<f64> { v.iter().map(|v| share * v).collect() };
            let other = from.moved(model, &scaled(&steps), &scaled(&border));
            let cost = problem.cost(&other);
            if cost >= tried {
                break;
            }
            (next, tried) = (other, cost);
            share *= if creeps { 2.0 } else { f64::INFINITY };
        }
        let second = ahead.take();
        let promised_before = second.as_ref().map_or(promised, |(_, first, _)| *first);
        let (fall, slight) = (cost - tried, damping <= SLIGHT);
        let enough = descent.tolerance.max(RELATIVE * cost);
        let taken = fall >= SHARE * promised_before && fall > 0.0;
        let trial = Trial { cost, tried, promised, damping, taken };
        trials.push(trial);
        let go_on = watch(&trial);
        if taken {
            (state, cost) = (next, tried);
            // Nielsen: 1 − (2ρ − 1)³, at least a tenth; after a climb things stay as they are.
            if second.is_none() {
                let ratio = 2.0 * fall / promised - 1.0;
                damping = (damping * (1.0 - ratio * ratio * ratio).max(0.1)).max(LEAST);
            }
            growth = 2.0;
            if slight && second.is_none() && promised < enough {
                break Status::Converged;
            }
        } else {
            if slight && second.is_none() && promised < enough {
                break Status::Converged;
            }
            let above = second.as_ref().map_or(f64::INFINITY, |(.., above)| 0.5 * above);
            if slight && -fall < above {
                ahead = Some((next, promised_before, -fall));
            } else {
                // Less than that would hardly change the step.
                damping = (damping * growth).max(SLIGHT);
                growth *= 2.0;
                if damping > MOST {
                    break Status::Stalled;
                }
            }
        }
        if !go_on {
            break Status::Interrupted;
        }
    };
    End { state, cost, status, trials }
}

/// A damped Gauss–Newton step.
struct Way {
    next: State,
    /// Fall of the cost that the quadratic model promises.
    promised: f64,
    /// Fall of the cost per step at its beginning.
    slope: f64,
    steps: Vec<f64>,
    border: Vec<f64>,
}

/// From `state`; None where the system is not positive definite.
fn step(problem: &Problem<'_>, state: &State, damping: f64, band: &mut Band) -> Option<Way> {
    if !eliminated(problem, state, damping, band) {
        return None;
    }
    let solution = band.solve()?;
    // gᵀ(H + D)⁻¹g/2 is the promise of the damped model; that of the plain one, which the cost follows, is more by δᵀDδ/2.
    let extra = problem.damped(damping, &solution.steps, &solution.border);
    let promised = 0.5 * solution.decrement + 0.5 * extra;
    promised.is_finite().then(|| Way {
        next: state.moved(problem.model, &solution.steps, &solution.border),
        promised,
        slope: solution.decrement,
        steps: solution.steps,
        border: solution.border,
    })
}

/// Linearises and eliminates, moment by moment.
pub fn eliminated(problem: &Problem<'_>, state: &State, damping: f64, band: &mut Band) -> bool {
    problem.begin(state, damping, band);
    (0..problem.moments.len()).all(|k| {
        problem.node(k, state, damping, band);
        band.eliminate(k)
    })
}
