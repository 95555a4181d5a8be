//! Numerics of imufast: joint calibration and joint motion from body-worn inertial sensors.
//!
//! # Conventions
//!
//! * **Units.** SI: angular rate `gyr` in rad/s, specific force `acc` in m/s² (+g along the upward axis at rest), metres,
//!   seconds, radians. Degrees appear only in names that end in `_deg`.
//! * **Frames.** A sensor's samples are in its own frame; sensor 1 and sensor 2 sit on the two segments of one joint.
//! * **Quaternions.** Hamilton, scalar first `[w, x, y, z]`; `q_ab` takes vectors of frame b to frame a, `q_12` takes
//!   sensor 2 to sensor 1. Perturbations act on the right; in a stacked tangent vector rotation comes first.
//! * **Hinge axes** are a pair `(j1, j2)` of unit vectors, one in each sensor frame, with one common sign. The relative
//!   rate about the axis is `j2·ω2 − j1·ω1`; its integral is the joint angle.
//! * **Joint centre.** Inside this crate `r_i` points from the joint centre to sensor i, in sensor frame i (eq. 4 of
//!   Olsson 2020); the public API speaks of the centre as seen from the sensor, `−r_i`.
//! * **Determinism.** Sums run in a fixed order over a fixed number of lanes, so wider vector instructions chosen at run
//!   time give the same bits as narrow ones.
//!
//! # Map
//!
//! | module | holds |
//! | --- | --- |
//! | [`so3`] | tangent planes of the unit sphere, Jacobian of the exponential map |
//! | [`lowpass`] | the one low-pass: a symmetric FIR with stated delay |
//! | [`condition`] | even time, low-pass, breaks: what comes before any algorithm |
//! | [`held`] | rows that stand for lost packets |
//! | [`reservoir`] | bounded memory of an endless stream |
//! | [`rest`] | gyroscope bias from rest |
//! | [`state`] | saved states |
//! | [`rigid_body`] | lever matrix K(ω, ω̇), joint-centre acceleration, central differences |
//! | [`orientation`] | relative orientation, Remmerswaal et al. 2021 |
//! | [`hinge`] | hinge axis, Olsson et al. 2020 |
//! | [`joint_center`] | joint centre, Olsson & Halvorsen 2017 |
//! | [`body`] | lower body, McGrath & Stirling 2020 |
#![cfg_attr(not(feature = "std"), no_std)]
extern crate alloc;

pub mod body;
pub mod condition;
pub mod held;
pub mod hinge;
pub mod joint_center;
pub mod lowpass;
pub mod orientation;
pub mod reservoir;
pub mod rest;
pub mod rigid_body;
pub mod so3;
pub mod state;
mod wide;

/// A vector in a sensor frame, as it arrives: x, y, z.
pub type Xyz = [f64; 3];
/// One instant of two sensors: gyr1, acc1, gyr2, acc2.
pub type PairSample = [f64; 12];

/// Checksum of saved bytes: CRC-32.
pub fn checksum(bytes: &[u8]) -> u32 {
    crc32fast::hash(bytes)
}
