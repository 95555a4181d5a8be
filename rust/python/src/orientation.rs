//! The relative-orientation filters.

use std::sync::{Mutex, MutexGuard};

use imufast_core::{
    PairSample, Xyz,
    orientation::{
        Complementary, Done, Filter as Core, Innovations, Joint, Mekf, Noise, Outliers, Page, Settings, Signals, Status,
        innovations, lane::Real, method::Method, run, run_batch,
    },
};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn, PyReadwriteArray1,
    PyReadwriteArray2, PyUntypedArrayMethods, ndarray::Array2,
};
use pyo3::{
    exceptions::{PyKeyboardInterrupt, PyValueError},
    prelude::*,
    types::PyBytes,
};

use crate::{
    arrays::{pair, vector},
    blocks::{Block, Clock},
};

/// A filter and what it works with; a dict of these names.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct FilterPlan {
    /// "complementary" or "mekf".
    method: String,
    single: bool,
    rate_hz: f64,
    r1: Xyz,
    r2: Xyz,
    gyr_bias: [Xyz; 2],
    acc_bias: [Xyz; 2],
    relative_bias_std: f64,
    gyr_std: f64,
    acc_std: f64,
    scale_noise: f64,
    midpoint: bool,
    start: Option<[f64; 4]>,
    start_given_std: f64,
    start_std: f64,
    start_fade_s: f64,
    max_gap_s: f64,
    restart: bool,
    /// Of the complementary filter; else ignored.
    beta: f64,
    beta_extra: f64,
    settle_s: f64,
    heading_gain: f64,
    soft_angle: f64,
    drift_limit: f64,
    bias_gain: f64,
    literal: bool,
    /// Of the Kalman filter; else ignored: "none", "reject" or "downweight".
    outliers: String,
    limit: f64,
    adapt: bool,
}

impl FilterPlan {
    fn settings(&self) -> PyResult<Settings> {
        let settings = Settings {
            rate_hz: self.rate_hz,
            joint: Joint {
                r1: self.r1,
                r2: self.r2,
                gyr_bias: self.gyr_bias,
                acc_bias: self.acc_bias,
                relative_bias_std: self.relative_bias_std,
            },
            noise: Noise { gyr_std: self.gyr_std, acc_std: self.acc_std },
            scale_noise: self.scale_noise,
            midpoint: self.midpoint,
            given: self.start.map(|q| (q, self.start_given_std)),
            start_std: self.start_std,
            start_fade_s: self.start_fade_s,
            max_gap_s: self.max_gap_s,
            restart: self.restart,
        };
        if settings.are_sound() {
            return Ok(settings);
        }
        Err(PyValueError::new_err("a setting of the filter is out of its range"))
    }

    fn complementary(&self) -> Complementary {
        Complementary {
            beta: self.beta,
            beta_extra: self.beta_extra,
            settle_s: self.settle_s,
            heading_gain: self.heading_gain,
            soft_angle: self.soft_angle,
            drift_limit: self.drift_limit,
            bias_gain: self.bias_gain,
            literal: self.literal,
        }
    }

    fn mekf(&self) -> PyResult<Mekf> {
        let outliers = match self.outliers.as_str() {
            "none" => Outliers::Keep,
            "reject" => Outliers::Reject,
            "downweight" => Outliers::Downweight,
            other => return Err(PyValueError::new_err(format!("outliers must be none, reject or downweight, got {other:?}"))),
        };
        Ok(Mekf { outliers, limit: self.limit, adapt: self.adapt })
    }

    fn kind(&self) -> PyResult<Kind> {
        match (self.method.as_str(), self.single) {
            ("complementary", false) => Ok(Kind::Complementary),
            ("complementary", true) => Ok(Kind::ComplementarySingle),
            ("mekf", false) => Ok(Kind::Mekf),
            ("mekf", true) => Ok(Kind::MekfSingle),
            (other, _) => Err(PyValueError::new_err(format!("method must be complementary or mekf, got {other:?}"))),
        }
    }
}

#[derive(Clone, Copy)]
enum Kind {
    Complementary,
    ComplementarySingle,
    Mekf,
    MekfSingle,
}

enum Any {
    Complementary(Core<f64, Complementary>),
    ComplementarySingle(Core<f32, Complementary>),
    Mekf(Core<f64, Mekf>),
    MekfSingle(Core<f32, Mekf>),
}

/// The same expression for whichever filter it is.
macro_rules! with {
    ($any:expr, $filter:ident => $value:expr) => {
        match $any {
            Any::Complementary($filter) => $value,
            Any::ComplementarySingle($filter) => $value,
            Any::Mekf($filter) => $value,
            Any::MekfSingle($filter) => $value,
        }
    };
}

impl Any {
    fn new(plan: &FilterPlan) -> PyResult<Self> {
        let settings = plan.settings()?;
        Ok(match plan.kind()? {
            Kind::Complementary => Self::Complementary(Core::new(settings, plan.complementary())),
            Kind::ComplementarySingle => Self::ComplementarySingle(Core::new(settings, plan.complementary())),
            Kind::Mekf => Self::Mekf(Core::new(settings, plan.mekf()?)),
            Kind::MekfSingle => Self::MekfSingle(Core::new(settings, plan.mekf()?)),
        })
    }

    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let double = || Core::from_bytes(bytes).map(Self::Mekf).or_else(|| Core::from_bytes(bytes).map(Self::Complementary));
        let single =
            || Core::from_bytes(bytes).map(Self::MekfSingle).or_else(|| Core::from_bytes(bytes).map(Self::ComplementarySingle));
        double().or_else(single)
    }
}

fn status_name(status: Status) -> &'static str {
    match status {
        Status::Starting => "starting",
        Status::Tracking => "tracking",
        Status::Coasting => "coasting",
    }
}

struct State {
    filter: Any,
    clock: Clock,
}

/// A filter fed sample by sample.
#[pyclass(frozen, module = "imufast._core")]
pub struct OrientationFilter {
    state: Mutex<State>,
}

/// Python is asked for signals after so many samples.
const SIGNALS_EVERY: usize = 100_000;

#[pymethods]
impl OrientationFilter {
    #[new]
    fn new(plan: FilterPlan) -> PyResult<Self> {
        let state = State { filter: Any::new(&plan)?, clock: Clock::new(plan.rate_hz) };
        Ok(Self { state: Mutex::new(state) })
    }

    /// Takes one sample (3,) or a block (N, 3) and gives q_12 (4,) or (N, 4), at each sample's own time.
    #[pyo3(signature = (gyr1, acc1, gyr2, acc2, time_s = None))]
    fn update<'py>(
        &self,
        py: Python<'py>,
        gyr1: PyReadonlyArrayDyn<'py, f64>,
        acc1: PyReadonlyArrayDyn<'py, f64>,
        gyr2: PyReadonlyArrayDyn<'py, f64>,
        acc2: PyReadonlyArrayDyn<'py, f64>,
        time_s: Option<PyReadonlyArrayDyn<'py, f64>>,
    ) -> PyResult<Py<PyAny>> {
        let block = Block::new([&gyr1, &acc1, &gyr2, &acc2], time_s.as_ref())?;
        block.check(&self.lock().clock)?;
        if gyr1.ndim() == 1 {
            let q = self.take(&block, 0, 1).pop().unwrap_or([1.0, 0.0, 0.0, 0.0]);
            return Ok(PyArray1::from_slice(py, &q).into_any().unbind());
        }
        let mut quaternions = Vec::with_capacity(block.len());
        for start in (0..block.len()).step_by(SIGNALS_EVERY) {
            quaternions.extend(py.detach(|| self.take(&block, start, SIGNALS_EVERY)));
            py.check_signals()?;
        }
        Ok(rows(py, quaternions)?.into_any().unbind())
    }

    /// Standard deviation of the latest estimate, the root of the trace of its covariance, rad.
    #[getter]
    fn angle_std(&self) -> f64 {
        with!(&self.lock().filter, f => f.latest().std)
    }

    /// "starting", "tracking" or "coasting".
    #[getter]
    fn status(&self) -> &'static str {
        status_name(with!(&self.lock().filter, f => f.latest().status))
    }

    /// Mean square of the joint's horizontal acceleration over the last ten seconds, (m/s²)².
    #[getter]
    fn heading_power(&self) -> f64 {
        with!(&self.lock().filter, f => f.heading_power())
    }

    #[getter]
    fn restarts(&self) -> u32 {
        with!(&self.lock().filter, f => f.restarts())
    }

    /// The accelerations of a sample are used so much later, s.
    #[getter]
    fn delay_s(&self) -> f64 {
        let state = self.lock();
        with!(&state.filter, f => f.delay_samples()) as f64 / state.clock.rate_hz
    }

    fn state<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        let state = self.lock();
        let mut bytes = state.clock.to_bytes();
        bytes.extend(imufast_core::checksum(&bytes).to_le_bytes());
        bytes.extend(with!(&state.filter, f => f.to_bytes()));
        PyBytes::new(py, &bytes)
    }

    #[staticmethod]
    fn restore(state: &[u8]) -> PyResult<Self> {
        let damaged = || PyValueError::new_err("state is damaged, of another version, or not of an orientation filter");
        let (clock, rest) = state.split_first_chunk::<40>().ok_or_else(damaged)?;
        let (checksum, rest) = rest.split_first_chunk::<4>().ok_or_else(damaged)?;
        if u32::from_le_bytes(*checksum) != imufast_core::checksum(clock) {
            return Err(damaged());
        }
        let clock = Clock::from_bytes(clock).ok_or_else(damaged)?;
        let filter = Any::from_bytes(rest).ok_or_else(damaged)?;
        if with!(&filter, f => f.settings().rate_hz) != clock.rate_hz {
            return Err(damaged());
        }
        Ok(Self { state: Mutex::new(State { filter, clock }) })
    }
}

impl OrientationFilter {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    fn take(&self, block: &Block<'_>, start: usize, most: usize) -> Vec<[f64; 4]> {
        let mut state = self.lock();
        let State { filter, clock } = &mut *state;
        clock.timed = Some(block.timed());
        let samples = block.samples(start).take(most);
        with!(filter, f => samples
            .map(|(_, time, sample): (usize, Option<f64>, PairSample)| {
                let time = time.unwrap_or(clock.count as f64 / clock.rate_hz);
                clock.tick(time);
                f.push(time, &sample);
                f.latest().q
            })
            .collect())
    }
}

fn rows<const N: usize>(py: Python<'_>, rows: Vec<[f64; N]>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let array = Array2::from_shape_vec((rows.len(), N), rows.into_flattened());
    Ok(array.map_err(|e| PyValueError::new_err(e.to_string()))?.into_pyarray(py))
}

/// Memory of the caller for so many estimates: q_12 (N, 4) and its standard deviation (N,).
fn page<'a>(
    q_12: &'a mut PyReadwriteArray2<'_, f64>,
    std_deg: &'a mut PyReadwriteArray1<'_, f64>,
    count: usize,
) -> PyResult<(&'a mut [[f64; 4]], &'a mut [f64])> {
    if q_12.shape() != [count, 4] || std_deg.len() != count {
        return Err(PyValueError::new_err(format!("q_12 and std_deg must have room for {count} estimates")));
    }
    match (q_12.is_c_contiguous(), q_12.as_slice_mut(), std_deg.as_slice_mut()) {
        (true, Ok(q), Ok(std)) => Ok((q.as_chunks_mut().0, std)),
        _ => Err(PyValueError::new_err("q_12 and std_deg must be C-contiguous")),
    }
}

/// Of one recording: how often the filter started anew, the rows (from, to) in which it looked for a start, and how many
/// estimates are vaguer than asked.
type Ended = (u32, Vec<(usize, usize)>, usize);

/// Standard deviations become degrees. What a filter would pass over in silence is an error here.
fn ended(done: Done, signals: &Signals<'_>, std: &mut [f64], vague_deg: f64) -> PyResult<Ended> {
    if done.rows.len() < signals.len() {
        return Err(PyValueError::new_err(signals.fault().unwrap_or("some samples could not be taken")));
    }
    let mut vague = 0;
    for std in std.get_mut(done.rows).unwrap_or_default() {
        // Beyond half a turn an angle says no more.
        *std = std.to_degrees().min(180.0);
        vague += usize::from(*std > vague_deg);
    }
    Ok((done.restarts, done.starts.into_iter().map(|s| (s.start, s.end)).collect(), vague))
}

fn stopped() -> PyErr {
    PyKeyboardInterrupt::new_err("stopped while tracking the orientation")
}

/// A whole recording, every estimate at its own sample, written to `q_12` (N, 4) and `std_deg` (N,), whatever is in them.
/// Those of more than `vague_deg` are counted.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // as Python gives them
pub fn track_filter<'py>(
    py: Python<'py>,
    gyr1: PyReadonlyArray2<'py, f64>,
    acc1: PyReadonlyArray2<'py, f64>,
    gyr2: PyReadonlyArray2<'py, f64>,
    acc2: PyReadonlyArray2<'py, f64>,
    time_s: Option<PyReadonlyArray1<'py, f64>>,
    plan: FilterPlan,
    mut q_12: PyReadwriteArray2<'py, f64>,
    mut std_deg: PyReadwriteArray1<'py, f64>,
    vague_deg: f64,
) -> PyResult<Ended> {
    let xyz = pair([&gyr1, &acc1, &gyr2, &acc2])?;
    let [first, ..] = xyz;
    let time_s = time_s.as_ref().map(|t| vector(t, first.len(), "time_s")).transpose()?;
    let signals = Signals { xyz, time_s };
    let settings = plan.settings()?;
    fn go<T: Real, M: Method>(
        py: Python<'_>,
        settings: &Settings,
        method: M,
        signals: &Signals<'_>,
        page: Page<'_>,
    ) -> Option<Done> {
        let mut go_on = || Python::attach(|py| py.check_signals()).is_ok();
        py.detach(|| run::<T, M>(settings, method, signals, page, &mut go_on)).map(|(done, _)| done)
    }
    let (q, std) = page(&mut q_12, &mut std_deg, signals.len())?;
    let page = Page::new(q, std);
    let done = match plan.kind()? {
        Kind::Complementary => go::<f64, _>(py, &settings, plan.complementary(), &signals, page),
        Kind::ComplementarySingle => go::<f32, _>(py, &settings, plan.complementary(), &signals, page),
        Kind::Mekf => go::<f64, _>(py, &settings, plan.mekf()?, &signals, page),
        Kind::MekfSingle => go::<f32, _>(py, &settings, plan.mekf()?, &signals, page),
    };
    ended(done.ok_or_else(stopped)?, &signals, std, vague_deg)
}

/// Innovations (N, 3) and their normalised squares (N,).
type Foreseen<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// What a filter did not foresee of a recording: innovations (N, 3), m/s² in the frame of sensor 2, and their normalised squares
/// (N,); NaN where none was used.
#[pyfunction]
pub fn filter_innovations<'py>(
    py: Python<'py>,
    gyr1: PyReadonlyArray2<'py, f64>,
    acc1: PyReadonlyArray2<'py, f64>,
    gyr2: PyReadonlyArray2<'py, f64>,
    acc2: PyReadonlyArray2<'py, f64>,
    time_s: PyReadonlyArray1<'py, f64>,
    plan: FilterPlan,
) -> PyResult<Foreseen<'py>> {
    let xyz = pair([&gyr1, &acc1, &gyr2, &acc2])?;
    let [first, ..] = xyz;
    let signals = Signals { xyz, time_s: Some(vector(&time_s, first.len(), "time_s")?) };
    if let Some(fault) = signals.fault() {
        return Err(PyValueError::new_err(fault));
    }
    let settings = plan.settings()?;
    let (complementary, mekf) = (plan.complementary(), plan.mekf()?);
    let mut go_on = || Python::attach(|py| py.check_signals()).is_ok();
    let kind = plan.kind()?;
    let done = py.detach(|| match kind {
        Kind::Complementary => innovations::<f64, _>(&settings, complementary, &signals, &mut go_on),
        Kind::ComplementarySingle => innovations::<f32, _>(&settings, complementary, &signals, &mut go_on),
        Kind::Mekf => innovations::<f64, _>(&settings, mekf, &signals, &mut go_on),
        Kind::MekfSingle => innovations::<f32, _>(&settings, mekf, &signals, &mut go_on),
    });
    let Innovations { innovation, nis } = done.ok_or_else(stopped)?;
    Ok((rows(py, innovation)?, nis.into_pyarray(py)))
}

type Arrays<'py> = (
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    Option<PyReadonlyArray1<'py, f64>>,
);

/// Many recordings (gyr1, acc1, gyr2, acc2, time_s) with a plan each, side by side; all plans name the method and precision of
/// the first. As `track_filter`, all one after the other in `q_12` and `std_deg`.
#[pyfunction]
pub fn track_filter_batch<'py>(
    py: Python<'py>,
    recordings: Vec<Arrays<'py>>,
    plans: Vec<FilterPlan>,
    mut q_12: PyReadwriteArray2<'py, f64>,
    mut std_deg: PyReadwriteArray1<'py, f64>,
    vague_deg: f64,
) -> PyResult<Vec<Ended>> {
    let Some(first) = plans.first() else { return Ok(Vec::new()) };
    if plans.len() != recordings.len() {
        return Err(PyValueError::new_err(format!("{} recordings but {} plans", recordings.len(), plans.len())));
    }
    let mut all = Vec::with_capacity(plans.len());
    for ((gyr1, acc1, gyr2, acc2, time_s), plan) in recordings.iter().zip(&plans) {
        let xyz = pair([gyr1, acc1, gyr2, acc2])?;
        let [first, ..] = xyz;
        let time_s = time_s.as_ref().map(|t| vector(t, first.len(), "time_s")).transpose()?;
        all.push((plan.settings()?, Signals { xyz, time_s }));
    }
    let (q, std) = page(&mut q_12, &mut std_deg, all.iter().map(|(_, signals)| signals.len()).sum())?;
    let page = Page::new(q, std);
    let mut go_on = || Python::attach(|py| py.check_signals()).is_ok();
    let (complementary, mekf) = (first.complementary(), first.mekf()?);
    let done = match first.kind()? {
        Kind::Complementary => py.detach(|| run_batch::<f64, _>(complementary, &all, page, &mut go_on)),
        Kind::ComplementarySingle => py.detach(|| run_batch::<f32, _>(complementary, &all, page, &mut go_on)),
        Kind::Mekf => py.detach(|| run_batch::<f64, _>(mekf, &all, page, &mut go_on)),
        Kind::MekfSingle => py.detach(|| run_batch::<f32, _>(mekf, &all, page, &mut go_on)),
    };
    let done = done.ok_or_else(stopped)?.into_iter().zip(&all);
    done.map(|(done, (_, signals))| ended(done, signals, std, vague_deg)).collect()
}
