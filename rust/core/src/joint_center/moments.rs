//! The samples that a joint centre is estimated from.

use alloc::vec::Vec;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::loss::{CHUNK, Chunk};
use crate::{Xyz, rigid_body::Moment};

/// Many [`Moment`]s, laid out so that [`CHUNK`] of them go through the arithmetic side by side.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Moments {
    time_s: Vec<f64>,
    /// gyr, gyr_dot, acc of sensor 1, then of sensor 2, x y z each. The last block is filled up with zeros.
    blocks: Vec<[Chunk; 18]>,
    /// What the gyroscopes are known to show at rest, rad/s; taken off wherever rates are used.
    gyr_bias: [Xyz; 2],
}

/// One sensor at one instant: gyr, gyr_dot, acc.
pub type Side = [Vector3<f64>; 3];

impl Moments {
    /// Adds one moment.
    pub fn push(&mut self, m: &Moment) {
        let place = self.time_s.len() % CHUNK;
        if place == 0 {
            self.blocks.push([[0.0; CHUNK]; 18]);
        }
        self.time_s.push(m.time_s);
        let Some(block) = self.blocks.last_mut() else { return };
        let s = &m.sample;
        for k in 0..3 {
            block[k][place] = s[k];
            block[3 + k][place] = m.gyr_dot1[k];
            block[6 + k][place] = s[3 + k];
            block[9 + k][place] = s[6 + k];
            block[12 + k][place] = m.gyr_dot2[k];
            block[15 + k][place] = s[9 + k];
        }
    }

    /// What the gyroscopes are known to show at rest, rad/s: taken off from now on.
    pub fn set_gyr_bias(&mut self, gyr_bias: [Xyz; 2]) {
        self.gyr_bias = gyr_bias;
    }

    /// See [`Self::set_gyr_bias`].
    pub fn gyr_bias(&self) -> [Vector3<f64>; 2] {
        self.gyr_bias.map(Into::into)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// Their times, s.
    pub fn time_s(&self) -> &[f64] {
        &self.time_s
    }

    /// Channels of [`CHUNK`] moments at a time, and how many of them count.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = (&[Chunk; 18], usize)> {
        let count = self.len();
        self.blocks.iter().enumerate().map(move |(n, block)| (block, (count - n * CHUNK).min(CHUNK)))
    }

    /// Both sensors at one instant, biases of the gyroscopes taken off.
    pub fn at(&self, k: usize) -> [Side; 2] {
        let block = &self.blocks[k / CHUNK];
        let vector = |c: usize| Vector3::new(block[c][k % CHUNK], block[c + 1][k % CHUNK], block[c + 2][k % CHUNK]);
        let [bias1, bias2] = self.gyr_bias();
        [[vector(0) - bias1, vector(3), vector(6)], [vector(9) - bias2, vector(12), vector(15)]]
    }

    /// Those at the given places.
    pub(super) fn picked(&self, places: impl Iterator<Item = usize>) -> Self {
        let mut picked = Self { gyr_bias: self.gyr_bias, ..Self::default() };
        for (place, k) in places.enumerate() {
            if place % CHUNK == 0 {
                picked.blocks.push([[0.0; CHUNK]; 18]);
            }
            picked.time_s.push(self.time_s[k]);
            let (Some(to), from) = (picked.blocks.last_mut(), &self.blocks[k / CHUNK]) else { break };
            for (to, from) in to.iter_mut().zip(from) {
                to[place % CHUNK] = from[k % CHUNK];
            }
        }
        picked
    }

    /// About `count` of them, evenly spread.
    pub fn thinned(&self, count: usize) -> Self {
        self.picked((0..self.len()).step_by((self.len() / count.max(1)).max(1)))
    }

    /// Whether this, read back, hangs together.
    pub(super) fn is_sound(&self) -> bool {
        self.blocks.len() == self.len().div_ceil(CHUNK)
    }
}
