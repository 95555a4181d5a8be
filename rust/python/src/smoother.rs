//! Smoothed relative orientation.

use imufast_core::orientation::smoother::{self, Options, Prior, Status};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
    nalgebra::{SMatrix, SVector},
    ndarray::Array2,
};
use pyo3::{
    exceptions::{PyKeyboardInterrupt, PyValueError},
    prelude::*,
};

use crate::arrays::{pair, positive, vector};

/// Unknown constants: lever arms r_1, r_2 (from the joint centre to the sensor), accelerometer biases, gyroscope biases.
const CONSTANTS: usize = 18;

/// A smoothed recording, and how far to trust it.
#[pyclass(frozen, get_all, module = "imufast._core")]
pub struct SmootherFit {
    /// (N, 4), sensor 2 to sensor 1.
    q_12: Py<PyArray2<f64>>,
    /// (N, 6): xx, yy, zz, xy, xz, yz of the error's covariance in sensor frame 2, rad²; infinite where unsolved.
    covariance: Py<PyArray2<f64>>,
    /// The same if the constants were known.
    covariance_known: Py<PyArray2<f64>>,
    /// (18,)
    constants: Py<PyArray1<f64>>,
    /// (18, 18)
    constants_covariance: Py<PyArray2<f64>>,
    status: &'static str,
    iterations: usize,
    /// Scale of the link residuals, m/s².
    link_std: f64,
    /// What the gyroscopes' errors add up to, rad/√s.
    drift_std: f64,
    /// What a link counts for as information, of what its curvature says.
    trust: f64,
    /// (K,) sample of every link there is, and (K,) the square of its residual over its scale.
    link_samples: Py<PyArray1<usize>>,
    link_squares: Py<PyArray1<f64>>,
}

/// The relative orientation that is most probable over a whole recording. `prior_mean` (18,) and `prior_precision` (18, 18)
/// say what is known of the constants beforehand.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "one call from one place in Python, all by position")]
pub fn smooth_orientation(
    py: Python<'_>,
    gyr1: PyReadonlyArray2<'_, f64>,
    acc1: PyReadonlyArray2<'_, f64>,
    gyr2: PyReadonlyArray2<'_, f64>,
    acc2: PyReadonlyArray2<'_, f64>,
    time_s: PyReadonlyArray1<'_, f64>,
    rate_hz: f64,
    prior_mean: PyReadonlyArray1<'_, f64>,
    prior_precision: PyReadonlyArray2<'_, f64>,
    window_s: f64,
    key_step_s: f64,
    bridge_s: f64,
    tail: f64,
    drift_std: Option<f64>,
    link_std: Option<f64>,
    rest_bias_std: Option<f64>,
    max_iterations: usize,
) -> PyResult<SmootherFit> {
    let [gyr1, acc1, gyr2, acc2] = pair([&gyr1, &acc1, &gyr2, &acc2])?;
    let time = vector(&time_s, gyr1.len(), "time_s")?;
    if time.is_empty() {
        return Err(PyValueError::new_err("time_s is empty: give at least one sample"));
    }
    for (value, name) in
        [(rate_hz, "rate_hz"), (window_s, "window_s"), (key_step_s, "key_step_s"), (bridge_s, "bridge_s"), (tail, "tail")]
    {
        positive(value, name)?;
    }
    for (value, name) in [(drift_std, "drift_std"), (link_std, "link_std"), (rest_bias_std, "rest_bias_std")] {
        value.map_or(Ok(()), |v| positive(v, name))?;
    }
    let mean = vector(&prior_mean, CONSTANTS, "prior_mean")?;
    let precision = match (prior_precision.shape(), prior_precision.as_slice()) {
        (&[CONSTANTS, CONSTANTS], Ok(flat)) => SMatrix::<f64, CONSTANTS, CONSTANTS>::from_row_slice(flat),
        _ => return Err(PyValueError::new_err("prior_precision must be a contiguous float64 array of shape (18, 18)")),
    };
    let prior = Prior { mean: SVector::from_column_slice(mean), precision };
    let options = Options { window_s, key_step_s, bridge_s, tail, drift_std, link_std, rest_bias_std, max_iterations };
    let smoothed = py.detach(|| {
        let mut go_on = || Python::attach(|py| py.check_signals()).is_ok();
        smoother::smooth(time, [gyr1, gyr2], [acc1, acc2], 1.0 / rate_hz, &prior, &options, &mut go_on)
    });
    if smoothed.status == Status::Interrupted {
        return Err(PyKeyboardInterrupt::new_err("stopped while smoothing the relative orientation"));
    }
    let (link_samples, link_squares): (Vec<_>, Vec<_>) = smoothed.link_squares.iter().copied().unzip();
    Ok(SmootherFit {
        q_12: rows(py, smoothed.q_12)?,
        covariance: rows(py, smoothed.covariance)?,
        covariance_known: rows(py, smoothed.covariance_known)?,
        constants: smoothed.constants.as_slice().to_vec().into_pyarray(py).unbind(),
        // Symmetric: by columns is by rows.
        constants_covariance: rows(py, <[[f64; CONSTANTS]; CONSTANTS]>::from(smoothed.constants_covariance).to_vec())?,
        status: status_name(smoothed.status),
        iterations: smoothed.iterations,
        link_std: smoothed.noise.link_std,
        drift_std: smoothed.noise.drift_std,
        trust: smoothed.noise.trust,
        link_samples: link_samples.into_pyarray(py).unbind(),
        link_squares: link_squares.into_pyarray(py).unbind(),
    })
}

fn rows<const N: usize>(py: Python<'_>, rows: Vec<[f64; N]>) -> PyResult<Py<PyArray2<f64>>> {
    let array = Array2::from_shape_vec((rows.len(), N), rows.into_flattened());
    Ok(array.map_err(|e| PyValueError::new_err(e.to_string()))?.into_pyarray(py).unbind())
}

fn status_name(status: Status) -> &'static str {
    match status {
        Status::Converged => "CONVERGED",
        Status::Stalled => "STALLED",
        Status::MaxIterations => "MAX_ITERATIONS",
        Status::NotObservable => "NOT_OBSERVABLE",
        Status::NumericalError => "NUMERICAL_ERROR",
        Status::Interrupted => "INTERRUPTED",
    }
}
