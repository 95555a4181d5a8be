//! Algorithm 1 and its evidence.

use imufast_core::{
    Xyz,
    hinge::{
        AxisPair, Evidence, HingeCost, Minimum, SolveOptions, Status, Weights, deterministic_starts,
        evidence::{angular_deviation as deviation, tangent_covariance},
        residual::gyr_residual,
        solve,
    },
};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods, nalgebra};
use pyo3::{exceptions::PyValueError, prelude::*};

use crate::arrays::{equal_lengths, pair, vector, xyz};

type Matrix<const N: usize> = [[f64; N]; N];

/// What Algorithm 1 found, and how far to trust it.
#[pyclass(frozen, get_all, module = "imufast._core")]
pub struct HingeFit {
    axis1: Xyz,
    axis2: Xyz,
    cost: f64,
    status: &'static str,
    iterations: usize,
    /// Every distinct minimum, best first: axis1, axis2, cost.
    minima: Vec<(Xyz, Xyz, f64)>,
    covariance: Matrix<6>,
    published_covariance: Matrix<6>,
    /// Mean and standard deviation of the angle between each axis and the truth, rad (eqs 64-65 in closed form).
    deviation: [(f64, f64); 2],
    published_deviation: [(f64, f64); 2],
    gyr_residual_std: f64,
    acc_residual_std: f64,
    /// Rms gyroscope residual over rms difference of the two rates: near 1 the axes explain nothing.
    unexplained: f64,
    pieces: usize,
}

/// Algorithm 1 on the given samples (all of them where an index is None), from the deterministic starts or from `starts`
/// (k, 2, 3).
#[pyfunction]
#[pyo3(signature = (gyr1, acc1, gyr2, acc2, time_s, gyr_index, acc_index, weight_ratio, starts, max_iterations))]
#[expect(clippy::too_many_arguments, reason = "one call from one place in Python, all by position")]
pub fn hinge_axis(
    py: Python<'_>,
    gyr1: PyReadonlyArray2<'_, f64>,
    acc1: PyReadonlyArray2<'_, f64>,
    gyr2: PyReadonlyArray2<'_, f64>,
    acc2: PyReadonlyArray2<'_, f64>,
    time_s: PyReadonlyArray1<'_, f64>,
    gyr_index: Option<PyReadonlyArray1<'_, i64>>,
    acc_index: Option<PyReadonlyArray1<'_, i64>>,
    weight_ratio: f64,
    starts: Option<PyReadonlyArray3<'_, f64>>,
    max_iterations: usize,
) -> PyResult<HingeFit> {
    let [gyr1, acc1, gyr2, acc2] = pair([&gyr1, &acc1, &gyr2, &acc2])?;
    let time = vector(&time_s, gyr1.len(), "time_s")?;
    let gyr = Chosen::new(time, gyr1, gyr2, &gyr_index, "gyr_index")?;
    let acc = Chosen::new(time, acc1, acc2, &acc_index, "acc_index")?;
    let starts = starts.as_ref().map(pairs).transpose()?;
    // Starts that the caller chose are each followed on all samples, as published.
    let options = SolveOptions { max_iterations, coarse_first: starts.is_none(), ..SolveOptions::default() };
    let (solution, evidence) = py.detach(|| {
        let cost = HingeCost::new(Weights::published(weight_ratio), gyr.iter(), acc.iter());
        let starts = starts.unwrap_or_else(|| deterministic_starts(&cost).to_vec());
        // Asking Python costs as much as a few hundred samples: small problems ask now and then.
        let (few, mut asked) = (cost.gyr_count() < 100_000, 0_u32);
        let mut go_on = || {
            asked = asked.wrapping_add(1);
            (few && !asked.is_multiple_of(64)) || Python::attach(|py| py.check_signals()).is_ok()
        };
        let solution = solve(&cost, &starts, &options, &mut go_on);
        let evidence = Evidence::at(&solution.best().axes, &cost);
        (solution, evidence)
    });
    let best = *solution.best();
    if best.status == Status::Interrupted {
        return Err(pyo3::exceptions::PyKeyboardInterrupt::new_err("stopped while searching the hinge axis"));
    }
    Ok(HingeFit {
        axis1: best.axes.j1.into(),
        axis2: best.axes.j2.into(),
        cost: best.cost,
        status: status_name(best.status),
        iterations: solution.iterations,
        minima: solution.minima.iter().map(|m: &Minimum| (m.axes.j1.into(), m.axes.j2.into(), m.cost)).collect(),
        covariance: evidence.covariance.into(),
        published_covariance: evidence.published_covariance.into(),
        deviation: deviations(&evidence.covariance, &best.axes),
        published_deviation: deviations(&evidence.published_covariance, &best.axes),
        gyr_residual_std: evidence.gyr_residual_std,
        acc_residual_std: evidence.acc_residual_std,
        unexplained: evidence.unexplained,
        pieces: evidence.pieces,
    })
}

/// Unweighted gyroscope residual (eq. 24) of every sample, rad/s, shape (N,).
#[pyfunction]
pub fn hinge_residuals<'py>(
    py: Python<'py>,
    gyr1: PyReadonlyArray2<'py, f64>,
    gyr2: PyReadonlyArray2<'py, f64>,
    axis1: Xyz,
    axis2: Xyz,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (gyr1, gyr2) = (xyz(&gyr1, "gyr1")?, xyz(&gyr2, "gyr2")?);
    equal_lengths(&[("gyr1", gyr1.len()), ("gyr2", gyr2.len())])?;
    let axes = AxisPair::new(axis1.into(), axis2.into());
    let tangent = axes.tangent();
    let residual = |(a, b): (&Xyz, &Xyz)| gyr_residual(&(*a).into(), &(*b).into(), &axes, &tangent).0;
    let residuals: Vec<f64> = py.detach(|| gyr1.iter().zip(gyr2).map(residual).collect());
    Ok(residuals.into_pyarray(py))
}

/// Mean and standard deviation, rad, of the length of a Gaussian vector with the 2x2 covariance `p` (rad²): eqs 64-65.
#[pyfunction]
pub fn angular_deviation(p: Matrix<2>) -> (f64, f64) {
    deviation(&nalgebra::Matrix2::from(p))
}

fn deviations(covariance: &nalgebra::Matrix6<f64>, axes: &AxisPair) -> [(f64, f64); 2] {
    tangent_covariance(covariance, &axes.tangent()).map(|p| deviation(&p))
}

pub fn status_name(status: Status) -> &'static str {
    match status {
        Status::Converged => "CONVERGED",
        Status::Stalled => "STALLED",
        Status::MaxIterations => "MAX_ITERATIONS",
        Status::NotIdentifiable => "NOT_IDENTIFIABLE",
        Status::NumericalError => "NUMERICAL_ERROR",
        Status::Interrupted => "INTERRUPTED",
    }
}

pub fn pairs(starts: &PyReadonlyArray3<'_, f64>) -> PyResult<Vec<AxisPair>> {
    let wrong = || PyValueError::new_err("starts must be a C-contiguous float64 array of shape (k, 2, 3) with k of 1 or more");
    match (starts.shape(), starts.as_slice()) {
        (&[k, 2, 3], Ok(flat)) if k > 0 && starts.is_c_contiguous() => Ok(flat
            .as_chunks::<6>()
            .0
            .iter()
            .map(|&[a, b, c, d, e, f]| AxisPair::new([a, b, c].into(), [d, e, f].into()))
            .collect()),
        _ => Err(wrong()),
    }
}

/// Simultaneous samples of both sensors, all or by index.
struct Chosen<'a> {
    time: &'a [f64],
    one: &'a [Xyz],
    two: &'a [Xyz],
    index: Option<&'a [i64]>,
}

impl<'a> Chosen<'a> {
    fn new(
        time: &'a [f64],
        one: &'a [Xyz],
        two: &'a [Xyz],
        index: &'a Option<PyReadonlyArray1<'_, i64>>,
        name: &str,
    ) -> PyResult<Self> {
        let index = match index {
            Some(array) => Some(array.as_slice().map_err(|e| PyValueError::new_err(format!("{name}: {e}")))?),
            None => None,
        };
        if let Some(bad) = index.and_then(|i| i.iter().find(|&&k| usize::try_from(k).map_or(true, |k| k >= one.len()))) {
            return Err(PyValueError::new_err(format!("{name} holds {bad}, outside the {} samples", one.len())));
        }
        Ok(Self { time, one, two, index })
    }

    fn iter(&self) -> impl Iterator<Item = (f64, &'a Xyz, &'a Xyz)> + '_ {
        let at = |k: usize| Some((*self.time.get(k)?, self.one.get(k)?, self.two.get(k)?));
        let count = self.index.map_or(self.one.len(), <[i64]>::len);
        (0..count).filter_map(move |n| match self.index {
            Some(index) => at(usize::try_from(*index.get(n)?).ok()?),
            None => at(n),
        })
    }
}
