//! Which sensors there are, what ties them together, and how much each tie is worth.

use alloc::vec::Vec;

use crate::Xyz;

/// A joint between two sensors.
#[derive(Clone, Debug)]
pub struct Joint {
    /// The sensor nearer to the pelvis, and the other.
    pub sensors: [usize; 2],
    /// How far apart both sensors may see its centre, along each axis of the world, m.
    pub center_std: Xyz,
    /// Of a hinge: rate across its axis, rad/s; None for a ball.
    pub hinge_std: Option<f64>,
    /// Of a hinge: how far apart both sensors may see its axis, rad; None: not asked (the paper does not).
    pub axes_std: Option<f64>,
}

/// A joint's centre as one of its two sensors sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seen {
    /// The joint.
    pub joint: usize,
    /// 0: from the sensor nearer to the pelvis, 1: from the other.
    pub side: usize,
}

/// Two joint centres that one sensor sees: what lies between them has a length.
#[derive(Clone, Copy, Debug)]
pub struct Bone {
    /// Nearer to the pelvis first.
    pub ends: [Seen; 2],
    /// Mean and standard deviation in the population, or of the subject, m (eq. 13); None: not known.
    pub length: Option<[f64; 2]>,
    /// Least and most, m (eq. 14); None: no limits.
    pub limits: Option<[f64; 2]>,
}

/// The angle of a hinge's axis with a bone (eq. 12).
#[derive(Clone, Copy, Debug)]
pub struct AxisAngle {
    /// Whose axis, seen from which sensor.
    pub axis: Seen,
    /// The bone.
    pub bone: usize,
    /// Mean and standard deviation, rad.
    pub angle: [f64; 2],
}

/// How much the lengths of two bones may differ (eq. 16).
#[derive(Clone, Copy, Debug)]
pub struct Difference {
    /// The bones.
    pub bones: [usize; 2],
    /// Standard deviation, m.
    pub std: f64,
}

/// Skin and straps beneath a sensor, which turn and shift it on its bone in proportion to an angle of a joint nearby: the first
/// term of whatever they do in step with the movement. A thigh may have two of them, for knee and hip.
#[derive(Clone, Copy, Debug)]
pub struct Skin {
    /// Whose.
    pub sensor: usize,
    /// Turn about each axis beforehand, rad/rad, around zero.
    pub turn_std: f64,
    /// Shift along each axis beforehand, m/rad, around zero.
    pub shift_std: f64,
}

/// How sure the sensors are, and what is known beforehand.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    /// White noise of the gyroscopes, rad/s/√Hz.
    pub gyr: f64,
    /// Of the accelerometers, m/s²/√Hz.
    pub acc: f64,
    /// Of the integration itself, m/√s.
    pub position: f64,
    /// Random walk of the gyroscope biases, rad/s/√s.
    pub gyr_walk: f64,
    /// Of the accelerometer biases, m/s²/√s.
    pub acc_walk: f64,
    /// Angular rate at a moment against the gyroscope there, rad/s (eq. 4).
    pub rate: f64,
    /// Each gyroscope bias channel beforehand, rad/s.
    pub gyr_bias: f64,
    /// Each accelerometer bias channel beforehand, m/s².
    pub acc_bias: f64,
    /// Each coordinate of a joint centre against where the search starts, m; infinite: nothing known (the paper).
    pub center: f64,
    /// Where the first sensor is at first, m; how fast, m/s; where it heads, rad: the gauge (section 3.7).
    pub gauge: f64,
    /// Degrees of freedom of Student's t for joint centres and hinges; infinite: Gaussian (the paper).
    pub tail: f64,
}

/// The whole body.
#[derive(Clone, Debug)]
pub struct Model {
    /// Number of sensors; the first carries the gauge.
    pub sensors: usize,
    /// The joints, each sensor but the first distal of one.
    pub joints: Vec<Joint>,
    /// The bones.
    pub bones: Vec<Bone>,
    /// Hinge axes against bones.
    pub angles: Vec<AxisAngle>,
    /// Left against right.
    pub differences: Vec<Difference>,
    /// What soft tissue does in step with the movement; empty: sensors sit on bone (the paper).
    pub skins: Vec<Skin>,
    /// Standard deviations.
    pub noise: Noise,
    /// Gravity, m/s².
    pub gravity: f64,
}

/// Steepness a of the limits, 1/m, and their standard deviation, m (eq. 14).
pub const LIMITS: [f64; 2] = [4.0, 1e-3];

impl Model {
    /// Place of a joint's centre in the border.
    pub fn center_at(&self, joint: usize, side: usize) -> usize {
        6 * joint + 3 * side
    }

    /// Place of a hinge's axis in the border: two tangent directions.
    pub fn axis_at(&self, joint: usize, side: usize) -> usize {
        let hinges = self.joints[..joint].iter().filter(|j| j.hinge_std.is_some()).count();
        6 * self.joints.len() + 4 * hinges + 2 * side
    }

    /// Place of a skin in the border: turn, then shift.
    pub fn skin_at(&self, skin: usize) -> usize {
        self.axis_at(self.joints.len(), 0) + 6 * skin
    }

    /// Unknowns of the border.
    pub fn constants(&self) -> usize {
        self.skin_at(self.skins.len())
    }

    /// What is wrong with it, in words; None where nothing is.
    pub fn fault(&self) -> Option<&'static str> {
        let seen = |s: &Seen| s.joint < self.joints.len() && s.side < 2;
        let reached = |sensor: usize| self.joints.iter().filter(|j| j.sensors[1] == sensor).count();
        let checks = [
            (self.sensors > 0, "there must be a sensor"),
            (self.joints.iter().all(|j| j.sensors[0] < self.sensors && j.sensors[1] < self.sensors), "a joint names no sensor"),
            (self.joints.iter().all(|j| j.sensors[0] != j.sensors[1]), "a joint has one sensor on both sides"),
            (self.sensors > 0 && reached(0) == 0 && (1..self.sensors).all(|s| reached(s) == 1), "the joints must make a tree"),
            (self.bones.iter().all(|b| b.ends.iter().all(seen)), "a bone names no joint"),
            (self.angles.iter().all(|a| seen(&a.axis) && a.bone < self.bones.len()), "an angle names no bone"),
            (
                self.angles.iter().all(|a| self.joints.get(a.axis.joint).is_some_and(|j| j.hinge_std.is_some())),
                "an angle names no hinge",
            ),
            (self.skins.iter().all(|s| s.sensor < self.sensors), "a skin names no sensor"),
            (self.differences.iter().all(|d| d.bones.iter().all(|b| *b < self.bones.len())), "a difference names no bone"),
        ];
        checks.iter().find(|(good, _)| !good).map(|(_, what)| *what)
    }
}
