//! The last samples of a stream, as many as differentiation looks back on, without allocation.

use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

use super::{
    algebra::{Vec3, add, scale, sub},
    lane::Real,
};

const BLOCK: usize = 8;
/// So many samples are kept.
pub(super) const LENGTH: u64 = (BLOCK * BLOCK) as u64;
/// The widest step of a five-point stencil, samples.
pub(super) const WIDEST: u64 = 15;
/// Step of the stencil, s: shorter ones pass more noise, longer ones less motion.
const STENCIL_S: f64 = 0.01;
/// Times that differ from even ones by less than this part of a step count as even.
const EVEN: f64 = 1e-3;

/// Whether a step of so many nominal ones counts as one.
#[inline(always)]
pub(super) fn is_even(steps: f64) -> bool {
    ComplexField::abs(steps - 1.0) <= EVEN
}

/// Bias-free samples by their number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Real")]
pub(super) struct Ring<T> {
    /// Blocks, since longer arrays cannot be saved.
    samples: [[[T; 12]; BLOCK]; BLOCK],
    times: [[f64; BLOCK]; BLOCK],
}

/// Step of the stencil for samples at `rate_hz`, in samples.
pub(super) fn stencil_step(rate_hz: f64) -> u64 {
    ((STENCIL_S * rate_hz + 0.5) as u64).clamp(1, WIDEST)
}

impl<T: Real> Ring<T> {
    pub fn new() -> Self {
        Self { samples: [[[T::default(); 12]; BLOCK]; BLOCK], times: [[0.0; BLOCK]; BLOCK] }
    }

    #[inline(always)]
    fn place(number: u64) -> (usize, usize) {
        let place = (number % LENGTH) as usize;
        (place / BLOCK, place % BLOCK)
    }

    #[inline(always)]
    pub fn put(&mut self, number: u64, time_s: f64, sample: &[T; 12]) {
        let (block, place) = Self::place(number);
        self.samples[block][place] = *sample;
        self.times[block][place] = time_s;
    }

    #[inline(always)]
    pub fn time(&self, number: u64) -> f64 {
        let (block, place) = Self::place(number);
        self.times[block][place]
    }

    #[inline(always)]
    pub fn row(&self, number: u64) -> &[T; 12] {
        let (block, place) = Self::place(number);
        &self.samples[block][place]
    }

    #[inline(always)]
    fn part(&self, number: u64, from: usize) -> Vec3<T> {
        let s = self.row(number);
        [s[from], s[from + 1], s[from + 2]]
    }

    /// Whether the row of a sensor is the same in all six channels.
    #[inline(always)]
    pub fn has(&self, number: u64, sensor: usize, sample: &[T; 12]) -> bool {
        let (held, new) = (self.row(number), sample);
        let from = 6 * sensor;
        held[from] == new[from] && (1..6).all(|k| held[from + k] == new[from + k])
    }

    /// Replaces the row of a sensor by the straight line between two others.
    pub fn bridge(&mut self, number: u64, before: u64, after: u64, sensor: usize) {
        let share = (self.time(number) - self.time(before)) / (self.time(after) - self.time(before));
        let at = |number: u64, k: usize| self.row(number)[6 * sensor + k];
        let mut row = [T::default(); 6];
        for (k, value) in row.iter_mut().enumerate() {
            *value = at(before, k) + (at(after, k) - at(before, k)) * T::splat(share);
        }
        let (block, place) = Self::place(number);
        self.samples[block][place][6 * sensor..6 * sensor + 6].copy_from_slice(&row);
    }

    /// Rate of sensor `0` or `1`.
    #[inline(always)]
    pub fn gyr(&self, number: u64, sensor: usize) -> Vec3<T> {
        self.part(number, 6 * sensor)
    }

    #[inline(always)]
    pub fn acc(&self, number: u64, sensor: usize) -> Vec3<T> {
        self.part(number, 6 * sensor + 3)
    }

    /// Derivative of the rate at `number` on even samples; `scale` is `1/(12 h)`.
    #[inline(always)]
    pub fn gyr_dot(&self, number: u64, sensor: usize, step: u64, per: T) -> Vec3<T> {
        let at = |k: u64| self.gyr(k, sensor);
        five_points(at(number - 2 * step), at(number - step), at(number + step), at(number + 2 * step), per)
    }

    /// The same on uneven samples: the derivative of the parabola of degree four through all five points.
    pub fn gyr_dot_uneven(&self, number: u64, sensor: usize, step: u64) -> Vec3<T> {
        let numbers = [number - 2 * step, number - step, number, number + step, number + 2 * step];
        let offsets = numbers.map(|k| self.time(k) - self.time(number));
        let mut sum = [T::default(); 3];
        let mut middle = 0.0;
        for (j, dj) in offsets.iter().enumerate().filter(|(j, _)| *j != 2) {
            let others = offsets.iter().enumerate().filter(|(m, _)| *m != j && *m != 2);
            let weight = others.fold(1.0 / dj, |w, (_, dm)| w * dm / (dm - dj));
            middle -= 1.0 / dj;
            sum = add(sum, scale(self.gyr(numbers[j], sensor), T::splat(weight)));
        }
        add(sum, scale(self.gyr(number, sensor), T::splat(middle)))
    }
}

/// `(8(y₊₁ − y₋₁) − (y₊₂ − y₋₂))/12h`.
#[inline(always)]
pub(super) fn five_points<L: super::lane::Lane>(y0: Vec3<L>, y1: Vec3<L>, y3: Vec3<L>, y4: Vec3<L>, per: L) -> Vec3<L> {
    scale(sub(scale(sub(y3, y1), L::splat(8.0)), sub(y4, y0)), per)
}
