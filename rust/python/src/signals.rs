//! Conditioning of whole recordings: even time, then the low-pass.

use imufast_core::{PairSample, Xyz, condition::Conditioner};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, ndarray::Array2};
use pyo3::{exceptions::PyValueError, prelude::*};

use crate::arrays::{pair, positive, vector};

type Arrays<'py> = (Bound<'py, PyArray1<f64>>, [Bound<'py, PyArray2<f64>>; 4]);

/// Two sensors' samples on even time and low-passed, without reaching across breaks: the times that are left (M,) and
/// gyr1, acc1, gyr2, acc2, each (M, 3).
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "one call from one place in Python, all by position")]
pub fn condition<'py>(
    py: Python<'py>,
    gyr1: PyReadonlyArray2<'py, f64>,
    acc1: PyReadonlyArray2<'py, f64>,
    gyr2: PyReadonlyArray2<'py, f64>,
    acc2: PyReadonlyArray2<'py, f64>,
    time_s: PyReadonlyArray1<'py, f64>,
    rate_hz: f64,
    cutoff_hz: f64,
) -> PyResult<Arrays<'py>> {
    let [gyr1, acc1, gyr2, acc2] = pair([&gyr1, &acc1, &gyr2, &acc2])?;
    let time = vector(&time_s, gyr1.len(), "time_s")?;
    positive(rate_hz, "rate_hz")?;
    // A kernel that no stretch can fill lets nothing through; it need not be made to know that.
    if cutoff_hz > 0.0 && 2.0 * rate_hz / cutoff_hz > time.len() as f64 {
        return Err(PyValueError::new_err(format!(
            "cutoff_hz {cutoff_hz} needs a kernel longer than the {} samples",
            time.len()
        )));
    }
    let (times, channels) = py.detach(|| {
        let mut conditioner = Conditioner::new(cutoff_hz, rate_hz, 1);
        let (mut times, mut ready) = (Vec::with_capacity(time.len()), Vec::new());
        let mut channels: [Vec<f64>; 4] = std::array::from_fn(|_| Vec::with_capacity(3 * time.len()));
        for ((((t, g1), a1), g2), a2) in time.iter().zip(gyr1).zip(acc1).zip(gyr2).zip(acc2) {
            conditioner.push(*t, &join(g1, a1, g2, a2), &mut ready);
            for (t, sample) in ready.drain(..) {
                times.push(t);
                for (channel, part) in channels.iter_mut().zip(sample.as_chunks::<3>().0) {
                    channel.extend_from_slice(part);
                }
            }
        }
        (times, channels)
    });
    let rows = times.len();
    let [g1, a1, g2, a2] =
        channels.map(|c| Array2::from_shape_vec((rows, 3), c).map_err(|e| PyValueError::new_err(e.to_string())));
    Ok((times.into_pyarray(py), [g1?.into_pyarray(py), a1?.into_pyarray(py), g2?.into_pyarray(py), a2?.into_pyarray(py)]))
}

pub fn join(gyr1: &Xyz, acc1: &Xyz, gyr2: &Xyz, acc2: &Xyz) -> PairSample {
    let ([a, b, c], [d, e, f], [g, h, i], [j, k, l]) = (*gyr1, *acc1, *gyr2, *acc2);
    [a, b, c, d, e, f, g, h, i, j, k, l]
}
