//! What a filter did not foresee: its innovations over a recording, held against what it says of their size. For diagnosis; the
//! filters themselves keep none of it.

use alloc::vec::Vec;
use nalgebra::{Matrix3, Vector3};

use super::{
    filter::Filter,
    lane::Real,
    method::{Method, Tuning},
    run::Signals,
    settings::Settings,
    state::{Moment, State, expected},
};
use crate::Xyz;

/// The innovations of a recording, one a sample; NaN where none was used: in starts, after gaps, where packets were lost.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Innovations {
    /// `e = R̂ᵀa1 − a2` in the frame of sensor 2, before the sample corrects anything, m/s².
    pub innovation: Vec<Xyz>,
    /// `eᵀ S⁻¹ e` with `S = H P Hᵀ + σ² I`, `H = −[a2×]`: of a filter whose uncertainty is right χ² of three degrees of freedom.
    /// `P` counts unknown gyroscope biases, as the stated standard deviation does; σ² is that of the link just then.
    pub nis: Vec<f64>,
}

/// So many samples before the caller is asked again.
const ROUND: usize = 1 << 14;

/// Runs a filter over a recording, sample by sample, as [`super::run`] does. None if `keep_going` says no.
pub fn innovations<T: Real, M: Method>(
    settings: &Settings,
    method: M,
    signals: &Signals<'_>,
    keep_going: &mut impl FnMut() -> bool,
) -> Option<Innovations> {
    let nothing = f64::NAN;
    let count = signals.len();
    let mut all = Innovations { innovation: alloc::vec![[nothing; 3]; count], nis: alloc::vec![nothing; count] };
    let mut filter = Filter::<T, M>::new(*settings, method);
    for k in 0..count {
        if k % ROUND == 0 && !keep_going() {
            return None;
        }
        let before = filter.has_started().then_some(*filter.state());
        let mut used = None;
        filter.push_into(signals.time(k, settings.rate_hz), &signals.sample(k), &mut |number, _| used = Some(number));
        // Of one push at most one sample has its neighbours; all others are bridged.
        let (Some(number), Some(before)) = (used, before) else { continue };
        let Some(moment) = filter.corrected_by(number) else { continue };
        let (e, nis) = foreseen(&method, &filter.tuning, &before, &moment);
        if let (Some(innovation), Some(square)) = (all.innovation.get_mut(number as usize), all.nis.get_mut(number as usize)) {
            (*innovation, *square) = (e, nis);
        }
    }
    Some(all)
}

/// Innovation and its normalised square of one instant, from the state before it.
fn foreseen<T: Real, M: Method>(method: &M, tuning: &Tuning<f64>, before: &State<T>, m: &Moment<T>) -> (Xyz, f64) {
    let mut state = *before;
    method.step(&tuning.cast(), &mut state, m, false);
    let seen = expected(state.q, m).map(T::to_f64);
    let acc2 = m.acc2.map(T::to_f64);
    let e = Vector3::from(seen) - Vector3::from(acc2);
    let [xx, xy, xz, yy, yz, zz] = method.covariance(&state);
    let p = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let h = Vector3::from(acc2).cross_matrix();
    let s = h * p * h.transpose() + Matrix3::identity() * before.link_var.to_f64();
    (e.into(), s.cholesky().map_or(f64::NAN, |s| e.dot(&s.solve(&e))))
}
