//! A ball joint whose truth is known, the same in every run.

use imufast_core::{
    PairSample, Xyz,
    orientation::{Estimate, Estimates, Filter, Joint, Noise, Settings, Signals, lane::Real, method::Method, run},
};
use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};

type V = Vector3<f64>;

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

    pub fn uniform(&mut self) -> f64 {
        (self.whole() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (core::f64::consts::TAU * self.uniform()).cos()
    }

    pub fn vector(&mut self, size: f64) -> V {
        V::from_fn(|_, _| size * self.normal())
    }

    pub fn mounting(&mut self) -> Rotation3<f64> {
        Rotation3::new(self.vector(2.0))
    }
}

/// A sum of sines with two derivatives.
#[derive(Clone)]
struct Wave(Vec<[f64; 3]>);

impl Wave {
    fn new(random: &mut Random, size: f64) -> Self {
        Self((0..3).map(|_| [size * random.normal(), 0.6 + 5.0 * random.uniform(), 6.3 * random.uniform()]).collect())
    }

    /// Value, first and second derivative.
    fn at(&self, t: f64) -> [f64; 3] {
        self.0.iter().fold([0.0; 3], |s, [a, w, p]| {
            let (sin, cos) = (w * t + p).sin_cos();
            [s[0] + a * sin, s[1] + a * w * cos, s[2] - a * w * w * sin]
        })
    }
}

/// Two sensors anywhere on two bodies that share a point.
#[derive(Clone)]
pub struct BallJoint {
    angles: [[Wave; 3]; 2],
    place: [Wave; 3],
    mounts: [Rotation3<f64>; 2],
    pub joint: Joint,
    pub noise: Noise,
    pub rate_hz: f64,
    seed: u64,
}

impl BallJoint {
    pub fn new(seed: u64, rate_hz: f64) -> Self {
        let mut r = Random(seed);
        let wave = |r: &mut Random, size: f64| [(); 3].map(|()| Wave::new(r, size));
        let angles = [wave(&mut r, 0.3), wave(&mut r, 0.4)];
        let place = wave(&mut r, 0.06);
        let mounts = [r.mounting(), r.mounting()];
        let (r1, r2) = (r.vector(0.12).into(), r.vector(0.12).into());
        let joint = Joint { r1, r2, ..Joint::default() };
        Self { angles, place, mounts, joint, noise: Noise { gyr_std: 0.005, acc_std: 0.05 }, rate_hz, seed }
    }

    fn rotation(&self, i: usize, t: f64) -> Rotation3<f64> {
        let [a, b, c] = self.angles[i].each_ref().map(|w| w.at(t)[0]);
        Rotation3::from_euler_angles(a, b, c) * self.mounts[i]
    }

    /// Rate of sensor i in its frame.
    fn rate(&self, i: usize, t: f64) -> V {
        let [[a, da, _], [b, db, _], [_, dc, _]] = self.angles[i].each_ref().map(|w| w.at(t));
        let roll = Rotation3::from_axis_angle(&V::x_axis(), a).inverse();
        let pitch = Rotation3::from_axis_angle(&V::y_axis(), b).inverse();
        self.mounts[i].inverse() * (V::x() * da + roll * (V::y() * db + pitch * (V::z() * dc)))
    }

    pub fn truth(&self, t: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_rotation_matrix(&(self.rotation(0, t).inverse() * self.rotation(1, t)))
    }

    fn ideal(&self, t: f64) -> PairSample {
        let force = V::from(self.place.each_ref().map(|w| w.at(t)[2])) + V::z() * 9.81;
        let mut out = [0.0; 12];
        for (i, r) in [self.joint.r1, self.joint.r2].into_iter().enumerate() {
            let (gyr, r) = (self.rate(i, t), V::from(r));
            let dot = (self.rate(i, t + 1e-5) - self.rate(i, t - 1e-5)) / 2e-5;
            let acc = self.rotation(i, t).inverse() * force + gyr.cross(&gyr.cross(&r)) + dot.cross(&r);
            out[6 * i..6 * i + 3].copy_from_slice(gyr.as_slice());
            out[6 * i + 3..6 * i + 6].copy_from_slice(acc.as_slice());
        }
        out
    }

    /// Samples at the given times, with noise and the joint's biases.
    pub fn at_times(&self, times: &[f64]) -> Recording {
        let mut random = Random(self.seed ^ 0xabcdef);
        let mut recording = Recording { time_s: times.to_vec(), ..Recording::default() };
        for t in times {
            let ideal = self.ideal(*t);
            let Joint { gyr_bias, acc_bias, .. } = self.joint;
            for (k, bias) in [gyr_bias[0], acc_bias[0], gyr_bias[1], acc_bias[1]].into_iter().enumerate() {
                let std = if k % 2 == 0 { self.noise.gyr_std } else { self.noise.acc_std };
                recording.xyz[k].push(core::array::from_fn(|c| ideal[3 * k + c] + bias[c] + std * random.normal()));
            }
            recording.truth.push(self.truth(*t));
        }
        recording
    }

    pub fn record(&self, seconds: f64) -> Recording {
        let times: Vec<f64> = (0..(seconds * self.rate_hz) as usize).map(|k| k as f64 / self.rate_hz).collect();
        self.at_times(&times)
    }

    pub fn settings(&self) -> Settings {
        Settings { rate_hz: self.rate_hz, joint: self.joint, noise: self.noise, ..Settings::default() }
    }
}

#[derive(Clone, Default)]
pub struct Recording {
    pub xyz: [Vec<Xyz>; 4],
    pub time_s: Vec<f64>,
    pub truth: Vec<UnitQuaternion<f64>>,
}

impl Recording {
    /// As an even recording.
    pub fn signals(&self) -> Signals<'_> {
        Signals { xyz: self.xyz.each_ref().map(|x| &x[..]), time_s: None }
    }

    /// With its times.
    pub fn timed(&self) -> Signals<'_> {
        Signals { time_s: Some(&self.time_s), ..self.signals() }
    }

    pub fn estimates<M: Method>(&self, settings: &Settings, method: M) -> Vec<Estimate> {
        run_over::<f64, M>(settings, method, &self.timed()).0
    }

    pub fn push_all<M: Method>(&self, filter: &mut Filter<f64, M>, samples: core::ops::Range<usize>) {
        for k in samples {
            filter.push(self.time_s[k], &self.signals().sample(k));
        }
    }

    /// Rotation vector from the estimate to the truth, for every sample.
    pub fn errors(&self, estimates: &[Estimate]) -> Vec<V> {
        assert_eq!(estimates.len(), self.truth.len());
        estimates.iter().zip(&self.truth).map(|(e, q)| (unit(e.q).inverse() * q).scaled_axis()).collect()
    }

    pub fn rms_deg(&self, estimates: &[Estimate]) -> f64 {
        let errors = self.errors(estimates);
        (errors.iter().map(V::norm_squared).sum::<f64>() / errors.len() as f64).sqrt().to_degrees()
    }
}

pub fn unit([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    let q = Quaternion::new(w, x, y, z);
    assert!((q.norm() - 1.0).abs() < 1e-6, "{}", q.norm());
    UnitQuaternion::from_quaternion(q)
}

/// A whole recording; what it leaves the filter as.
pub fn run_over<T: Real, M: Method>(settings: &Settings, method: M, signals: &Signals<'_>) -> (Vec<Estimate>, Filter<T, M>) {
    let mut estimates = Estimates::of_size(signals.len());
    let Some((done, filter)) = run(settings, method, signals, estimates.page(), &mut || true) else { panic!("was stopped") };
    (estimates.of(&done).collect(), filter)
}
