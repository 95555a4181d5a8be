//! Samples of two sensors as they come to a stream: one or a block, with times or at a stated rate.

use imufast_core::{PairSample, Xyz};
use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::{exceptions::PyValueError, prelude::*};

use crate::signals::join;

/// Where a stream is in time.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    pub rate_hz: f64,
    /// Whether samples come with their times; the first call says.
    pub timed: Option<bool>,
    /// Samples so far, time of the first and of the latest, s.
    pub count: u64,
    pub first_s: f64,
    pub latest_s: f64,
}

impl Clock {
    pub fn new(rate_hz: f64) -> Self {
        Self { rate_hz, timed: None, count: 0, first_s: 0.0, latest_s: f64::NEG_INFINITY }
    }

    /// Moves on to a sample's time.
    pub fn tick(&mut self, time_s: f64) {
        if self.count == 0 {
            self.first_s = time_s;
        }
        self.count += 1;
        self.latest_s = time_s;
    }

    /// Forty bytes that say all of it.
    pub fn to_bytes(self) -> Vec<u8> {
        let numbers = [self.rate_hz, self.first_s, self.latest_s].map(f64::to_le_bytes);
        let wholes = [self.count, self.timed.map_or(0, |timed| 1 + u64::from(timed))].map(u64::to_le_bytes);
        numbers.into_iter().chain(wholes).flatten().collect()
    }

    pub fn from_bytes(bytes: &[u8; 40]) -> Option<Self> {
        let mut words = bytes.as_chunks::<8>().0.iter().copied();
        let mut number = || words.next().map(f64::from_le_bytes).filter(|x| !x.is_nan());
        let (rate_hz, first_s, latest_s) = (number()?, number()?, number()?);
        let mut whole = || words.next().map(u64::from_le_bytes).filter(|x| *x < u64::MAX / 2);
        let count = whole()?;
        let timed = [None, Some(false), Some(true)].get(usize::try_from(whole()?).ok()?).copied()?;
        let sound = rate_hz > 0.0 && rate_hz.is_finite() && first_s.is_finite();
        sound.then_some(Self { rate_hz, timed, count, first_s, latest_s })
    }
}

/// The arrays gyr1, acc1, gyr2, acc2 as rows of equal number, and their times.
pub struct Block<'a> {
    rows: [&'a [Xyz]; 4],
    time: Option<&'a [f64]>,
}

impl<'a> Block<'a> {
    /// Views of shape (3,) or (N, 3), and of times (N,).
    pub fn new(
        arrays: [&'a PyReadonlyArrayDyn<'_, f64>; 4],
        time_s: Option<&'a PyReadonlyArrayDyn<'_, f64>>,
    ) -> PyResult<Self> {
        let [gyr1, acc1, gyr2, acc2] = arrays;
        let rows = [rows(gyr1, "gyr1")?, rows(acc1, "acc1")?, rows(gyr2, "gyr2")?, rows(acc2, "acc2")?];
        let time = match time_s {
            Some(array) if array.ndim() == 1 => {
                Some(array.as_slice().map_err(|e| PyValueError::new_err(format!("time_s: {e}")))?)
            }
            Some(array) => {
                return Err(PyValueError::new_err(format!("time_s must have shape (N,), got {:?}", array.shape())));
            }
            None => None,
        };
        let block = Self { rows, time };
        for (name, rows) in NAMES.iter().zip(&block.rows) {
            if rows.len() != block.len() {
                return Err(PyValueError::new_err(format!("gyr1 has {} samples but {name} has {}", block.len(), rows.len())));
            }
        }
        Ok(block)
    }

    /// Refuses values that are no measurements and times that do not go on from the clock's.
    pub fn check(&self, clock: &Clock) -> PyResult<()> {
        for (name, rows) in NAMES.iter().zip(&self.rows) {
            // Every value is looked at, so that many go side by side.
            if !rows.iter().flatten().fold(true, |sound, x| sound & (x.abs() < 1e9)) {
                return Err(PyValueError::new_err(format!("{name} holds values that are not finite or absurdly large")));
            }
        }
        if clock.timed.is_some_and(|timed| timed != self.time.is_some()) {
            return Err(PyValueError::new_err("time_s must be given with every call or with none"));
        }
        self.time.map_or(Ok(()), |time| check_time(time, self.len(), clock.latest_s))
    }

    pub fn len(&self) -> usize {
        let [gyr1, ..] = self.rows;
        gyr1.len()
    }

    /// Whether samples come with their times.
    pub fn timed(&self) -> bool {
        self.time.is_some()
    }

    /// Rows from `start` on: number, time where it is given, sample.
    pub fn samples(&self, start: usize) -> impl Iterator<Item = (usize, Option<f64>, PairSample)> {
        let [gyr1, acc1, gyr2, acc2] = self.rows;
        let rows = gyr1.iter().zip(acc1).zip(gyr2).zip(acc2).enumerate().skip(start);
        rows.map(|(row, (((g1, a1), g2), a2))| (row, self.time.and_then(|time| time.get(row)).copied(), join(g1, a1, g2, a2)))
    }
}

const NAMES: [&str; 4] = ["gyr1", "acc1", "gyr2", "acc2"];

fn rows<'a>(array: &'a PyReadonlyArrayDyn<'_, f64>, name: &str) -> PyResult<&'a [Xyz]> {
    match (array.shape(), array.as_slice()) {
        (&[3] | &[_, 3], Ok(flat)) if array.is_c_contiguous() => Ok(flat.as_chunks().0),
        _ => Err(PyValueError::new_err(format!(
            "{name} must be a C-contiguous float64 array of shape (3,) or (N, 3), got shape {:?}",
            array.shape()
        ))),
    }
}

fn check_time(time: &[f64], count: usize, latest_s: f64) -> PyResult<()> {
    if time.len() != count {
        return Err(PyValueError::new_err(format!("time_s has {} values for {count} samples", time.len())));
    }
    let mut before = latest_s;
    for (row, t) in time.iter().enumerate() {
        if !(t.is_finite() && *t > before) {
            return Err(PyValueError::new_err(format!(
                "time_s must be finite and increase, also from one call to the next: row {row} is {t} after {before}"
            )));
        }
        before = *t;
    }
    Ok(())
}
