//! How far each sensor turns from one sample to the next, also across gaps, and how uncertain that is.

use nalgebra::ComplexField;

use super::{
    algebra::{Vec3, add, cross, scale, sub},
    filter::Filter,
    lane::{Lane, Real},
    method::Method,
    ring::is_even,
};
use crate::condition::BREAK_STEPS;

/// The mean of two vectors.
#[inline(always)]
pub(crate) fn mean<L: Lane>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    scale([a[0] + b[0], a[1] + b[1], a[2] + b[2]], L::splat(0.5))
}

/// The turn between the second and the third of four even samples `dt` apart, of rates that are a cubic through all four, with the
/// first term of its coning: in `ω₁ dt` a motion's frequency counts to the fourth power, where by the mean to the second.
pub(crate) fn cubic_turn<L: Lane>([before, from, to, after]: [[L; 3]; 4], dt: L) -> [L; 3] {
    let bend = sub(sub(to, before), sub(after, from));
    let straight = add(mean(from, to), scale(bend, L::splat(1.0 / 24.0)));
    scale(add(straight, scale(cross(from, to), dt * L::splat(1.0 / 12.0))), dt)
}

/// From one sample to the next.
pub(super) struct Step<T> {
    pub dt: f64,
    pub per_dt: f64,
    pub turns: [Vec3<T>; 2],
    /// Whether it crosses a gap with both ends' derivatives.
    flanked: bool,
}

impl<T: Real, M: Method> Filter<T, M> {
    /// Whether turns are by [`cubic_turn`] where time is even: at 25 Hz the mean of two rates leaves out a hundredth of a motion of
    /// 1.5 Hz, at 70 an eighth of that.
    pub(super) fn turns_by_cubics(&self) -> bool {
        self.settings.midpoint && self.settings.rate_hz < CUBIC_BELOW_HZ
    }

    /// The turn from the sample before `number` to it; `whole`: its neighbours are there, and no gap is among them.
    #[inline(always)]
    pub(super) fn step_to(&self, number: u64, whole: bool) -> Step<T> {
        let Some(before) = number.checked_sub(1) else {
            let (dt, per_dt) = (self.step_s, self.settings.rate_hz);
            return Step { dt, per_dt, turns: [[T::default(); 3]; 2], flanked: false };
        };
        let dt = self.ring.time(number) - self.ring.time(before);
        let (dt, per_dt) =
            if is_even(dt * self.settings.rate_hz) { (self.step_s, self.settings.rate_hz) } else { (dt, 1.0 / dt) };
        if self.settings.midpoint && dt * self.settings.rate_hz > BREAK_STEPS && self.is_flanked(number) {
            return Step { dt, per_dt, turns: [self.bridged(number, dt, 0), self.bridged(number, dt, 1)], flanked: true };
        }
        let cubic = whole && self.turns_by_cubics() && number >= self.even + self.delay_samples();
        // Two calls, not a map over an array: that would not be inlined.
        let turn = |sensor: usize| {
            if cubic {
                let around = [number - 2, before, number, number + 1].map(|k| self.ring.gyr(k, sensor));
                return cubic_turn(around, T::splat(dt));
            }
            let now = self.ring.gyr(number, sensor);
            let rate = if self.settings.midpoint { mean(self.ring.gyr(before, sensor), now) } else { now };
            scale(rate, T::splat(dt))
        };
        Step { dt, per_dt, turns: [turn(0), turn(1)], flanked: false }
    }

    /// Whether the samples around a gap tell derivatives at its ends.
    fn is_flanked(&self, number: u64) -> bool {
        let reach = self.delay_samples();
        let short = self.ring.time(number) - self.ring.time(number - 1) < LONGEST_BRIDGE_S;
        let whole =
            |from: u64, to: u64| (self.ring.time(to) - self.ring.time(from)) * self.settings.rate_hz < reach as f64 + 0.5;
        short
            && number > reach
            && number + reach < self.count
            && whole(number - 1 - reach, number - 1)
            && whole(number, number + reach)
    }

    /// The turn in a gap of `dt` before `number`: the rate as a cubic through the values and derivatives at both ends, and the
    /// first term of its coning.
    fn bridged(&self, number: u64, dt: f64, sensor: usize) -> Vec3<T> {
        let h = self.step;
        let (first, last) = (number - 1, number);
        let gyr = |k: u64| self.ring.gyr(k, sensor);
        let (from, to) = (gyr(first), gyr(last));
        let slope = |at: u64, near: u64, far: u64| {
            let span = self.ring.time(far) - self.ring.time(at);
            let three = |c: usize| gyr(near)[c] * T::splat(4.0) - gyr(at)[c] * T::splat(3.0) - gyr(far)[c];
            [three(0), three(1), three(2)].map(|x| x * T::splat(1.0 / span))
        };
        let bend = sub(slope(first, first - h, first - 2 * h), slope(last, last + h, last + 2 * h));
        let turn = scale(mean(from, to), T::splat(dt));
        add(turn, scale(add(bend, cross(from, to)), T::splat(dt * dt / 12.0)))
    }
}

/// Variance about one axis of what the joint may have done unseen, rad².
pub(super) fn gap_variance<T: Real>(step: &Step<T>) -> f64 {
    let turned: f64 = step.turns.as_flattened().iter().map(|x| x.to_f64() * x.to_f64()).sum();
    let rate = LEAST_RATE + ComplexField::sqrt(turned) / step.dt;
    let dt3 = step.dt * step.dt * step.dt;
    let mut unevenness = UNEVENNESS * dt3;
    if step.flanked {
        let [third, fifth] = FLANKED;
        unevenness = unevenness.min(third * dt3 + fifth * dt3 * step.dt * step.dt);
    }
    let std = unevenness * rate;
    (std * std).min(core::f64::consts::PI * core::f64::consts::PI / 3.0)
}

/// Faster sampling gains little by cubics, and they would hold it up, Hz.
const CUBIC_BELOW_HZ: f64 = 40.0;
/// Over a longer gap derivatives at its ends tell nothing of its middle, s.
const LONGEST_BRIDGE_S: f64 = 0.3;
/// In a gap of `t` seconds between rates of `ω` the orientation is uncertain by about this times `ω t³`, 1/s²: a motion of 2 Hz
/// integrated by its ends.
const UNEVENNESS: f64 = 13.0;
/// With derivatives at both ends, by about this times `ω t³` and `ω t⁵`, 1/s² and 1/s⁴: measured on simulated walks and free
/// motion.
const FLANKED: [f64; 2] = [2.0, 150.0];
/// However still before and after, there may have been this, rad/s.
const LEAST_RATE: f64 = 0.5;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::algebra::{exp, inverted, mul};

    /// Of the turn from 0 to `dt`, against ten thousand small ones.
    fn error(rate: impl Fn(f64) -> [f64; 3], turn: impl Fn(f64) -> [f64; 3], dt: f64) -> f64 {
        let small = dt / 1e4;
        let exact =
            (0..10_000).fold([1.0, 0.0, 0.0, 0.0], |q, k| mul(q, exp(scale(rate((f64::from(k) + 0.5) * small), small))));
        let [_, x, y, z] = mul(inverted(exact), exp(turn(dt)));
        2.0 * (x * x + y * y + z * z).sqrt()
    }

    #[test]
    fn cubic_turns_are_exact_about_one_axis_and_of_fifth_order_about_all() {
        let cubic = |t: f64| scale([0.6, -0.3, 0.5], 1.0 + t * (2.0 - t * (7.0 + t * 30.0)));
        let free = |t: f64| [3.0 * (9.0 * t).cos(), 2.0 * (7.0 * t).sin() - 1.0, 1.0 + 4.0 * t];
        for dt in [0.04, 0.02] {
            let by_cubic = |dt: f64| cubic_turn([cubic(-dt), cubic(0.0), cubic(dt), cubic(2.0 * dt)], dt);
            assert!(error(cubic, by_cubic, dt) < 1e-9);
            let mean_turn = |dt: f64| scale(mean(free(0.0), free(dt)), dt);
            let free_turn = |dt: f64| cubic_turn([free(-dt), free(0.0), free(dt), free(2.0 * dt)], dt);
            let (by_cubic, by_mean) = (error(free, free_turn, dt), error(free, mean_turn, dt));
            assert!(by_cubic < 0.1 * by_mean, "{by_cubic} against {by_mean}");
            assert!(error(free, free_turn, 0.5 * dt) < by_cubic / 12.0, "{by_cubic}");
        }
    }
}
