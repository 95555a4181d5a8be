//! Algorithms 2 and 3 on whole recordings.

use imufast_core::{
    condition::BREAK_STEPS,
    hinge::{
        scores::{ScoreWindow, Scored, window_samples},
        select::{AccSelection, Candidate, GyrSelection},
    },
};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::{exceptions::PyValueError, prelude::*};

use crate::{
    arrays::{pair, positive, vector},
    signals::join,
};

type Selected<'py> =
    (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// The samples that Algorithms 2 and 3 choose: gyr_index, acc_index (ascending), and the scores of all samples, gyr_score
/// (0 where the window is not complete) and acc_score (infinite there).
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "one call from one place in Python, all by position")]
pub fn select_samples<'py>(
    py: Python<'py>,
    gyr1: PyReadonlyArray2<'py, f64>,
    acc1: PyReadonlyArray2<'py, f64>,
    gyr2: PyReadonlyArray2<'py, f64>,
    acc2: PyReadonlyArray2<'py, f64>,
    time_s: PyReadonlyArray1<'py, f64>,
    rate_hz: f64,
    max_samples: usize,
    window_s: f64,
    energy_threshold: f64,
) -> PyResult<Selected<'py>> {
    let [gyr1, acc1, gyr2, acc2] = pair([&gyr1, &acc1, &gyr2, &acc2])?;
    let time = vector(&time_s, gyr1.len(), "time_s")?;
    positive(rate_hz, "rate_hz")?;
    if window_s.is_nan() || window_s < 0.0 {
        return Err(PyValueError::new_err(format!("window_s must not be negative, got {window_s}")));
    }
    // A window longer than the data is never complete, however much longer it is.
    let window_s = window_s.min((time.len() + 2) as f64 / rate_hz);
    let (gyr, acc, gyr_score, acc_score) = py.detach(|| {
        let mut window = ScoreWindow::new(window_samples(window_s, rate_hz));
        let few = time.len() <= max_samples;
        let threshold = if few { f64::INFINITY } else { energy_threshold };
        let (mut gyr, mut acc) = (GyrSelection::new(max_samples), AccSelection::new(max_samples, threshold, true));
        let (mut gyr_score, mut acc_score) = (vec![0.0; time.len()], vec![f64::INFINITY; time.len()]);
        let mut before = f64::NEG_INFINITY;
        let delay = window.delay_samples();
        for (n, ((((t, g1), a1), g2), a2)) in time.iter().zip(gyr1).zip(acc1).zip(gyr2).zip(acc2).enumerate() {
            if (t - before) * rate_hz > BREAK_STEPS {
                window.reset();
            }
            before = *t;
            let sample = join(g1, a1, g2, a2);
            if few {
                gyr.push(Candidate::gyr(n as u64, *t, &sample, 0.0));
                acc.push(Candidate::acc(n as u64, *t, &sample, 0.0));
            }
            let Some(Scored { time, sample, gyr_score: g, acc_score: a }) = window.push(*t, &sample) else { continue };
            let k = n - delay;
            if let (Some(gs), Some(as_)) = (gyr_score.get_mut(k), acc_score.get_mut(k)) {
                (*gs, *as_) = (g, a);
            }
            if !few {
                gyr.push(Candidate::gyr(k as u64, time, &sample, g));
                acc.push(Candidate::acc(k as u64, time, &sample, a));
            }
        }
        acc.settle();
        let indices = |chosen: &[Candidate]| chosen.iter().map(|c| c.index as i64).collect::<Vec<_>>();
        (indices(&gyr.chosen()), indices(acc.chosen()), gyr_score, acc_score)
    });
    Ok((gyr.into_pyarray(py), acc.into_pyarray(py), gyr_score.into_pyarray(py), acc_score.into_pyarray(py)))
}
