//! The streaming hinge estimator.

use std::sync::{Mutex, MutexGuard};

use imufast_core::{
    Xyz,
    hinge::{
        AxisPair, Weights,
        evidence::{angular_deviation, tangent_covariance},
        record::{Contrast, Record, refit},
        select::Candidate,
        stream::{HingeStream as Core, PRESENT_MOVING, StreamSettings},
    },
};
use numpy::{PyReadonlyArray3, PyReadonlyArrayDyn, nalgebra};
use pyo3::{exceptions::PyValueError, prelude::*, types::PyBytes};

use crate::{
    arrays::positive,
    blocks::{Block, Clock},
    hinge::{pairs, status_name},
};

type Deviations = [(f64, f64); 2];

/// One estimate of a stream and everything that bears on whether to believe it.
#[pyclass(frozen, get_all, module = "imufast._core")]
pub struct HingeRecord {
    time_s: f64,
    axis1: Xyz,
    axis2: Xyz,
    cost: f64,
    status: &'static str,
    /// Every distinct minimum, the estimate first: axis1, axis2, cost.
    minima: Vec<(Xyz, Xyz, f64)>,
    covariance: [[f64; 6]; 6],
    /// Mean and standard deviation of the angle between each axis and the truth, rad, with the given offsets considered.
    deviation: Deviations,
    /// The same from the paper's covariance.
    published_deviation: Deviations,
    gyr_residual_std: f64,
    acc_residual_std: f64,
    unexplained: f64,
    pieces: usize,
    /// Evidence for the sign pairing: from planar motion (logarithm) and from the accelerometers (significance, ratio).
    pairing: f64,
    acc_pairing: (f64, f64),
    /// The strongest rival minimum: significance and ratio of its cost.
    rival: Option<(f64, f64)>,
    misfit: Option<f64>,
    relative_rate: f64,
    moving_s: f64,
    n_gyr: usize,
    n_acc: usize,
}

impl HingeRecord {
    fn new(record: &Record, gyr_offset_std: f64, acc_offset_std: f64) -> Option<Self> {
        let best = record.minima.first()?;
        let evidence = &record.evidence;
        let covariance = evidence.covariance
            + record.gyr_offset_covariance * (gyr_offset_std * gyr_offset_std)
            + record.acc_offset_covariance * (acc_offset_std * acc_offset_std);
        let deviations = |covariance: &nalgebra::Matrix6<f64>| {
            tangent_covariance(covariance, &best.axes.tangent()).map(|p| angular_deviation(&p))
        };
        let both = |c: Contrast| (c.significance, c.ratio);
        Some(Self {
            time_s: record.time_s,
            axis1: best.axes.j1.into(),
            axis2: best.axes.j2.into(),
            cost: best.cost,
            status: status_name(best.status),
            minima: record.minima.iter().map(|m| (m.axes.j1.into(), m.axes.j2.into(), m.cost)).collect(),
            deviation: deviations(&covariance),
            published_deviation: deviations(&evidence.published_covariance),
            covariance: covariance.into(),
            gyr_residual_std: evidence.gyr_residual_std,
            acc_residual_std: evidence.acc_residual_std,
            unexplained: evidence.unexplained,
            pieces: evidence.pieces,
            pairing: record.pairing,
            acc_pairing: both(record.acc_pairing),
            rival: record.rival.map(both),
            misfit: record.witness.misfit,
            relative_rate: record.witness.relative_rate,
            moving_s: record.witness.moving_s,
            n_gyr: record.samples.0,
            n_acc: record.samples.1,
        })
    }
}

struct State {
    core: Core,
    clock: Clock,
    /// Time of the sample that waits for a step of estimation, s.
    waiting_s: f64,
    /// Steps of estimation done, and how long one is, s.
    steps: u64,
    step_s: f64,
}

impl State {
    fn next_step_s(&self) -> f64 {
        self.clock.first_s + (self.steps + 1) as f64 * self.step_s
    }
}

/// A stream of two sensors' samples in bounded memory. It stops at every step of estimation, so that decisions fall between
/// the same two samples however the data are cut.
#[pyclass(frozen, module = "imufast._core")]
pub struct HingeStream {
    state: Mutex<State>,
}

#[pymethods]
impl HingeStream {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "one call from one place in Python")]
    fn new(
        rate_hz: f64,
        lowpass_hz: f64,
        window_s: f64,
        max_samples: usize,
        energy_threshold: f64,
        always_quiet: bool,
        settle_pairing: bool,
        bias_from_rest: bool,
        max_iterations: usize,
        weight_ratio: f64,
        rate_scale: f64,
        offset_prior: f64,
        step_s: f64,
    ) -> PyResult<Self> {
        positive(rate_hz, "rate_hz")?;
        positive(step_s, "step_s")?;
        let weights = Weights { ratio: weight_ratio, rate_scale, offset_prior };
        let settings = StreamSettings {
            rate_hz,
            lowpass_hz,
            window_s,
            max_samples,
            energy_threshold,
            always_quiet,
            settle_pairing,
            bias_from_rest,
            max_iterations,
            weights,
        };
        if !settings.windows_are_bounded() {
            return Err(PyValueError::new_err(format!(
                "rate_hz {rate_hz} makes the windows of lowpass_hz {lowpass_hz} and window_s {window_s} longer than 1000000 samples"
            )));
        }
        let core = Core::new(settings);
        let state = State { core, clock: Clock::new(rate_hz), waiting_s: 0.0, steps: 0, step_s };
        Ok(Self { state: Mutex::new(state) })
    }

    /// Takes samples (N, 3) or one (3,) from row `start` on until a step of estimation is due; says how many rows it has taken
    /// in all. Arrays are checked as a whole, and nothing is taken from bad ones, when `start` is 0.
    #[pyo3(signature = (gyr1, acc1, gyr2, acc2, time_s, start))]
    #[expect(clippy::too_many_arguments, reason = "one call from one place in Python, all by position")]
    fn push(
        &self,
        py: Python<'_>,
        gyr1: PyReadonlyArrayDyn<'_, f64>,
        acc1: PyReadonlyArrayDyn<'_, f64>,
        gyr2: PyReadonlyArrayDyn<'_, f64>,
        acc2: PyReadonlyArrayDyn<'_, f64>,
        time_s: Option<PyReadonlyArrayDyn<'_, f64>>,
        start: usize,
    ) -> PyResult<usize> {
        let block = Block::new([&gyr1, &acc1, &gyr2, &acc2], time_s.as_ref())?;
        let mut state = self.lock();
        if start == 0 {
            block.check(&state.clock)?;
        }
        state.clock.timed = Some(block.timed());
        if block.len() - start.min(block.len()) < 64 {
            return Ok(take(&mut state, &block, start));
        }
        drop(state);
        py.detach(|| Ok(take(&mut self.lock(), &block, start)))
    }

    /// Ends a step of estimation: everything the samples so far say; None while there are too few.
    #[pyo3(signature = (gyr_offset_std, acc_offset_std, starts))]
    fn estimate(
        &self,
        py: Python<'_>,
        gyr_offset_std: f64,
        acc_offset_std: f64,
        starts: Option<PyReadonlyArray3<'_, f64>>,
    ) -> PyResult<Option<HingeRecord>> {
        let starts = starts.as_ref().map(pairs).transpose()?;
        let record = py.detach(|| self.lock().core.estimate(starts.as_deref()));
        Ok(record.and_then(|r| HingeRecord::new(&r, gyr_offset_std, acc_offset_std)))
    }

    /// Moves on to the next step of estimation; steps that a gap has skipped are passed over.
    fn next_step(&self) {
        let mut state = self.lock();
        let passed = ((state.waiting_s - state.clock.first_s) / state.step_s).floor();
        state.steps = (state.steps + 1).max(if passed > 0.0 { passed as u64 } else { 0 });
    }

    /// Time of the step that is due, s.
    #[getter]
    fn next_step_s(&self) -> f64 {
        self.lock().next_step_s()
    }

    /// Mean time between samples, s; None before the second.
    #[getter]
    fn mean_step_s(&self) -> Option<f64> {
        let clock = self.lock().clock;
        (clock.count > 1).then(|| (clock.latest_s - clock.first_s) / (clock.count - 1) as f64)
    }

    /// Samples that joined the selection since the last estimate, and how many are selected.
    #[getter]
    fn changes(&self) -> (u64, usize) {
        let state = self.lock();
        (state.core.changes(), state.core.selected())
    }

    /// Moving instants so far.
    #[getter]
    fn moving_seen(&self) -> u64 {
        self.lock().core.moving_seen()
    }

    /// Gyroscope bias of each sensor, rad/s, where rest has shown it.
    #[getter]
    fn gyr_bias(&self) -> [Option<Xyz>; 2] {
        self.lock().core.gyr_bias()
    }

    /// Misfit, rms relative rate (rad/s) and time in motion (s) under the given axes.
    fn witness(&self, axis1: Xyz, axis2: Xyz) -> (Option<f64>, f64, f64) {
        let w = self.lock().core.witness(&AxisPair::new(axis1.into(), axis2.into()));
        (w.misfit, w.relative_rate, w.moving_s)
    }

    /// The present motion under axes from before and fitted alone: both misfits, the fitted axes and their deviations (mean,
    /// std, rad). None until there is enough motion.
    fn refit(&self, axis1: Xyz, axis2: Xyz) -> Option<(f64, f64, Xyz, Xyz, Deviations)> {
        let state = self.lock();
        if state.core.present().count() < PRESENT_MOVING {
            return None;
        }
        let fit = refit(state.core.present(), &AxisPair::new(axis1.into(), axis2.into()))?;
        let deviations = tangent_covariance(&fit.covariance, &fit.axes.tangent()).map(|p| angular_deviation(&p));
        Some((fit.misfit_before, fit.misfit, fit.axes.j1.into(), fit.axes.j2.into(), deviations))
    }

    /// Times (s) of the chosen gyroscope and accelerometer samples.
    fn chosen_times(&self) -> (Vec<f64>, Vec<f64>) {
        let mut state = self.lock();
        let (gyr, acc) = state.core.chosen();
        let times = |chosen: &[Candidate]| chosen.iter().map(|c| c.time).collect::<Vec<_>>();
        (times(&gyr), times(acc))
    }

    /// Forgets what was learnt, but not the time.
    fn restart(&self) {
        self.lock().core.restart();
    }

    /// Everything it knows, as bytes.
    fn state<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        let state = self.lock();
        let mut bytes = state.clock.to_bytes();
        bytes.extend([state.step_s, state.waiting_s].map(f64::to_le_bytes).into_iter().flatten());
        bytes.extend(state.steps.to_le_bytes());
        bytes.extend(state.core.to_bytes());
        bytes.extend(imufast_core::checksum(&bytes).to_le_bytes());
        PyBytes::new(py, &bytes)
    }

    /// The stream that `state` wrote.
    #[staticmethod]
    fn restore(state: &[u8]) -> PyResult<Self> {
        let read = || {
            let (body, checksum) = state.split_last_chunk::<4>()?;
            if u32::from_le_bytes(*checksum) != imufast_core::checksum(body) {
                return None;
            }
            let (clock, body) = body.split_first_chunk::<40>()?;
            let (numbers, core) = body.split_first_chunk::<24>()?;
            let [step_s, waiting_s, steps] = *numbers.as_chunks::<8>().0 else { return None };
            let (step_s, waiting_s, steps) =
                (f64::from_le_bytes(step_s), f64::from_le_bytes(waiting_s), u64::from_le_bytes(steps));
            let (clock, core) = (Clock::from_bytes(clock)?, Core::from_bytes(core)?);
            let sound = step_s >= 1e-3 && step_s.is_finite() && waiting_s.is_finite() && steps < u64::MAX / 2;
            sound.then_some(State { core, clock, waiting_s, steps, step_s })
        };
        match read() {
            Some(state) => Ok(Self { state: Mutex::new(state) }),
            None => Err(PyValueError::new_err("state is damaged, or from another version of imufast")),
        }
    }
}

impl HingeStream {
    /// A panic elsewhere cannot leave the state unusable for good: it is plain data.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

fn take(state: &mut State, block: &Block<'_>, start: usize) -> usize {
    for (row, time, sample) in block.samples(start) {
        let t = time.unwrap_or(state.clock.count as f64 / state.clock.rate_hz);
        if state.clock.count == 0 {
            state.clock.first_s = t;
        }
        if t >= state.next_step_s() {
            state.waiting_s = t;
            return row;
        }
        state.core.push(t, &sample);
        state.clock.tick(t);
    }
    block.len()
}
