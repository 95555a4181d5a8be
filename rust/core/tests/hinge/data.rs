//! Data whose truth is known, the same in every run.

use imufast_core::{
    Xyz,
    hinge::{AxisPair, HingeCost, Weights},
};
use nalgebra::{Rotation3, Vector3};

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

    pub fn unit(&mut self) -> Vector3<f64> {
        self.vector().normalize()
    }

    pub fn axes(&mut self) -> AxisPair {
        AxisPair::new(self.unit(), self.unit())
    }
}

/// Pairs of axes where formulas break: random ones, the poles, a hair beside them, the coordinate axes.
pub fn delicate_axes(random: &mut Random) -> Vec<AxisPair> {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let beside = |v: Vector3<f64>, by: f64, random: &mut Random| v + by * random.vector();
    let mut axes = vec![AxisPair::new(z, z), AxisPair::new(-z, z), AxisPair::new(x, -z), AxisPair::new(y, x)];
    for by in [1e-3, 1e-6, 1e-9, 1e-12] {
        axes.push(AxisPair::new(beside(z, by, random), beside(-z, by, random)));
        axes.push(AxisPair::new(beside(-y, by, random), beside(x, by, random)));
    }
    axes.extend((0..20).map(|_| random.axes()));
    axes
}

pub type Pairs = Vec<(f64, Xyz, Xyz)>;

/// What two sensors on a hinge read at rest in between: rates that satisfy eq. 14 and accelerations that satisfy eq. 18.
pub fn hinge_samples(random: &mut Random, axes: &AxisPair, count: usize, noise: f64) -> (Pairs, Pairs) {
    // Takes vectors of frame 2 to frame 1 at joint angle zero.
    let align = Rotation3::rotation_between(&axes.j2, &axes.j1)
        .unwrap_or_else(|| Rotation3::new(core::f64::consts::PI * axes.tangent().b1.column(0)));
    let mut gyr = Pairs::new();
    let mut acc = Pairs::new();
    for k in 0..count {
        let time = k as f64 * 0.02;
        let to_1 = Rotation3::new(axes.j1 * random.normal()) * align;
        let shared = random.vector();
        let omega1 = shared + noise * random.vector();
        let omega2 = to_1.inverse() * shared + axes.j2 * (2.0 * random.normal()) + noise * random.vector();
        gyr.push((time, omega1.into(), omega2.into()));
        let force = 9.81 * random.unit();
        acc.push((time, (force + noise * random.vector()).into(), (to_1.inverse() * force + noise * random.vector()).into()));
    }
    (gyr, acc)
}

/// Samples that obey nothing.
pub fn any_samples(random: &mut Random, count: usize) -> (Pairs, Pairs) {
    let pairs = |scale: f64, random: &mut Random| -> Pairs {
        (0..count).map(|k| (k as f64 * 0.02, (scale * random.vector()).into(), (scale * random.vector()).into())).collect()
    };
    (pairs(2.0, random), pairs(9.0, random))
}

pub fn cost_of(weight_ratio: f64, gyr: &Pairs, acc: &Pairs) -> HingeCost {
    weighted_cost(Weights::published(weight_ratio), gyr, acc)
}

pub fn weighted_cost(weights: Weights, gyr: &Pairs, acc: &Pairs) -> HingeCost {
    HingeCost::new(weights, gyr.iter().map(|(t, a, b)| (*t, a, b)), acc.iter().map(|(t, a, b)| (*t, a, b)))
}
