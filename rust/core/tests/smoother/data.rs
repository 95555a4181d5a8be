//! A ball joint whose two segments swing, with exact truth; the same in every run.

use imufast_core::{
    Xyz,
    orientation::smoother::{Options, Prior, Smoothed, smooth},
};
use nalgebra::{SVector, UnitQuaternion, Vector3};

/// Seeded numbers (splitmix64), so that a failure can be had again.
pub struct Random(pub u64);

impl Random {
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (core::f64::consts::TAU * self.uniform()).cos()
    }

    pub fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal())
    }

    pub fn rotation(&mut self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(self.vector() * 2.0)
    }
}

/// A smooth function of time: three waves in each component.
struct Wave {
    amplitude: [Vector3<f64>; 3],
    rate: [f64; 3],
    phase: [Vector3<f64>; 3],
}

impl Wave {
    fn new(random: &mut Random, size: f64) -> Self {
        Self {
            amplitude: [0, 1, 2].map(|_| random.vector() * size),
            rate: [0, 1, 2].map(|_| 1.0 + 5.0 * random.uniform()),
            phase: [0, 1, 2].map(|_| random.vector() * 3.0),
        }
    }

    fn at(&self, t: f64) -> Vector3<f64> {
        (0..3).map(|k| self.phase[k].map(|p| (self.rate[k] * t + p).sin()).component_mul(&self.amplitude[k])).sum()
    }
}

/// What two sensors read, and the truth.
pub struct Recording {
    pub time_s: Vec<f64>,
    pub gyr: [Vec<Xyz>; 2],
    pub acc: [Vec<Xyz>; 2],
    pub q_12: Vec<UnitQuaternion<f64>>,
    pub levers: [Vector3<f64>; 2],
}

/// How to make one.
#[derive(Clone, Copy)]
pub struct Recipe {
    pub seed: u64,
    pub seconds: f64,
    pub swing: f64,
    pub sway: f64,
    pub noise: f64,
}

pub const STEP_S: f64 = 0.02;

impl Recipe {
    pub fn usual(seed: u64) -> Self {
        Self { seed, seconds: 30.0, swing: 0.35, sway: 0.06, noise: 1.0 }
    }

    /// Rates and accelerations are differences over a millisecond: exact to about 1e-6 of themselves.
    pub fn make(self) -> Recording {
        let mut random = Random(self.seed);
        let waves = [Wave::new(&mut random, self.swing), Wave::new(&mut random, self.swing)];
        let sway = Wave::new(&mut random, self.sway);
        let mounts = [random.rotation(), random.rotation()];
        let levers = [random.vector() * 0.12, random.vector() * 0.12];
        let gyr_bias = [random.vector() * 0.005, random.vector() * 0.005];
        let acc_bias = [random.vector() * 0.1, random.vector() * 0.1];
        let turn = |i: usize, t: f64| UnitQuaternion::from_scaled_axis(waves[i].at(t)) * mounts[i];
        let place = |i: usize, t: f64| sway.at(t) + turn(i, t) * levers[i];
        let count = (self.seconds / STEP_S) as usize;
        let time_s: Vec<f64> = (0..count).map(|k| k as f64 * STEP_S).collect();
        let d = 1e-3;
        let mut gyr = [Vec::new(), Vec::new()];
        let mut acc = [Vec::new(), Vec::new()];
        for &t in &time_s {
            for i in 0..2 {
                let rate = (turn(i, t - d).inverse() * turn(i, t + d)).scaled_axis() / (2.0 * d);
                let pull = (place(i, t + d) - place(i, t) * 2.0 + place(i, t - d)) / (d * d);
                let force = turn(i, t).inverse() * (pull + Vector3::z() * 9.81);
                gyr[i].push((rate + gyr_bias[i] + random.vector() * (0.004 * self.noise)).into());
                acc[i].push((force + acc_bias[i] + random.vector() * (0.04 * self.noise)).into());
            }
        }
        let q_12 = time_s.iter().map(|&t| turn(0, t).inverse() * turn(1, t)).collect();
        Recording { time_s, gyr, acc, q_12, levers }
    }
}

/// Nothing is known but what can be.
pub fn ignorant() -> Prior {
    let mut std = SVector::<f64, 18>::repeat(0.5);
    std.fixed_rows_mut::<6>(6).fill(0.3);
    std.fixed_rows_mut::<6>(12).fill(0.02);
    Prior::independent(SVector::zeros(), &std)
}

impl Recording {
    pub fn smooth(&self, options: &Options) -> Smoothed {
        self.smooth_until(options, &mut || true)
    }

    pub fn smooth_until(&self, options: &Options, go_on: &mut dyn FnMut() -> bool) -> Smoothed {
        let (gyr, acc) = ([0, 1].map(|i| self.gyr[i].as_slice()), [0, 1].map(|i| self.acc[i].as_slice()));
        smooth(&self.time_s, gyr, acc, STEP_S, &ignorant(), options, go_on)
    }

    /// Error of every sample, perturbed on the right, rad.
    pub fn errors(&self, smoothed: &Smoothed) -> Vec<Vector3<f64>> {
        self.q_12.iter().zip(&smoothed.q_12).map(|(truth, q)| (truth.inverse() * rotation(q)).scaled_axis()).collect()
    }

    pub fn rms_deg(&self, smoothed: &Smoothed) -> f64 {
        let errors = self.errors(smoothed);
        (errors.iter().map(|e| e.norm_squared()).sum::<f64>() / errors.len() as f64).sqrt().to_degrees()
    }

    /// Keeps the samples that `keep` says.
    pub fn thinned(&self, keep: impl Fn(usize) -> bool) -> Self {
        let kept = |rows: &Vec<Xyz>| rows.iter().enumerate().filter(|(k, _)| keep(*k)).map(|(_, r)| *r).collect();
        Self {
            time_s: self.time_s.iter().enumerate().filter(|(k, _)| keep(*k)).map(|(_, t)| *t).collect(),
            gyr: [kept(&self.gyr[0]), kept(&self.gyr[1])],
            acc: [kept(&self.acc[0]), kept(&self.acc[1])],
            q_12: self.q_12.iter().enumerate().filter(|(k, _)| keep(*k)).map(|(_, q)| *q).collect(),
            levers: self.levers,
        }
    }
}

pub fn rotation(q: &[f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q[0], q[1], q[2], q[3]))
}

/// Covariance of one sample.
pub fn spread(c: &[f64; 6]) -> nalgebra::Matrix3<f64> {
    nalgebra::Matrix3::new(c[0], c[3], c[4], c[3], c[1], c[5], c[4], c[5], c[2])
}
