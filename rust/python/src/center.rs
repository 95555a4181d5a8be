//! The joint centre: the stream, and the estimate from it or from given moments.

use std::sync::{Arc, Mutex, MutexGuard};

use imufast_core::{
    PairSample, Xyz,
    joint_center::{
        Unknowns,
        estimate::{Estimate, Request, estimate},
        ls,
        moments::Moments,
        residual::residual,
        solve::{Knowledge, Method, Status},
        stream::{CenterStream as Core, StreamSettings},
    },
    rigid_body::{Moment, Stencil},
};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods, nalgebra};
use pyo3::{exceptions::PyValueError, prelude::*, types::PyBytes};

use crate::{
    arrays::{equal_lengths, positive, vector, xyz},
    blocks::{Block, Clock},
    signals::join,
};

type Matrix<const N: usize> = [[f64; N]; N];

/// A joint centre as seen from both sensors (m), accelerometer biases (m/s²), and what they are worth.
#[pyclass(frozen, get_all, module = "imufast._core")]
pub struct CenterFit {
    in_sensor1: Xyz,
    in_sensor2: Xyz,
    acc_bias1: Xyz,
    acc_bias2: Xyz,
    /// Of the stacked centres, m².
    covariance: Matrix<6>,
    /// Of the stacked biases, (m/s²)².
    acc_bias_covariance: Matrix<6>,
    /// Directions of the stacked centres that the motion did not determine.
    undetermined: Vec<[f64; 6]>,
    acc_bias_undetermined: Vec<[f64; 6]>,
    status: &'static str,
    cost: f64,
    iterations: usize,
    residual_std: f64,
    unexplained: f64,
    pieces: usize,
    n_samples: usize,
}

impl CenterFit {
    fn new(fit: &Estimate, n_samples: usize) -> Self {
        let block = |from: usize| fit.evidence.covariance.fixed_view::<6, 6>(from, from).into_owned();
        let part = |from: usize, sign: f64| -> Xyz { (fit.solution.x.fixed_rows::<3>(from) * sign).into_owned().into() };
        let rows = |v: &[nalgebra::SVector<f64, 6>]| v.iter().map(|v| (*v).into()).collect();
        Self {
            in_sensor1: part(0, -1.0),
            in_sensor2: part(3, -1.0),
            acc_bias1: part(6, 1.0),
            acc_bias2: part(9, 1.0),
            covariance: block(0).into(),
            acc_bias_covariance: block(6).into(),
            undetermined: rows(&fit.open),
            acc_bias_undetermined: rows(&fit.open_bias),
            status: status_name(fit.solution.status),
            cost: fit.solution.cost,
            iterations: fit.solution.iterations,
            residual_std: fit.evidence.residual_std,
            unexplained: fit.evidence.unexplained,
            pieces: fit.evidence.pieces,
            n_samples,
        }
    }
}

fn status_name(status: Status) -> &'static str {
    match status {
        Status::Converged => "CONVERGED",
        Status::Stalled => "STALLED",
        Status::MaxIterations => "MAX_ITERATIONS",
        Status::NumericalError => "NUMERICAL_ERROR",
        Status::Interrupted => "INTERRUPTED",
    }
}

/// SS, SA or Huber on given moments.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "one call from one place in Python, all by position")]
pub fn fit_center(
    py: Python<'_>,
    moments: [PyReadonlyArray2<'_, f64>; 6],
    time_s: PyReadonlyArray1<'_, f64>,
    method: &str,
    bias_std: f64,
    lever_std: f64,
    correlated: f64,
    gyr_bias_std: f64,
    axis: Option<[Xyz; 2]>,
    undetermined_std: f64,
    minimum_norm: bool,
    max_iterations: usize,
) -> PyResult<CenterFit> {
    let moments = read_moments(&moments, &time_s)?;
    let knowledge = Knowledge { bias_std, lever_std, correlated, gyr_bias_std };
    let request = request(method, knowledge, axis, undetermined_std, minimum_norm, max_iterations)?;
    solve(py, &moments, &request)
}

/// LS (eqs 10-14) on given moments and relative orientations (N, 4): centres, biases, their covariance, residual std.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "one call from one place in Python, all by position")]
pub fn fit_center_linear(
    py: Python<'_>,
    moments: [PyReadonlyArray2<'_, f64>; 6],
    time_s: PyReadonlyArray1<'_, f64>,
    q_12: PyReadonlyArray2<'_, f64>,
    bias_std: f64,
    lever_std: f64,
    correlated: f64,
    gyr_bias_std: f64,
    axis: Option<[Xyz; 2]>,
    undetermined_std: f64,
) -> PyResult<CenterFit> {
    let moments = read_moments(&moments, &time_s)?;
    let knowledge = Knowledge { bias_std, lever_std, correlated, gyr_bias_std };
    solve_linear(py, &moments, &q_12, &knowledge, axis, undetermined_std)
}

fn solve_linear(
    py: Python<'_>,
    moments: &Moments,
    q_12: &PyReadonlyArray2<'_, f64>,
    knowledge: &Knowledge,
    axis: Option<[Xyz; 2]>,
    undetermined_std: f64,
) -> PyResult<CenterFit> {
    let rotations: Vec<_> = match (q_12.shape(), q_12.as_slice()) {
        (&[n, 4], Ok(flat)) if q_12.is_c_contiguous() && n == moments.len() => {
            let chunks = flat.as_chunks::<4>().0;
            let unit =
                |&[w, x, y, z]: &[f64; 4]| nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
            chunks.iter().map(unit).collect()
        }
        _ => {
            return Err(PyValueError::new_err(format!(
                "q_12 must be a C-contiguous float64 array of shape ({}, 4), got shape {:?}",
                moments.len(),
                q_12.shape()
            )));
        }
    };
    let axis = axis.map(|pair| pair.map(Into::into));
    let fit = py.detach(|| ls::estimate(moments, &rotations, knowledge, axis, undetermined_std));
    Ok(CenterFit::new(&fit, moments.len()))
}

fn solve(py: Python<'_>, moments: &Moments, request: &Request) -> PyResult<CenterFit> {
    let fit = py.detach(|| estimate(moments, request, &mut || Python::attach(|py| py.check_signals()).is_ok()));
    if fit.solution.status == Status::Interrupted {
        return Err(pyo3::exceptions::PyKeyboardInterrupt::new_err("stopped while searching the joint centre"));
    }
    Ok(CenterFit::new(&fit, moments.len()))
}

fn request(
    method: &str,
    knowledge: Knowledge,
    axis: Option<[Xyz; 2]>,
    undetermined_std: f64,
    minimum_norm: bool,
    max_iterations: usize,
) -> PyResult<Request> {
    let method = match method {
        "ss" => Method::Squares,
        "huber" => Method::Huber,
        "sa" => Method::Absolute,
        other => return Err(PyValueError::new_err(format!("method must be ss, huber or sa, got {other:?}"))),
    };
    let axis = axis.map(|pair| pair.map(Into::into));
    Ok(Request { method, knowledge, axis, undetermined_std, minimum_norm, max_iterations })
}

const NAMES: [&str; 6] = ["gyr1", "gyr_dot1", "acc1", "gyr2", "gyr_dot2", "acc2"];

fn read_moments(arrays: &[PyReadonlyArray2<'_, f64>; 6], time_s: &PyReadonlyArray1<'_, f64>) -> PyResult<Moments> {
    let [gyr1, dot1, acc1, gyr2, dot2, acc2] = arrays;
    let slices = [
        xyz(gyr1, "gyr1")?,
        xyz(dot1, "gyr_dot1")?,
        xyz(acc1, "acc1")?,
        xyz(gyr2, "gyr2")?,
        xyz(dot2, "gyr_dot2")?,
        xyz(acc2, "acc2")?,
    ];
    let lengths: Vec<_> = NAMES.into_iter().zip(slices.map(<[Xyz]>::len)).collect();
    equal_lengths(&lengths)?;
    let [gyr1, dot1, acc1, gyr2, dot2, acc2] = slices;
    let time = vector(time_s, gyr1.len(), "time_s")?;
    let mut moments = Moments::default();
    for ((((((t, g1), d1), a1), g2), d2), a2) in time.iter().zip(gyr1).zip(dot1).zip(acc1).zip(gyr2).zip(dot2).zip(acc2) {
        moments.push(&Moment { time_s: *t, sample: join(g1, a1, g2, a2), gyr_dot1: *d1, gyr_dot2: *d2 });
    }
    Ok(moments)
}

struct State {
    /// Shared with estimates that are under way in other threads; a push then goes on with a copy.
    core: Arc<Core>,
    clock: Clock,
}

/// The joint centre from a stream, in bounded memory.
#[pyclass(frozen, module = "imufast._core")]
pub struct CenterStream {
    state: Mutex<State>,
}

#[pymethods]
impl CenterStream {
    #[new]
    fn new(
        rate_hz: f64,
        lowpass_hz: f64,
        five_points: bool,
        least_rate: f64,
        max_samples: usize,
        gyr_bias: Option<[Xyz; 2]>,
        bias_from_rest: bool,
    ) -> PyResult<Self> {
        positive(rate_hz, "rate_hz")?;
        let stencil = if five_points { Stencil::Five } else { Stencil::Three };
        let settings = StreamSettings { rate_hz, lowpass_hz, stencil, least_rate, max_samples, gyr_bias, bias_from_rest };
        if !settings.windows_are_bounded() {
            return Err(PyValueError::new_err(format!(
                "rate_hz {rate_hz} makes the window of lowpass_hz {lowpass_hz} longer than 100000 samples"
            )));
        }
        Ok(Self { state: Mutex::new(State { core: Arc::new(Core::new(settings)), clock: Clock::new(rate_hz) }) })
    }

    /// Takes samples (N, 3) or one (3,); nothing is taken from bad arrays. `trusted`: values and times are known to be sound.
    #[pyo3(signature = (gyr1, acc1, gyr2, acc2, time_s, trusted = false))]
    #[expect(clippy::too_many_arguments, reason = "one call from one place in Python, all by position")]
    fn push(
        &self,
        py: Python<'_>,
        gyr1: PyReadonlyArrayDyn<'_, f64>,
        acc1: PyReadonlyArrayDyn<'_, f64>,
        gyr2: PyReadonlyArrayDyn<'_, f64>,
        acc2: PyReadonlyArrayDyn<'_, f64>,
        time_s: Option<PyReadonlyArrayDyn<'_, f64>>,
        trusted: bool,
    ) -> PyResult<()> {
        let block = Block::new([&gyr1, &acc1, &gyr2, &acc2], time_s.as_ref())?;
        let mut state = self.lock();
        if !trusted {
            block.check(&state.clock)?;
        }
        state.clock.timed = Some(block.timed());
        if block.len() < 64 {
            state.take(block.samples(0));
            return Ok(());
        }
        drop(state);
        for start in (0..block.len()).step_by(SIGNALS_EVERY) {
            py.detach(|| self.lock().take(block.samples(start).take(SIGNALS_EVERY)));
            py.check_signals()?;
        }
        Ok(())
    }

    /// Estimates the centre from what there is.
    #[expect(clippy::too_many_arguments, reason = "one call from one place in Python, all by position")]
    fn fit(
        &self,
        py: Python<'_>,
        method: &str,
        bias_std: f64,
        lever_std: f64,
        gyr_bias_std: f64,
        axis: Option<[Xyz; 2]>,
        undetermined_std: f64,
        minimum_norm: bool,
        max_iterations: usize,
    ) -> PyResult<CenterFit> {
        let core = self.core();
        let knowledge = Knowledge { bias_std, lever_std, correlated: core.settings().correlated(), gyr_bias_std };
        solve(py, core.moments(), &request(method, knowledge, axis, undetermined_std, minimum_norm, max_iterations)?)
    }

    /// Estimates the centre by LS with one orientation for each of `times`.
    #[expect(clippy::too_many_arguments, reason = "one call from one place in Python, all by position")]
    fn fit_linear(
        &self,
        py: Python<'_>,
        q_12: PyReadonlyArray2<'_, f64>,
        bias_std: f64,
        lever_std: f64,
        gyr_bias_std: f64,
        axis: Option<[Xyz; 2]>,
        undetermined_std: f64,
    ) -> PyResult<CenterFit> {
        let core = self.core();
        let knowledge = Knowledge { bias_std, lever_std, correlated: core.settings().correlated(), gyr_bias_std };
        solve_linear(py, core.moments(), &q_12, &knowledge, axis, undetermined_std)
    }

    /// Times of the instants that an estimate rests on, s.
    fn times<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.core().moments().time_s().to_vec().into_pyarray(py)
    }

    /// Times (s) and residuals (eq. 16, m/s²) of about `most` of these at the given centre and biases.
    fn residuals<'py>(
        &self,
        py: Python<'py>,
        in_sensor1: Xyz,
        in_sensor2: Xyz,
        acc_bias1: Xyz,
        acc_bias2: Xyz,
        most: usize,
    ) -> (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>) {
        let core = self.core();
        let moments = core.moments();
        let mut x = Unknowns::zeros();
        let parts = [in_sensor1.map(|v| -v), in_sensor2.map(|v| -v), acc_bias1, acc_bias2];
        for (slot, value) in x.iter_mut().zip(parts.iter().flatten()) {
            *slot = *value;
        }
        let places = || (0..moments.len()).step_by(moments.len().div_ceil(most.max(1)).max(1));
        let times: Vec<f64> = places().filter_map(|k| moments.time_s().get(k).copied()).collect();
        let residuals: Vec<f64> = places().map(|k| residual(&moments.at(k), &x).0).collect();
        (times.into_pyarray(py), residuals.into_pyarray(py))
    }

    /// Neighbouring moments of which so many tell as much as one alone.
    #[getter]
    fn correlated(&self) -> f64 {
        self.lock().core.settings().correlated()
    }

    /// By how much the moments are late, s.
    #[getter]
    fn delay_s(&self) -> f64 {
        self.lock().core.delay_s()
    }

    /// Samples taken so far.
    #[getter]
    fn count(&self) -> u64 {
        self.lock().clock.count
    }

    /// Gyroscope bias of each sensor, rad/s, where rest has shown it.
    #[getter]
    fn gyr_bias(&self) -> [Option<Xyz>; 2] {
        self.lock().core.gyr_bias()
    }

    /// Everything it knows, as bytes.
    fn state<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        let state = self.lock();
        let mut bytes = state.clock.to_bytes();
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
            let (clock, core) = body.split_first_chunk::<40>()?;
            Some(State { clock: Clock::from_bytes(clock)?, core: Arc::new(Core::from_bytes(core)?) })
        };
        match read() {
            Some(state) => Ok(Self { state: Mutex::new(state) }),
            None => Err(PyValueError::new_err("state is damaged, or from another version of imufast")),
        }
    }
}

/// Rows between two questions whether the user wants to stop: a few milliseconds.
const SIGNALS_EVERY: usize = 100_000;

impl CenterStream {
    /// A panic elsewhere cannot leave the state unusable for good: it is plain data.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    fn core(&self) -> Arc<Core> {
        Arc::clone(&self.lock().core)
    }
}

impl State {
    fn take(&mut self, samples: impl Iterator<Item = (usize, Option<f64>, PairSample)>) {
        let core = Arc::make_mut(&mut self.core);
        let clock = &mut self.clock;
        core.push(samples.map(|(_, time, sample)| {
            let t = time.unwrap_or(clock.count as f64 / clock.rate_hz);
            clock.tick(t);
            (t, sample)
        }));
    }
}
