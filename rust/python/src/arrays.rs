//! Checked views of numpy arrays.

use imufast_core::Xyz;
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::{exceptions::PyValueError, prelude::*};

/// A C-contiguous (N, 3) float64 array as a slice of samples.
pub fn xyz<'a>(array: &'a PyReadonlyArray2<'_, f64>, name: &str) -> PyResult<&'a [Xyz]> {
    if let (&[_, 3], true, Ok(flat)) = (array.shape(), array.is_c_contiguous(), array.as_slice()) {
        return Ok(flat.as_chunks().0);
    }
    Err(PyValueError::new_err(format!(
        "{name} must be a C-contiguous float64 array of shape (N, 3), got shape {:?}",
        array.shape()
    )))
}

/// A contiguous float64 vector of the given length.
pub fn vector<'a>(array: &'a PyReadonlyArray1<'_, f64>, length: usize, name: &str) -> PyResult<&'a [f64]> {
    match array.as_slice() {
        Ok(flat) if flat.len() == length => Ok(flat),
        _ => Err(PyValueError::new_err(format!(
            "{name} must be a contiguous float64 array of length {length}, got shape {:?}",
            array.shape()
        ))),
    }
}

/// Refuses what is not a positive finite number.
pub fn positive(value: f64, name: &str) -> PyResult<()> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{name} must be a positive finite number, got {value}")))
}

/// gyr1, acc1, gyr2, acc2 as slices of one length.
pub fn pair<'a>(arrays: [&'a PyReadonlyArray2<'_, f64>; 4]) -> PyResult<[&'a [Xyz]; 4]> {
    let [gyr1, acc1, gyr2, acc2] = arrays;
    let slices = [xyz(gyr1, "gyr1")?, xyz(acc1, "acc1")?, xyz(gyr2, "gyr2")?, xyz(acc2, "acc2")?];
    let [gyr1, acc1, gyr2, acc2] = slices.map(<[Xyz]>::len);
    equal_lengths(&[("gyr1", gyr1), ("acc1", acc1), ("gyr2", gyr2), ("acc2", acc2)])?;
    Ok(slices)
}

/// Refuses arrays of unequal length.
pub fn equal_lengths(lengths: &[(&str, usize)]) -> PyResult<()> {
    match lengths {
        [(first, n), rest @ ..] => match rest.iter().find(|(_, m)| m != n) {
            Some((name, m)) => {
                Err(PyValueError::new_err(format!("{first} has {n} samples but {name} has {m}: give equal lengths")))
            }
            None => Ok(()),
        },
        [] => Ok(()),
    }
}
