//! A planar linkage whose truth is known, the same in every run.

use imufast_core::{
    PairSample,
    hinge::{
        AxisPair, Weights,
        stream::{HingeStream, StreamSettings},
    },
};
use nalgebra::{Complex, Rotation3, Vector3};

/// Seeded numbers (splitmix64), so that a failure can be had again.
pub struct Random(pub u64);

impl Random {
    pub fn whole(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, limit: usize) -> usize {
        (self.whole() % limit as u64) as usize
    }

    pub fn uniform(&mut self) -> f64 {
        (self.whole() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (core::f64::consts::TAU * self.uniform()).cos()
    }

    pub fn mounting(&mut self) -> Rotation3<f64> {
        Rotation3::new(Vector3::from_fn(|_, _| 2.0 * self.normal()))
    }
}

/// Two sensors on a linkage that swings in a plane, mounted anyhow.
pub struct Linkage {
    pub mounts: [Rotation3<f64>; 2],
    noise: Random,
}

impl Linkage {
    pub fn new(seed: u64) -> Self {
        let mut noise = Random(seed);
        Self { mounts: [noise.mounting(), noise.mounting()], noise }
    }

    /// The hinge axis as each sensor sees it.
    pub fn axes(&self) -> AxisPair {
        AxisPair::new(self.mounts[0] * Vector3::z(), self.mounts[1] * Vector3::z())
    }

    /// What both sensors read at `t`, s, with a little noise.
    pub fn sample(&mut self, t: f64) -> PairSample {
        let arms = [Complex::new(0.1, -0.05), Complex::new(-0.12, 0.02)];
        // Angle of each segment with its two derivatives.
        let wave = |size: f64, rate: f64, shift: f64| {
            let (sin, cos) = (rate * t + shift).sin_cos();
            [size * sin, size * rate * cos, -size * rate * rate * sin]
        };
        let sum = |a: [f64; 3], b: [f64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        let angles = [sum(wave(0.8, 2.0, 0.0), wave(0.3, 4.7, 1.0)), sum(wave(1.1, 3.1, 0.4), wave(0.5, 1.3, 2.0))];
        let centre = Complex::new((1.3 * t).sin(), 9.81 + (2.1 * t).cos());
        let mut out = [0.0; 12];
        for (i, ([angle, rate, acceleration], arm)) in angles.into_iter().zip(arms).enumerate() {
            let seen = Complex::new(angle.cos(), -angle.sin()) * centre + Complex::new(-rate * rate, acceleration) * arm;
            let mut noisy = |v: Vector3<f64>, std: f64| self.mounts[i] * v + Vector3::from_fn(|_, _| std * self.noise.normal());
            let gyr = noisy(Vector3::new(0.0, 0.0, rate), 0.005);
            let acc = noisy(Vector3::new(seen.re, seen.im, 0.0), 0.05);
            out[6 * i..6 * i + 3].copy_from_slice(gyr.as_slice());
            out[6 * i + 3..6 * i + 6].copy_from_slice(acc.as_slice());
        }
        out
    }

    /// `count` samples at 50 Hz from `start_s` on.
    pub fn samples(&mut self, start_s: f64, count: usize) -> Vec<(f64, PairSample)> {
        (0..count).map(|k| start_s + k as f64 * 0.02).map(|t| (t, self.sample(t))).collect()
    }
}

pub fn settings() -> StreamSettings {
    StreamSettings {
        rate_hz: 50.0,
        lowpass_hz: 4.0,
        window_s: 0.42,
        max_samples: 200,
        energy_threshold: 1.0,
        always_quiet: true,
        settle_pairing: true,
        bias_from_rest: true,
        max_iterations: 300,
        weights: Weights { ratio: 50.0, rate_scale: 3.0, offset_prior: 5.0 },
    }
}

pub fn raw_settings() -> StreamSettings {
    StreamSettings { lowpass_hz: 0.0, ..settings() }
}

pub fn fed(settings: StreamSettings, samples: &[(f64, PairSample)]) -> HingeStream {
    let mut stream = HingeStream::new(settings);
    samples.iter().for_each(|(t, s)| stream.push(*t, s));
    stream
}

/// Angle between two directions as lines, rad.
pub fn line_angle(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b).abs())
}
