//! The descent: Gauss–Newton, damped where it fails, with the scales of the noise estimated along the way.

use alloc::vec::Vec;
use nalgebra::{ComplexField, UnitQuaternion, Vector3};

use super::{
    arrowhead::Border,
    assemble::{Prior, Problem, State},
    kernel::Kernel,
    keys::{Key, Samples},
    marginals::{chain_marginals, marginals},
    noise::{Noise, absorbed, alike, trust},
    norms::fit_lengths,
    observability::{longest_step, reveal},
    output::{Smoothed, samples_covariance, samples_q_12},
    residual::{Constants, GYR_BIASES, triple},
    start::start,
};
use crate::{Xyz, condition::BREAK_STEPS, held::fill, rest::Rest};

/// Why the descent ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The next step would be shorter than the tolerance, and the noise is settled.
    Converged,
    /// No shorter step lowered the cost, though one was predicted to.
    Stalled,
    /// The iterations ran out.
    MaxIterations,
    /// Nowhere do the data show the relative orientation.
    NotObservable,
    /// A number overflowed.
    NumericalError,
    /// The caller asked to stop.
    Interrupted,
}

/// How to smooth.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Length of the window over which a link is averaged, s.
    pub window_s: f64,
    /// Time between keys, s.
    pub key_step_s: f64,
    /// The longest gap that the gyroscopes bridge, s; beyond it nothing but the constants is carried across.
    pub bridge_s: f64,
    /// Degrees of freedom of the link's Student's t.
    pub tail: f64,
    /// What the gyroscopes' errors add up to, rad/√s; None: estimated.
    pub drift_std: Option<f64>,
    /// Scale of the link residuals, m/s²; None: estimated.
    pub link_std: Option<f64>,
    /// Where a sensor is seen at rest, its gyroscope bias is held to what it shows then, with this standard deviation, rad/s;
    /// None: rest is not looked for.
    pub rest_bias_std: Option<f64>,
    /// Gauss–Newton iterations.
    pub max_iterations: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            window_s: 0.2,
            key_step_s: 0.1,
            bridge_s: 1.0,
            tail: 4.0,
            drift_std: None,
            link_std: None,
            rest_bias_std: Some(2e-3),
            max_iterations: 60,
        }
    }
}

/// Smooths a recording: `gyr` in rad/s and `acc` in m/s² of both sensors at the strictly increasing times `time_s`, which are
/// about `step_s` apart. Starts from the prior's mean. `go_on` is asked before each iteration; where it says no, what was
/// reached so far comes back as [`Status::Interrupted`].
pub fn smooth(
    time_s: &[f64],
    gyr: [&[Xyz]; 2],
    acc: [&[Xyz]; 2],
    step_s: f64,
    prior: &Prior,
    options: &Options,
    go_on: &mut dyn FnMut() -> bool,
) -> Smoothed {
    let mut prior = *prior;
    if let Some(std) = options.rest_bias_std {
        for (i, bias) in rest_biases(time_s, gyr, acc, step_s).into_iter().enumerate() {
            if let Some(bias) = bias {
                prior.know(GYR_BIASES + 3 * i, &bias, std);
            }
        }
    }
    let kernel = Kernel::new(options.window_s, step_s);
    let key_steps = (ComplexField::round(options.key_step_s / step_s) as usize).max(1);
    let sensors = [0, 1].map(|i| fill(time_s, gyr[i], acc[i]));
    let samples = Samples::new(time_s, sensors, step_s, options.bridge_s, key_steps, kernel.reach());
    let mut descent = Descent::new(samples, kernel, &prior, options);
    let (status, iterations) = descent.run(go_on);
    descent.finish(status, iterations)
}

/// What rest shows of the gyroscope biases.
fn rest_biases(time_s: &[f64], gyr: [&[Xyz]; 2], acc: [&[Xyz]; 2], step_s: f64) -> [Option<Vector3<f64>>; 2] {
    [0, 1].map(|i| {
        let mut rest = Rest::default();
        for (k, (gyr, acc)) in gyr[i].iter().zip(acc[i]).enumerate() {
            if k > 0 && time_s[k] - time_s[k - 1] > BREAK_STEPS * step_s {
                rest.reset();
            }
            let mut sample = [0.0; 12];
            sample[..3].copy_from_slice(gyr);
            sample[3..6].copy_from_slice(acc);
            rest.push(&sample, 0, 1.0 / step_s);
        }
        rest.bias().map(Vector3::from)
    })
}

/// A step of every orientation shorter than this ends the descent, rad.
const STEP_TOLERANCE: f64 = 2e-5;
/// Steps longer than this come before the noise can be told from errors of the start, rad...
const ROUGH: f64 = 0.03;
/// ...and meanwhile the gyroscopes are trusted this little, rad/√s.
const ROUGH_DRIFT: f64 = 1e-2;
/// The drift frames are made anew when a gyroscope bias has moved by more than this, rad/s.
const BIAS_TOLERANCE: f64 = 1e-4;
const MOST_REMAKES: usize = 4;
/// No more iterations than these pass for rough: where nothing holds the heading, steps stay long.
const MOST_ROUGH: usize = 15;
/// Where a chain that does not show its orientation wanders along its valley, it pulls the others a little to and fro through the
/// constants; steps of theirs shorter than this then end the descent, rad (0.003 degrees).
const WANDERING_TOLERANCE: f64 = 5e-5;
/// Scales of few residuals creep to where they belong; after so many iterations they are near enough.
const MOST_UNSETTLED: usize = 30;
const LEAST_DAMPING: f64 = 1e-4;
/// Up to this the damped system tells the noise as the plain one would.
const SLIGHT_DAMPING: f64 = 1e-2;
const MOST_DAMPING: f64 = 1e8;

struct Descent<'a> {
    samples: Samples<'a>,
    kernel: Kernel,
    prior: &'a Prior,
    options: &'a Options,
    turns: [Vec<UnitQuaternion<f64>>; 2],
    keys: Vec<Key>,
    drift_bias: [Vector3<f64>; 2],
    state: State,
    noise: Noise,
    prior_weight: f64,
}

impl<'a> Descent<'a> {
    fn new(samples: Samples<'a>, kernel: Kernel, prior: &'a Prior, options: &'a Options) -> Self {
        let drift_bias = biases(&prior.mean);
        let turns = [0, 1].map(|i| samples.turn(i, &drift_bias[i]));
        let keys = samples.keys(&turns, &kernel);
        let x = fit_lengths(&keys, prior);
        let state = State { w: start(&keys, samples.time_s, &x), x };
        let noise = Noise { link_std: 1.0, drift_std: ROUGH_DRIFT, tail: options.tail, trust: 1.0 };
        Self { samples, kernel, prior, options, turns, keys, drift_bias, state, noise, prior_weight: 1.0 }
    }

    fn problem(&self) -> Problem<'_> {
        Problem {
            keys: &self.keys,
            noise: self.noise,
            prior: self.prior,
            prior_weight: self.prior_weight,
            drift_bias: self.drift_bias,
        }
    }

    fn run(&mut self, go_on: &mut dyn FnMut() -> bool) -> (Status, usize) {
        let (mut damping, mut remakes) = (0.0, 0);
        let (mut rough, mut settled) = (true, false);
        if !self.samples.is_finite() {
            return (Status::NumericalError, 0);
        }
        for iteration in 0..self.options.max_iterations {
            if !go_on() {
                return (Status::Interrupted, iteration);
            }
            if rough {
                let mut noise = self.noise;
                noise.fit_links(&self.problem(), &self.state);
                self.noise = noise;
            }
            let problem = self.problem();
            let here = problem.cost(&self.state);
            if !here.is_finite() {
                return (Status::NumericalError, iteration);
            }
            let Some(eliminated) = problem.linearise(&self.state, damping).eliminate() else {
                if damping > MOST_DAMPING {
                    return (Status::NumericalError, iteration);
                }
                damping = (damping * 10.0).max(LEAST_DAMPING);
                continue;
            };
            let (steps, constants) = eliminated.step();
            let longest = steps.iter().map(|s| s.norm()).fold(0.0, f64::max);
            let next = self.state.moved(&steps, &constants);
            if problem.cost(&next) > here * (1.0 + 1e-10) {
                if longest < STEP_TOLERANCE {
                    return (Status::Converged, iteration + 1);
                }
                if damping > MOST_DAMPING {
                    return (Status::Stalled, iteration + 1);
                }
                damping = (damping * 10.0).max(LEAST_DAMPING);
                continue;
            }
            if !rough && !settled && damping <= SLIGHT_DAMPING {
                let taken = absorbed(&problem, &eliminated.border);
                let noise = self.fixed(self.noise.update(&problem, &next, &chain_marginals(&eliminated), taken));
                settled = noise.close_to(&self.noise) || iteration >= MOST_UNSETTLED;
                let alike = alike(&problem, &next);
                (self.noise, self.prior_weight) = (noise, alike);
            }
            rough = rough && longest > ROUGH && iteration < MOST_ROUGH;
            damping = if damping > LEAST_DAMPING { damping * 0.1 } else { 0.0 };
            self.state = next;
            let now = biases(&self.state.x);
            let moved = (0..2).map(|i| (now[i] - self.drift_bias[i]).norm()).fold(0.0, f64::max);
            if moved > BIAS_TOLERANCE && remakes < MOST_REMAKES && !rough {
                self.remake(now);
                remakes += 1;
            } else if settled && (longest < STEP_TOLERANCE || (iteration >= MOST_ROUGH && self.wanders(&steps, longest))) {
                return (Status::Converged, iteration + 1);
            }
        }
        (Status::MaxIterations, self.options.max_iterations)
    }

    /// Whether nothing moves any more but chains that do not show their orientation, and what these pull along.
    fn wanders(&self, steps: &[Vector3<f64>], longest: f64) -> bool {
        let shown = longest_step(&self.problem(), &self.state, steps);
        shown < WANDERING_TOLERANCE && shown < longest
    }

    /// With the scales that the caller fixed.
    fn fixed(&self, noise: Noise) -> Noise {
        Noise {
            link_std: self.options.link_std.unwrap_or(noise.link_std),
            drift_std: self.options.drift_std.unwrap_or(noise.drift_std),
            ..noise
        }
    }

    /// Makes the drift frames with other gyroscope biases; the orientations stay.
    fn remake(&mut self, bias: [Vector3<f64>; 2]) {
        let turns = [0, 1].map(|i| self.samples.turn(i, &bias[i]));
        for (key, w) in self.keys.iter().zip(&mut self.state.w) {
            let change = [0, 1].map(|i| turns[i][key.sample] * self.turns[i][key.sample].inverse());
            *w = change[0] * *w * change[1].inverse();
        }
        self.keys = self.samples.keys(&turns, &self.kernel);
        self.turns = turns;
        self.drift_bias = bias;
    }

    fn finish(mut self, status: Status, iterations: usize) -> Smoothed {
        if let Some(eliminated) = self.problem().linearise(&self.state, 0.0).eliminate() {
            let taken = absorbed(&self.problem(), &eliminated.border);
            self.noise.trust = trust(&self.problem(), &self.state, &chain_marginals(&eliminated), taken);
        }
        self.prior_weight = 1.0;
        let eliminated = self.problem().linearise(&self.state, 0.0).eliminate();
        let mut covariances = eliminated.as_ref().map(marginals).unwrap_or_default();
        let mut known = eliminated.as_ref().map(chain_marginals).unwrap_or_default();
        let seen = reveal(&self.problem(), &self.state, &mut covariances);
        reveal(&self.problem(), &self.state, &mut known);
        let ended = matches!(status, Status::Converged | Status::Stalled | Status::MaxIterations);
        let status = if ended && !seen { Status::NotObservable } else { status };
        Smoothed {
            q_12: samples_q_12(&self.samples, &self.turns, &self.keys, &self.state.w),
            covariance: samples_covariance(&self.samples, &self.turns[1], &self.keys, &covariances),
            covariance_known: samples_covariance(&self.samples, &self.turns[1], &self.keys, &known),
            constants: self.state.x,
            constants_covariance: eliminated.map_or(Border::from_diagonal_element(f64::INFINITY), |e| e.border),
            noise: self.noise,
            link_squares: self.link_squares(),
            status,
            iterations,
        }
    }

    /// Of every link its sample and the square of its residual over the scale of the noise.
    fn link_squares(&self) -> Vec<(usize, f64)> {
        let variance = self.noise.link_std * self.noise.link_std;
        let problem = self.problem();
        let linked = self.keys.iter().filter(|key| key.share > 0.0);
        linked
            .zip(problem.links(&self.state))
            .map(|(key, (e, share))| (key.sample, e.norm_squared() * share / variance))
            .collect()
    }
}

fn biases(x: &Constants) -> [Vector3<f64>; 2] {
    [triple(x, GYR_BIASES), triple(x, GYR_BIASES + 3)]
}
