//! What the two filters have in common.

use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::{
    algebra::{Quat, Sym3},
    eight::{EIGHT, Eight},
    filter::alarm,
    lane::{Lane, Real},
    state::{Joint, Moment, Noise, State},
};

/// A filter: how an instant changes what is known.
pub trait Method: Copy + PartialEq + Serialize + DeserializeOwned + Send + Sync + 'static {
    /// Whether [`State::p`] is a 3×3 matrix.
    const FULL_COVARIANCE: bool;
    /// Takes over a state that a start has made.
    fn begin<L: Lane>(&self, state: &mut State<L>);
    /// Turns with the gyroscopes and, where `correct`, uses the accelerations.
    fn step<L: Lane>(&self, tuning: &Tuning<L>, state: &mut State<L>, moment: &Moment<L>, correct: bool);
    /// Works in the accelerations of one moment after the other, for as many orientations and variances; where an estimate
    /// alarms, it is the last one, and its place is given. `pace` is dt and its reciprocal.
    #[inline(always)]
    fn follow<T: Real, V: Eight<T>>(
        &self,
        tuning: &Tuning<f64>,
        state: &mut State<T>,
        moments: &[Moment<[T; EIGHT]>],
        pace: [f64; 2],
        q: &mut [Quat<T>],
        variance: &mut [T],
    ) -> Option<usize> {
        follow_in_turn(self, tuning, state, moments, pace, q, variance)
    }
    /// Trace of the covariance of the rotation error, rad².
    fn variance<L: Lane>(&self, state: &State<L>) -> L;
    /// Covariance of the rotation error in the frame of sensor 2, rad²; its trace is [`Self::variance`].
    fn covariance<T: Real>(&self, state: &State<T>) -> Sym3<f64>;
    /// Adds so much variance about every axis.
    fn widen<L: Lane>(&self, state: &mut State<L>, variance: L);
}

/// [`Method::follow`], step by step.
#[inline(always)]
pub(super) fn follow_in_turn<T: Real, M: Method>(
    method: &M,
    tuning: &Tuning<f64>,
    state: &mut State<T>,
    moments: &[Moment<[T; EIGHT]>],
    pace: [f64; 2],
    q: &mut [Quat<T>],
    variance: &mut [T],
) -> Option<usize> {
    let (tuning, pace) = (tuning.cast(), pace.map(T::splat));
    for (row, (q, variance)) in q.iter_mut().zip(variance).enumerate() {
        method.step(&tuning, state, &moments[row / EIGHT].each(|x| x[row % EIGHT]).at_pace(pace), true);
        (*q, *variance) = (state.q, method.variance(state));
        if alarm(state.watch, state.q[0]) {
            return Some(row);
        }
    }
    None
}

/// Noise as the filters use it, worked out once.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tuning<L> {
    /// Variance of the relative rate from white noise, one axis, (rad/s)².
    pub rate_var: L,
    /// Relative drift, rad per √s for each rad/s of turning: gyroscope scale and cross-axis errors, which integrate over a
    /// swing and undo themselves on the way back.
    pub scale_noise: L,
    /// Variance of the link residual to begin with, one axis, (m/s²)².
    pub link_var: L,
    /// Variance of the bias of the relative rate, one axis, (rad/s)².
    pub bias_var: L,
}

/// Default of [`Tuning::scale_noise`], √s.
pub const SCALE_NOISE: f64 = 0.0014;
/// The link residual never scatters less, one axis, (m/s²)².
pub(crate) const LEAST_LINK_VAR: f64 = 9e-4;

impl Tuning<f64> {
    /// From the sensors' white noise, the lever arms and the step of the differentiation.
    pub fn new(noise: &Noise, joint: &Joint, stencil_s: f64, scale_noise: f64) -> Self {
        let [r1, r2] = [joint.r1, joint.r2].map(|r| nalgebra::Vector3::from(r).norm());
        let dot_std = noise.gyr_std * STENCIL_NOISE / stencil_s;
        let lever = dot_std * dot_std * (r1 * r1 + r2 * r2) * (2.0 / 3.0);
        let link_var = 2.0 * noise.acc_std * noise.acc_std + lever;
        Self {
            rate_var: 2.0 * noise.gyr_std * noise.gyr_std,
            scale_noise,
            link_var: link_var.max(LEAST_LINK_VAR),
            bias_var: joint.relative_bias_std * joint.relative_bias_std,
        }
    }

    /// The same in other numbers.
    #[inline(always)]
    pub(crate) fn cast<L: Lane>(&self) -> Tuning<L> {
        let Self { rate_var, scale_noise, link_var, bias_var } = *self;
        let [rate_var, scale_noise, link_var, bias_var] = [rate_var, scale_noise, link_var, bias_var].map(L::splat);
        Tuning { rate_var, scale_noise, link_var, bias_var }
    }
}

impl<L: Lane> Tuning<L> {
    /// Variance that one step adds about every axis; `drift` scales the part that grows with motion.
    #[inline(always)]
    pub(crate) fn process(&self, drift: L, m: &Moment<L>) -> L {
        let drift = drift * self.scale_noise;
        m.dt * m.dt * self.rate_var + drift * drift * (m.turned2 + m.turned2) * m.per_dt
    }
}

/// Noise of the five-point stencil, in standard deviations of a sample over its step.
const STENCIL_NOISE: f64 = 0.950;
