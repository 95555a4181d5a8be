//! Random numbers, random poses, and differences.

use imufast_core::body::states::Motion;
use nalgebra::{UnitQuaternion, Vector3};

/// A small generator (SplitMix64) with normal draws by Box and Muller.
pub struct Random(pub u64);

impl Random {
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (core::f64::consts::TAU * self.uniform()).cos()
    }

    pub fn vector(&mut self, size: f64) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal()) * size
    }

    pub fn direction(&mut self) -> Vector3<f64> {
        self.vector(1.0).normalize()
    }

    pub fn motion(&mut self) -> Motion {
        let mut motion = Motion::turned(UnitQuaternion::from_scaled_axis(self.vector(1.0)));
        motion.velocity = self.vector(1.0);
        motion.position = self.vector(1.0);
        motion.gyr_bias = self.vector(0.02);
        motion.acc_bias = self.vector(0.2);
        motion
    }
}

/// The motion after a change of one of its 15 unknowns: on the right of the orientation, by a sum elsewhere.
pub fn nudged(motion: &Motion, at: usize, by: f64) -> Motion {
    let mut step = Vector3::zeros();
    step[at % 3] = by;
    let turned = Motion::turned(motion.q * UnitQuaternion::from_scaled_axis(step));
    let mut moved = *motion;
    match at / 3 {
        0 => (moved.q, moved.turn) = (turned.q, turned.turn),
        1 => moved.velocity += step,
        2 => moved.position += step,
        3 => moved.gyr_bias += step,
        _ => moved.acc_bias += step,
    }
    moved
}

/// Central difference of a vector function.
pub fn slope<const R: usize>(mut f: impl FnMut(f64) -> [f64; R]) -> [f64; R] {
    let h = 1e-6;
    let (low, high) = (f(-h), f(h));
    core::array::from_fn(|k| (high[k] - low[k]) / (2.0 * h))
}

/// The largest difference of two columns.
pub fn apart<const R: usize>(a: &[f64; R], b: &[f64; R]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}
