//! Two segments with a spherical joint whose truth is known, the same in every run.

use imufast_core::{
    PairSample,
    joint_center::{
        Unknowns,
        moments::{Moments, Side},
        stream::{CenterStream, StreamSettings},
    },
    rigid_body::{Moment, Stencil},
};
use nalgebra::{Matrix3, Rotation3, Vector3};

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

    pub fn vector(&mut self, size: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| size * self.normal())
    }
}

/// Lever arms and biases of [`BallJoint`].
pub fn truth() -> Unknowns {
    Unknowns::from_column_slice(&[0.21, -0.05, 0.08, -0.17, 0.11, 0.04, 0.15, -0.2, 0.1, -0.12, 0.07, 0.18])
}

/// Two sensors about a joint that wanders; `size` scales all angles, `noise` all readings.
pub struct BallJoint {
    pub size: f64,
    pub noise: f64,
    random: Random,
}

impl BallJoint {
    pub fn new(seed: u64, size: f64, noise: f64) -> Self {
        Self { size, noise, random: Random(seed) }
    }

    /// Heading, elevation and roll of a segment with their rates, and the rates of the sensor from these.
    fn turn(&self, segment: usize, t: f64) -> (Rotation3<f64>, Vector3<f64>) {
        let s = segment as f64;
        let wave = |size: f64, rate: f64, shift: f64| {
            let size = self.size * size;
            [size * (rate * t + shift).sin(), size * rate * (rate * t + shift).cos()]
        };
        let sum = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
        let [heading, heading_rate] = sum(wave(0.8, 2.1 + s, 0.3), wave(0.4, 5.3 - s, s));
        let [pitch, pitch_rate] = sum(wave(0.5, 3.2 - 0.7 * s, 1.0 + s), wave(0.2, 6.1, 0.1));
        let [roll, roll_rate] = sum(wave(0.7, 1.7 + 0.4 * s, 2.0), wave(0.3, 4.4 + s, 0.5));
        let gyr = Vector3::new(
            roll_rate - heading_rate * pitch.sin(),
            pitch_rate * roll.cos() + heading_rate * pitch.cos() * roll.sin(),
            -pitch_rate * roll.sin() + heading_rate * pitch.cos() * roll.cos(),
        );
        (Rotation3::from_euler_angles(roll, pitch, heading), gyr)
    }

    /// What both sensors read at `t`, s, and what turns them.
    pub fn moment(&mut self, t: f64) -> Moment {
        let at_joint = Vector3::new((1.3 * t).sin(), 0.7 * (2.9 * t).cos(), 9.81 + (2.1 * t).cos());
        let x = truth();
        let mut moment = Moment { time_s: t, sample: [0.0; 12], gyr_dot1: [0.0; 3], gyr_dot2: [0.0; 3] };
        for segment in 0..2 {
            let h = 1e-5;
            let (attitude, gyr) = self.turn(segment, t);
            let gyr_dot = (self.turn(segment, t + h).1 - self.turn(segment, t - h).1) / (2.0 * h);
            let r: Vector3<f64> = x.fixed_rows::<3>(3 * segment).into();
            let bias: Vector3<f64> = x.fixed_rows::<3>(6 + 3 * segment).into();
            let acc = attitude.inverse() * at_joint + gyr.cross(&gyr.cross(&r)) + gyr_dot.cross(&r) + bias;
            let noisy_gyr = gyr + self.random.vector(0.1 * self.noise);
            let noisy_acc = acc + self.random.vector(self.noise);
            moment.sample[6 * segment..6 * segment + 3].copy_from_slice(noisy_gyr.as_slice());
            moment.sample[6 * segment + 3..6 * segment + 6].copy_from_slice(noisy_acc.as_slice());
            let dot = if segment == 0 { &mut moment.gyr_dot1 } else { &mut moment.gyr_dot2 };
            *dot = gyr_dot.into();
        }
        moment
    }

    /// `count` samples at 100 Hz from `start_s` on.
    pub fn samples(&mut self, start_s: f64, count: usize) -> Vec<(f64, PairSample)> {
        (0..count).map(|k| start_s + k as f64 * 0.01).map(|t| (t, self.moment(t).sample)).collect()
    }

    /// `count` moments 0.03 s apart.
    pub fn moments(&mut self, count: usize) -> Moments {
        let mut moments = Moments::default();
        (0..count).for_each(|k| moments.push(&self.moment(0.03 * k as f64)));
        moments
    }
}

/// One sensor of no motion at all, only numbers.
pub fn side(random: &mut Random) -> Side {
    let matrix = |random: &mut Random, size: f64| Matrix3::from_fn(|_, _| size * random.normal());
    Side { a: random.vector(10.0), b: matrix(random, 1.0), c: matrix(random, 15.0), gyr: random.vector(2.0) }
}

/// Smoothed moments of no motion at all.
pub fn scattered_smooth(seed: u64, count: usize) -> Moments {
    let (mut random, mut moments) = (Random(seed), Moments::default());
    (0..count).for_each(|k| moments.push_smooth(0.13 * k as f64, &[side(&mut random), side(&mut random)]));
    moments
}

/// Raw moments of no motion at all.
pub fn scattered(seed: u64, count: usize) -> Moments {
    let (mut random, mut moments) = (Random(seed), Moments::default());
    for k in 0..count {
        let sample = core::array::from_fn(|c| if c % 6 < 3 { 2.0 } else { 10.0 } * random.normal());
        let (gyr_dot1, gyr_dot2) = (random.vector(15.0).into(), random.vector(15.0).into());
        moments.push(&Moment { time_s: 0.13 * k as f64, sample, gyr_dot1, gyr_dot2 });
    }
    moments
}

pub fn settings() -> StreamSettings {
    StreamSettings {
        rate_hz: 100.0,
        lowpass_hz: 5.0,
        stencil: Stencil::Five,
        least_rate: 0.0,
        max_samples: 200,
        gyr_bias: None,
        bias_from_rest: true,
    }
}

pub fn raw_settings() -> StreamSettings {
    StreamSettings { lowpass_hz: 0.0, stencil: Stencil::Three, bias_from_rest: false, ..settings() }
}

pub fn fed(settings: StreamSettings, samples: &[(f64, PairSample)]) -> CenterStream {
    let mut stream = CenterStream::new(settings);
    stream.push(samples.iter().copied());
    stream
}
