//! Lower body from sensors on its segments.

use imufast_core::{
    Xyz,
    body::{
        assemble::Problem,
        model::{AxisAngle, Bone, Difference, Joint, Model, Noise, Seen, Skin},
        moments::{Moments, Readings, Sampling, Spacing},
        solve::{Descent, End, Status, Trial, minimise},
        states::{Motion, State},
        uncertainty::{Uncertainty, uncertainty},
    },
};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
    nalgebra::{Quaternion, UnitQuaternion, Vector3},
    ndarray::{Array2, Array3},
};
use pyo3::{
    exceptions::{PyKeyboardInterrupt, PyValueError},
    prelude::*,
};

use crate::arrays::{positive, vector};

/// A joint: its two sensors, standard deviation of its centre (m, world axes), of a hinge across its axis (rad/s) and between
/// its axes (rad).
type JointTuple = (usize, usize, [f64; 3], Option<f64>, Option<f64>);
/// A bone: (joint, side) of both ends, (mean, standard deviation) of its length and its (least, most), m.
type BoneTuple = ((usize, usize), (usize, usize), Option<(f64, f64)>, Option<(f64, f64)>);
/// An angle: (joint, side) of the axis, bone, mean and standard deviation, rad.
type AngleTuple = ((usize, usize), usize, f64, f64);
/// A difference of two bones' lengths: both, and its standard deviation, m.
type DifferenceTuple = (usize, usize, f64);
/// A skin: its sensor, standard deviations of its turn (rad/rad) and its shift (m/rad).
type SkinTuple = (usize, f64, f64);

/// What sensors on a body say, ready for a search.
#[pyclass(frozen, module = "imufast._core")]
pub struct BodyProblem {
    model: Model,
    moments: Moments,
}

/// A body found.
#[pyclass(frozen, get_all, module = "imufast._core")]
pub struct BodyFit {
    /// (K, S, 4), sensor to world.
    q: Py<PyArray3<f64>>,
    /// (K, S, 3), m/s.
    velocity: Py<PyArray3<f64>>,
    /// (K, S, 3), m.
    position: Py<PyArray3<f64>>,
    /// (K, S, 3), rad/s.
    gyr_bias: Py<PyArray3<f64>>,
    /// (K, S, 3), m/s².
    acc_bias: Py<PyArray3<f64>>,
    /// (J, 2, 3), m.
    centers: Py<PyArray3<f64>>,
    /// (J, 2, 3).
    axes: Py<PyArray3<f64>>,
    /// (T, 2, 3): turn (rad/rad) and shift (m/rad) of each skin.
    skins: Py<PyArray3<f64>>,
    /// (K, S, 1) squares of the white residuals, nine numbers each, of the dynamics from each moment to the next.
    link_squares: Py<PyArray3<f64>>,
    /// (K, J, 4) squares of the white residuals, three numbers each, of a joint's centre, hinge from either side, and axes.
    joint_squares: Py<PyArray3<f64>>,
    status: &'static str,
    cost: f64,
    /// (T, 5): cost, tried, promised, damping, taken.
    trials: Py<PyArray2<f64>>,
    /// (K, J, 36): 6 x 6 by rows, of the rotation vectors by which a joint's two sensors may be turned in the world, rad²; None where the curvature says nothing.
    joint_covariance: Option<Py<PyArray3<f64>>>,
    /// (K, J * 6, C): the same six with all constants.
    joint_constants: Option<Py<PyArray3<f64>>>,
    /// (C, C) of the constants: centres (J, 2, 3), then two tangent directions of each hinge's axis on
    /// either side, then turn and shift of each skin.
    constants_covariance: Option<Py<PyArray2<f64>>>,
}

#[pymethods]
impl BodyProblem {
    /// `gyr`, `acc` (S, N, 3); `biases` (S, 2, 3): gyroscope and accelerometer; `noise`: the fields of the core's `Noise`.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "one call from one place in Python, all by position")]
    fn new(
        py: Python<'_>,
        time_s: PyReadonlyArray1<'_, f64>,
        gyr: PyReadonlyArray3<'_, f64>,
        acc: PyReadonlyArray3<'_, f64>,
        rate_hz: f64,
        intervals: bool,
        spacing: (usize, usize, f64),
        biases: PyReadonlyArray3<'_, f64>,
        joints: Vec<JointTuple>,
        bones: Vec<BoneTuple>,
        angles: Vec<AngleTuple>,
        differences: Vec<DifferenceTuple>,
        noise: [f64; 11],
        gravity: f64,
        skins: Vec<SkinTuple>,
    ) -> PyResult<Self> {
        let (gyr, acc) = (sensors(&gyr, "gyr")?, sensors(&acc, "acc")?);
        positive(rate_hz, "rate_hz")?;
        let count = gyr.first().map_or(0, |rows| rows.len());
        if count == 0 || gyr.len() != acc.len() || acc.iter().any(|rows| rows.len() != count) {
            return Err(PyValueError::new_err("gyr and acc must have the same shape (S, N, 3), with at least one sample"));
        }
        let time = vector(&time_s, count, "time_s")?;
        let (key_samples, rate_samples, bridge_s) = spacing;
        if key_samples == 0 {
            return Err(PyValueError::new_err("spacing must have at least one sample between moments"));
        }
        let biases = sensors(&biases, "biases")?;
        if biases.len() != gyr.len() || biases.iter().any(|rows| rows.len() != 2) {
            return Err(PyValueError::new_err("biases must have shape (S, 2, 3)"));
        }
        let biases: Vec<_> =
            biases.iter().filter_map(|b| <[Xyz; 2]>::try_from(*b).ok()).map(|b| b.map(Vector3::from)).collect();
        let [gyr_std, acc_std, position, gyr_walk, acc_walk, rate, gyr_bias, acc_bias, center, gauge, tail] = noise;
        let noise =
            Noise { gyr: gyr_std, acc: acc_std, position, gyr_walk, acc_walk, rate, gyr_bias, acc_bias, center, gauge, tail };
        let seen = |(joint, side): (usize, usize)| Seen { joint, side };
        let model = Model {
            sensors: gyr.len(),
            joints: joints
                .into_iter()
                .map(|(a, b, center_std, hinge_std, axes_std)| Joint { sensors: [a, b], center_std, hinge_std, axes_std })
                .collect(),
            bones: bones
                .into_iter()
                .map(|(a, b, length, limits)| Bone {
                    ends: [seen(a), seen(b)],
                    length: length.map(<[f64; 2]>::from),
                    limits: limits.map(<[f64; 2]>::from),
                })
                .collect(),
            angles: angles
                .into_iter()
                .map(|(axis, bone, mean, std)| AxisAngle { axis: seen(axis), bone, angle: [mean, std] })
                .collect(),
            differences: differences.into_iter().map(|(a, b, std)| Difference { bones: [a, b], std }).collect(),
            skins: skins.into_iter().map(|(sensor, turn_std, shift_std)| Skin { sensor, turn_std, shift_std }).collect(),
            noise,
            gravity,
        };
        if let Some(fault) = model.fault() {
            return Err(PyValueError::new_err(format!("the body makes no sense: {fault}")));
        }
        let sampling = if intervals { Sampling::Interval } else { Sampling::Instant };
        let readings = Readings { time_s: time, gyr, acc, step_s: 1.0 / rate_hz, sampling };
        let spacing = Spacing { key_samples, rate_samples, bridge_s };
        let moments = py.detach(|| Moments::new(&readings, &spacing, &biases, &model.noise));
        let moments = moments.ok_or_else(|| PyValueError::new_err("noise leaves a direction of the motion without any"))?;
        Ok(Self { model, moments })
    }

    /// (K,) the sample of each moment.
    #[getter]
    fn samples<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<usize>> {
        self.moments.moments.iter().map(|m| m.sample).collect::<Vec<_>>().into_pyarray(py)
    }

    /// (K,) whether samples lead on to the next moment.
    #[getter]
    fn linked<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.moments.moments.iter().map(|m| m.linked).collect::<Vec<_>>().into_pyarray(py)
    }

    /// (K, S, 3) rates that the sensors read at the moments, rad/s.
    #[getter]
    fn rates(&self, py: Python<'_>) -> PyResult<Py<PyArray3<f64>>> {
        cube(py, self.model.sensors, self.moments.rates.iter().map(|v| (*v).into()))
    }

    /// The most probable state from a start: `q` (K, S, 4), `velocity`, `position`, `gyr_bias`, `acc_bias` (K, S, 3), `centers`,
    /// `axes` (J, 2, 3), `skins` (T, 2, 3). `drives` (K, T, 1) are the
    /// angles that move the skins, rad. `held` (C, C), where given, is the covariance of constants that stay as they are; `beforehand`,
    /// likewise, the joint centres around which centres are expected, else `centers`; `rests` (K, 1, 1) where the body rests the
    /// information that the first sensor moves as fast at the next moment, 1/(m/s)²; `postures` (J, 2, 3) directions in both
    /// sensors of each joint that usually agree, and `usual` (K, J, 1) the information that they do, 1/rad². `watch`, where given, is called with
    /// (trial, cost, promised, damping) and may raise to stop.
    #[pyo3(signature = (
        q, velocity, position, gyr_bias, acc_bias, centers, axes, skins, drives, descent, covariance, watch=None, held=None,
        beforehand=None, rests=None, postures=None, usual=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "one call from one place in Python, all by position")]
    fn minimise(
        &self,
        py: Python<'_>,
        q: PyReadonlyArray3<'_, f64>,
        velocity: PyReadonlyArray3<'_, f64>,
        position: PyReadonlyArray3<'_, f64>,
        gyr_bias: PyReadonlyArray3<'_, f64>,
        acc_bias: PyReadonlyArray3<'_, f64>,
        centers: PyReadonlyArray3<'_, f64>,
        axes: PyReadonlyArray3<'_, f64>,
        skins: PyReadonlyArray3<'_, f64>,
        drives: PyReadonlyArray3<'_, f64>,
        descent: (usize, f64, f64),
        covariance: bool,
        watch: Option<Py<PyAny>>,
        held: Option<PyReadonlyArray2<'_, f64>>,
        beforehand: Option<PyReadonlyArray3<'_, f64>>,
        rests: Option<PyReadonlyArray3<'_, f64>>,
        postures: Option<PyReadonlyArray3<'_, f64>>,
        usual: Option<PyReadonlyArray3<'_, f64>>,
    ) -> PyResult<BodyFit> {
        let (moments, sensors, joints) = (self.moments.len(), self.model.sensors, self.model.joints.len());
        let turned = flat(&q, [moments, sensors, 4], "q")?.as_chunks::<4>().0;
        let part = |array, name| flat(array, [moments, sensors, 3], name).map(|v| v.as_chunks::<3>().0);
        let parts = [
            part(&velocity, "velocity")?,
            part(&position, "position")?,
            part(&gyr_bias, "gyr_bias")?,
            part(&acc_bias, "acc_bias")?,
        ];
        let pairs = |array, count, name| {
            let rows = flat(array, [count, 2, 3], name)?.as_chunks::<6>().0;
            Ok::<Vec<_>, PyErr>(
                rows.iter().map(|[a, b, c, d, e, f]| [Vector3::new(*a, *b, *c), Vector3::new(*d, *e, *f)]).collect(),
            )
        };
        let (centers, mut axes) = (pairs(&centers, joints, "centers")?, pairs(&axes, joints, "axes")?);
        let beforehand = beforehand.as_ref().map(|array| pairs(array, joints, "beforehand")).transpose()?;
        let count = self.model.skins.len();
        let skins = pairs(&skins, count, "skins")?;
        let drives = flat(&drives, [moments, count, 1], "drives")?;
        let rests = rests.as_ref().map(|array| flat(array, [moments, 1, 1], "rests")).transpose()?;
        let postures = postures.as_ref().map(|array| pairs(array, joints, "postures")).transpose()?;
        let usual = usual.as_ref().map(|array| flat(array, [moments, joints, 1], "usual")).transpose()?;
        for axis in axes.iter_mut().flatten() {
            *axis = axis.try_normalize(1e-9).ok_or_else(|| PyValueError::new_err("axes must not be zero"))?;
        }
        let [velocities, positions, gyr_biases, acc_biases] = parts;
        let motions = turned
            .iter()
            .zip(velocities)
            .zip(positions)
            .zip(gyr_biases)
            .zip(acc_biases)
            .map(|(((([w, x, y, z], velocity), position), gyr_bias), acc_bias)| {
                let mut motion = Motion::turned(UnitQuaternion::new_normalize(Quaternion::new(*w, *x, *y, *z)));
                motion.velocity = (*velocity).into();
                motion.position = (*position).into();
                motion.gyr_bias = (*gyr_bias).into();
                motion.acc_bias = (*acc_bias).into();
                motion
            })
            .collect();
        let start = State { motions, centers, axes, skins };
        let constants = self.model.constants();
        let held = match &held {
            None => None,
            Some(array) => match (array.shape() == [constants, constants], array.as_slice()) {
                (true, Ok(rows)) if array.is_c_contiguous() && rows.iter().all(|v| v.is_finite()) => Some(rows.to_vec()),
                _ => {
                    return Err(PyValueError::new_err(format!(
                        "held must be a C-contiguous float64 array of shape [{constants}, {constants}] of finite numbers, got \
                         shape {:?}",
                        array.shape()
                    )));
                }
            },
        };
        let (max_iterations, tolerance, damping) = descent;
        let descent = Descent { max_iterations, tolerance, damping };
        let mut raised: Option<PyErr> = None;
        let (end, known, squares) = py.detach(|| {
            let mut problem = Problem::new(&self.model, &self.moments, &start);
            problem.held = held;
            problem.centers = beforehand.unwrap_or(problem.centers);
            problem.drives.copy_from_slice(drives);
            if let Some(rests) = rests {
                problem.rests.copy_from_slice(rests);
            }
            if let (Some(postures), Some(usual)) = (postures, usual) {
                problem.postures = postures;
                problem.usual.copy_from_slice(usual);
            }
            let mut number = 0;
            let mut told = |trial: &Trial| {
                number += 1;
                let heard = Python::attach(|py| {
                    py.check_signals()?;
                    match &watch {
                        Some(watch) => {
                            watch.call1(py, (number, trial.tried.min(trial.cost), trial.promised, trial.damping)).map(|_| ())
                        }
                        None => Ok(()),
                    }
                });
                heard.map_err(|error| raised = Some(error)).is_ok()
            };
            let end = minimise(&problem, start.clone(), &descent, &mut told);
            let wanted = covariance && end.status != Status::Interrupted;
            let known = if wanted { uncertainty(&problem, &end.state) } else { None };
            let squares = problem.squares(&end.state);
            (end, known, squares)
        });
        match raised {
            Some(error) => Err(error),
            None if end.status == Status::Interrupted => {
                Err(PyKeyboardInterrupt::new_err("stopped while the body was searched for"))
            }
            None => self.fit(py, &end, known, squares),
        }
    }
}

impl BodyProblem {
    fn fit(
        &self,
        py: Python<'_>,
        end: &End,
        known: Option<Uncertainty>,
        squares: (Vec<f64>, Vec<[f64; 4]>),
    ) -> PyResult<BodyFit> {
        let (mut joint_covariance, mut joint_constants, mut constants_covariance) = (None, None, None);
        if let Some(known) = known {
            let (joints, constants) = (self.model.joints.len(), self.model.constants());
            joint_covariance = Some(cube(py, joints, known.joints.into_iter())?);
            joint_constants = Some(shaped(py, (self.moments.len(), 6 * joints, constants), known.beside)?);
            let square = Array2::from_shape_vec((constants, constants), known.constants);
            constants_covariance = Some(square.map_err(|e| PyValueError::new_err(e.to_string()))?.into_pyarray(py).unbind());
        }
        let state = &end.state;
        let of = |get: fn(&Motion) -> Vector3<f64>| cube(py, self.model.sensors, state.motions.iter().map(|m| get(m).into()));
        let pairs = |pairs: &[[Vector3<f64>; 2]]| cube(py, 2, pairs.iter().flatten().map(|v| (*v).into()));
        let q = state.motions.iter().map(|m| [m.q.w, m.q.i, m.q.j, m.q.k]);
        let trials: Vec<[f64; 5]> =
            end.trials.iter().map(|t| [t.cost, t.tried, t.promised, t.damping, f64::from(u8::from(t.taken))]).collect();
        let trials = Array2::from_shape_vec((trials.len(), 5), trials.into_flattened());
        Ok(BodyFit {
            q: cube(py, self.model.sensors, q)?,
            velocity: of(|m| m.velocity)?,
            position: of(|m| m.position)?,
            gyr_bias: of(|m| m.gyr_bias)?,
            acc_bias: of(|m| m.acc_bias)?,
            centers: pairs(&state.centers)?,
            axes: pairs(&state.axes)?,
            skins: pairs(&state.skins)?,
            link_squares: cube(py, self.model.sensors, squares.0.into_iter().map(|v| [v]))?,
            joint_squares: cube(py, self.model.joints.len(), squares.1.into_iter())?,
            status: status_name(end.status),
            cost: end.cost,
            trials: trials.map_err(|e| PyValueError::new_err(e.to_string()))?.into_pyarray(py).unbind(),
            joint_covariance,
            joint_constants,
            constants_covariance,
        })
    }
}

/// Rows of W numbers as (rows / middle, middle, W).
fn cube<const W: usize>(py: Python<'_>, middle: usize, rows: impl Iterator<Item = [f64; W]>) -> PyResult<Py<PyArray3<f64>>> {
    let rows: Vec<[f64; W]> = rows.collect();
    shaped(py, (rows.len() / middle.max(1), middle, W), rows.into_flattened())
}

fn shaped(py: Python<'_>, shape: (usize, usize, usize), values: Vec<f64>) -> PyResult<Py<PyArray3<f64>>> {
    let array = Array3::from_shape_vec(shape, values);
    Ok(array.map_err(|e| PyValueError::new_err(e.to_string()))?.into_pyarray(py).unbind())
}

/// A C-contiguous array of this shape as one slice.
fn flat<'a>(array: &'a PyReadonlyArray3<'_, f64>, shape: [usize; 3], name: &str) -> PyResult<&'a [f64]> {
    match (array.shape() == shape, array.is_c_contiguous(), array.as_slice()) {
        (true, true, Ok(flat)) if flat.iter().all(|v| v.is_finite()) => Ok(flat),
        _ => Err(PyValueError::new_err(format!(
            "{name} must be a C-contiguous float64 array of shape {shape:?} of finite numbers, got shape {:?}",
            array.shape()
        ))),
    }
}

/// A C-contiguous (S, N, 3) array as samples of each sensor.
fn sensors<'a>(array: &'a PyReadonlyArray3<'_, f64>, name: &str) -> PyResult<Vec<&'a [Xyz]>> {
    if let (&[count, rows, 3], true, Ok(flat)) = (array.shape(), array.is_c_contiguous(), array.as_slice()) {
        if count == 0 || rows == 0 {
            return Ok(Vec::new());
        }
        return Ok(flat.as_chunks::<3>().0.chunks_exact(rows).collect());
    }
    Err(PyValueError::new_err(format!(
        "{name} must be a C-contiguous float64 array of shape (S, N, 3), got shape {:?}",
        array.shape()
    )))
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
