//! Minus the logarithm of the posterior (eq. 18, halved as a likelihood is), and its Gauss–Newton system.

use alloc::{vec, vec::Vec};
use nalgebra::{ComplexField, Matrix3, Matrix3x2, Vector3};

use super::{
    band::{Band, triangle, upper},
    factors::{
        axes_agree, axis_angle, gauge::Gauge, hinge, imu, joint_center, length_difference, length_limits, segment_length,
        skin::Seat,
    },
    loss::Loss,
    model::{Joint, LIMITS, Model, Seen, Skin},
    moments::Moments,
    states::{ACC_BIAS, GYR_BIAS, POSITION, State, TURN, UNKNOWNS, VELOCITY},
    tiles::{N, Row, Tile, add},
};

/// What the posterior is made of, but the unknowns.
#[derive(Clone, Debug)]
pub struct Problem<'a> {
    /// The body.
    pub model: &'a Model,
    /// What the sensors say.
    pub moments: &'a Moments,
    /// Joint centres beforehand; without effect where nothing is known.
    pub centers: Vec<[Vector3<f64>; 2]>,
    /// Where each stretch begins, and the gauge there.
    pub gauges: Vec<(usize, Gauge)>,
    /// Where other data have said what the constants are: their covariance, by rows. They are then held, and only how uncertain
    /// they are enters the uncertainty of all else (Schmidt 1966).
    pub held: Option<Vec<f64>>,
    /// Angle that moves each skin, moment by moment, rad.
    pub drives: Vec<f64>,
    /// Where the body rests: information that the velocity of the first sensor is the same at a moment and the next, 1/(m/s)²,
    /// moment by moment; zero elsewhere, and without effect where no samples lead to the next.
    pub rests: Vec<f64>,
    /// Directions in both sensors of each joint that usually agree.
    pub postures: Vec<[Vector3<f64>; 2]>,
    /// Information that they do, 1/rad², joint by joint at one moment after the other; zero where the motion tells.
    pub usual: Vec<f64>,
}

/// Information that holds a constant, 1/m² and 1/rad².
const HELD: f64 = 1e18;

/// Steps of this size are usual: rotation (rad), velocity (m/s), position (m), gyroscope (rad/s) and accelerometer bias (m/s²).
/// Damping is measured by them. The diagonal of the system would not do: a chain hardly resists moving as a whole, however stiff
/// each of its ties.
const SCALES: [f64; 5] = [0.3, 1.0, 1.0, 0.01, 0.1];
/// Likewise of joint centres, m, axes, rad, and skins, rad/rad and m/rad.
const CENTER_SCALE: f64 = 0.1;
const AXIS_SCALE: f64 = 0.3;
const SKIN_SCALES: [f64; 2] = [0.1, 0.03];
/// Rows of one joint at most: centre, hinge from both sides, both axes, posture.
const ROWS: usize = 15;

impl Problem<'_> {
    /// With the gauge and the centres of `start`.
    pub fn new<'a>(model: &'a Model, moments: &'a Moments, start: &State) -> Problem<'a> {
        let sensors = model.sensors;
        let begin = (0..moments.len()).filter(|&k| moments.begins(k));
        Problem {
            model,
            moments,
            centers: start.centers.clone(),
            gauges: begin.map(|k| (k, Gauge::of(&start.motions[k * sensors]))).collect(),
            held: None,
            drives: vec![0.0; moments.len() * model.skins.len()],
            rests: vec![0.0; moments.len()],
            postures: vec![[Vector3::zeros(); 2]; model.joints.len()],
            usual: vec![0.0; moments.len() * model.joints.len()],
        }
    }

    /// How a sensor sits on its bone at moment k.
    fn seat(&self, sensor: usize, k: usize, state: &State) -> Seat {
        let drives = &self.drives[k * self.model.skins.len()..];
        let own = |(skin, _): &(&Skin, _)| skin.sensor == sensor;
        Seat::new(self.model.skins.iter().zip(state.skins.iter().zip(drives)).filter(own).map(|(_, moved)| moved))
    }

    /// Usual size of a step of a constant.
    fn scale(&self, place: usize) -> f64 {
        let (axes, skins) = (6 * self.model.joints.len(), self.model.skin_at(0));
        if place < axes {
            CENTER_SCALE
        } else if place < skins {
            AXIS_SCALE
        } else {
            SKIN_SCALES[(place - skins) / 3 % 2]
        }
    }

    /// With nothing that says where the whole is and how fast it moves.
    pub fn unplaced(&self) -> Self {
        let gauges = self.gauges.iter().map(|(k, gauge)| (*k, Gauge { place: false, ..*gauge })).collect();
        Self { gauges, ..self.clone() }
    }

    /// The cost at `state`.
    pub fn cost(&self, state: &State) -> f64 {
        let (model, sensors, noise) = (self.model, self.model.sensors, &self.model.noise);
        let loss = Loss { tail: noise.tail };
        let mut cost = 0.0;
        for k in 0..self.moments.len() {
            let here = &state.motions[k * sensors..];
            if let Some(after) = state.motions.get((k + 1) * sensors..(k + 2) * sensors) {
                cost += 0.5 * self.rest(k) * (after[0].velocity - here[0].velocity).norm_squared();
                for s in 0..sensors {
                    let [gyr, acc] = self.walk_weights(k);
                    cost += 0.5 * gyr * (after[s].gyr_bias - here[s].gyr_bias).norm_squared();
                    cost += 0.5 * acc * (after[s].acc_bias - here[s].acc_bias).norm_squared();
                    if let Some(link) = &self.moments.links[k * sensors + s] {
                        let e = flat(&imu::residual(&link.pre, &here[s], &after[s], model.gravity));
                        cost += 0.5 * whitened(&link.whitening, &e).iter().map(|v| v * v).sum::<f64>();
                    }
                }
            }
            for (j, joint) in model.joints.iter().enumerate() {
                let usual = self.usual[k * model.joints.len() + j];
                if usual > 0.0 {
                    let [a, b] = joint.sensors.map(|s| &here[s]);
                    cost += 0.5 * usual * axes_agree::residual(a, b, &self.postures[j]).norm_squared();
                }
            }
            let mut sum = 0.0;
            self.joints(k, state, |terms| sum += terms.iter().map(|t| loss.cost(t.square)).sum::<f64>());
            cost += sum;
        }
        for (k, gauge) in &self.gauges {
            let at = &state.motions[k * sensors];
            let heading = gauge.heading_residual(at);
            let off = (at.position - gauge.position).norm_squared() + (at.velocity - gauge.velocity).norm_squared();
            cost += 0.5 * (heading * heading + if gauge.place { off } else { 0.0 }) / (noise.gauge * noise.gauge);
        }
        for (bias, at) in self.moments.biases.iter().zip(&state.motions) {
            cost += 0.5 * (at.gyr_bias - bias[0]).norm_squared() / (noise.gyr_bias * noise.gyr_bias);
            cost += 0.5 * (at.acc_bias - bias[1]).norm_squared() / (noise.acc_bias * noise.acc_bias);
        }
        let mut body = 0.0;
        self.constants(state, |e, std, _| body += 0.5 * e * e / (std * std));
        cost + body
    }

    /// Information of the biases' steps from moment k to the next, 1/(rad/s)² and 1/(m/s²)².
    fn walk_weights(&self, k: usize) -> [f64; 2] {
        let noise = &self.model.noise;
        let span = self.moments.moments[k].span_s.max(1e-9);
        [1.0 / (noise.gyr_walk * noise.gyr_walk * span), 1.0 / (noise.acc_walk * noise.acc_walk * span)]
    }

    /// Information of the first sensor's step of velocity from moment k to the next.
    fn rest(&self, k: usize) -> f64 {
        if self.moments.moments[k].linked { self.rests[k] } else { 0.0 }
    }

    /// Squares of the white residuals at `state`: of each sensor's dynamics (nine numbers) from each moment to the next, zero
    /// where no samples lead there, and of each joint (three numbers each): centre, hinge from either side, axes; zero where
    /// it has none.
    pub fn squares(&self, state: &State) -> (Vec<f64>, Vec<[f64; 4]>) {
        let (model, sensors) = (self.model, self.model.sensors);
        let links = self.moments.links.iter().enumerate().map(|(n, link)| {
            link.as_ref().map_or(0.0, |link| {
                let e = flat(&imu::residual(&link.pre, &state.motions[n], &state.motions[n + sensors], model.gravity));
                whitened(&link.whitening, &e).iter().map(|v| v * v).sum()
            })
        });
        let mut joints = Vec::with_capacity(self.moments.len() * model.joints.len());
        for k in 0..self.moments.len() {
            self.joints(k, state, |terms| {
                joints.push(core::array::from_fn(|n| terms.get(n).map_or(0.0, |term: &Term| term.square)));
            });
        }
        (links.collect(), joints)
    }

    /// White residuals of each joint at moment k, without derivatives.
    fn joints(&self, k: usize, state: &State, mut take: impl FnMut(&[Term])) {
        let sensors = self.model.sensors;
        for (j, joint) in self.model.joints.iter().enumerate() {
            let [a, b] = joint.sensors.map(|s| &state.motions[k * sensors + s]);
            let [rate_a, rate_b] = joint.sensors.map(|s| &self.moments.rates[k * sensors + s]);
            let seats = joint.sensors.map(|s| self.seat(s, k, state));
            let centers = [0, 1].map(|side| seats[side].point(&state.centers[j][side]));
            let center = joint_center::residual(a, b, &centers);
            let mut terms = [Term { square: center.component_div(&Vector3::from(joint.center_std)).norm_squared() }; 4];
            let mut count = 1;
            if let Some(std) = joint.hinge_std {
                let precision = 1.0 / self.hinge_variance(std, k, joint);
                let axes = &state.axes[j];
                terms[1].square = precision * hinge::residual(a, b, [rate_a, rate_b], &axes[0]).norm_squared();
                terms[2].square = precision * hinge::residual(b, a, [rate_b, rate_a], &axes[1]).norm_squared();
                count = 3;
                if let Some(std) = joint.axes_std {
                    terms[3].square = axes_agree::residual(a, b, axes).norm_squared() / (std * std);
                    count = 4;
                }
            }
            take(&terms[..count]);
        }
    }

    /// See [`hinge`]: what the hinge leaves open at moment k, and both sensors' rates.
    fn hinge_variance(&self, std: f64, k: usize, joint: &Joint) -> f64 {
        let rate = self.model.noise.rate * self.model.noise.rate;
        let rates = joint.sensors.map(|s| rate + self.moments.rate_variances[k * self.model.sensors + s]);
        std * std + 2.0 * (rates[0] + rates[1])
    }

    /// Empties `band` and adds all that depends on the constants alone; nodes follow by [`Self::node`].
    pub fn begin(&self, state: &State, damping: f64, band: &mut Band) {
        band.clear();
        let (gradient_tile, gradient_column) = band.gradient_place();
        let constants = band.constants;
        let corner = &mut band.corner;
        self.constants(state, |e, std, row| {
            let weight = 1.0 / (std * std);
            for &(i, u) in row {
                for &(j, v) in row.iter().filter(|(j, _)| *j >= i) {
                    corner[upper(i / N, j / N)].0[i % N][j % N] += weight * u * v;
                }
                corner[upper(i / N, gradient_tile)].0[i % N][gradient_column] += weight * u * e;
            }
        });
        for i in 0..constants {
            let scale = self.scale(i);
            corner[upper(i / N, i / N)].0[i % N][i % N] += damping / (scale * scale);
        }
        // What is open shall not stop the elimination: nothing is known of a joint centre beyond a kilometre.
        for i in 0..constants {
            corner[upper(i / N, i / N)].0[i % N][i % N] += if self.held.is_some() { HELD } else { 1e-6 };
        }
    }

    /// `δᵀ D δ` of the damping D.
    pub fn damped(&self, damping: f64, steps: &[f64], border: &[f64]) -> f64 {
        let scaled = |v: f64, scale: f64| v * v / (scale * scale);
        let nodes: f64 = steps
            .chunks_exact(N)
            .map(|step| step[..UNKNOWNS].iter().enumerate().map(|(a, v)| scaled(*v, SCALES[a / 3])).sum::<f64>())
            .sum();
        let constants: f64 = border.iter().enumerate().map(|(i, v)| scaled(*v, self.scale(i))).sum();
        damping * (nodes + constants)
    }

    /// Adds all that depends on moment k, and on it and the next.
    pub fn node(&self, k: usize, state: &State, damping: f64, band: &mut Band) {
        let (s, wide, width, tri) = (self.model.sensors, band.wide, band.width(), triangle(self.model.sensors));
        let (gradient_tile, gradient_column) = band.gradient_place();
        let noise = &self.model.noise;
        let here = &state.motions[k * s..(k + 1) * s];
        let push = |border: &mut [Tile], node: usize, sensor: usize, at: usize, value: f64| {
            border[(node * s + sensor) * wide + gradient_tile].0[at][gradient_column] += value;
        };
        for i in 0..s {
            let tile = &mut band.diagonal[k * tri + upper(i, i)];
            for (a, row) in tile.0.iter_mut().enumerate() {
                row[a] += if a < UNKNOWNS { damping / (SCALES[a / 3] * SCALES[a / 3]) } else { 1.0 };
            }
        }
        if k + 1 < self.moments.len() {
            let after = &state.motions[(k + 1) * s..(k + 2) * s];
            let walk = self.walk_weights(k);
            band.linked[k] = true;
            for i in 0..s {
                for (at, weight, step) in [
                    (GYR_BIAS, walk[0], after[i].gyr_bias - here[i].gyr_bias),
                    (ACC_BIAS, walk[1], after[i].acc_bias - here[i].acc_bias),
                    (VELOCITY, if i == 0 { self.rest(k) } else { 0.0 }, after[i].velocity - here[i].velocity),
                ] {
                    for c in 0..3 {
                        let a = at + c;
                        band.diagonal[k * tri + upper(i, i)].0[a][a] += weight;
                        band.diagonal[(k + 1) * tri + upper(i, i)].0[a][a] += weight;
                        band.next[k * s + i].0[a][a] -= weight;
                        push(&mut band.border, k, i, a, -weight * step[c]);
                        push(&mut band.border, k + 1, i, a, weight * step[c]);
                    }
                }
                let Some(link) = &self.moments.links[k * s + i] else { continue };
                let (residual, mut blocks) = imu::linearised(&link.pre, &here[i], &after[i], self.model.gravity);
                for row in &mut blocks {
                    row[0] *= here[i].turn.transpose();
                    row[5] *= after[i].turn.transpose();
                }
                let (mut from, mut to) = ([[0.0; N]; 9], [[0.0; N]; 9]);
                for (r, blocks) in blocks.iter().enumerate() {
                    for (c, block) in blocks.iter().enumerate() {
                        if c < 5 {
                            put(&mut from, 3 * r, 3 * c, block, 1.0)
                        } else {
                            put(&mut to, 3 * r, 3 * (c - 5), block, 1.0)
                        }
                    }
                }
                let e = whitened(&link.whitening, &flat(&residual));
                let (from, to) = (whitened_rows(&link.whitening, &from), whitened_rows(&link.whitening, &to));
                add(width, &mut band.diagonal[k * tri + upper(i, i)], &from, &from);
                add(width, &mut band.next[k * s + i], &from, &to);
                add(width, &mut band.diagonal[(k + 1) * tri + upper(i, i)], &to, &to);
                for (rows, node) in [(&from, k), (&to, k + 1)] {
                    for (row, e) in rows.iter().zip(&e) {
                        for (a, v) in row.iter().take(UNKNOWNS).enumerate() {
                            push(&mut band.border, node, i, a, v * e);
                        }
                    }
                }
            }
        }
        if let Some((_, gauge)) = self.gauges.iter().find(|(at, _)| *at == k) {
            let weight = 1.0 / (noise.gauge * noise.gauge);
            let at = &here[0];
            let (e, turn) = (gauge.heading_residual(at), at.turn * gauge.heading_turn(at));
            let tile = &mut band.diagonal[k * tri].0;
            for a in 0..3 {
                (0..3).for_each(|b| tile[TURN + a][TURN + b] += weight * turn[a] * turn[b]);
                push(&mut band.border, k, 0, TURN + a, weight * turn[a] * e);
                if !gauge.place {
                    continue;
                }
                for (place, off) in [(POSITION, at.position - gauge.position), (VELOCITY, at.velocity - gauge.velocity)] {
                    tile[place + a][place + a] += weight;
                    push(&mut band.border, k, 0, place + a, weight * off[a]);
                }
            }
        }
        if k == 0 {
            for (i, bias) in self.moments.biases.iter().enumerate() {
                for (at, std, off) in [
                    (GYR_BIAS, noise.gyr_bias, here[i].gyr_bias - bias[0]),
                    (ACC_BIAS, noise.acc_bias, here[i].acc_bias - bias[1]),
                ] {
                    let weight = 1.0 / (std * std);
                    for c in 0..3 {
                        band.diagonal[upper(i, i)].0[at + c][at + c] += weight;
                        push(&mut band.border, 0, i, at + c, weight * off[c]);
                    }
                }
            }
        }
        for j in 0..self.model.joints.len() {
            self.joint(j, k, state, band);
        }
    }

    /// Adds one joint at one moment.
    fn joint(&self, j: usize, k: usize, state: &State, band: &mut Band) {
        let (model, s, tri) = (self.model, self.model.sensors, triangle(self.model.sensors));
        let (gradient_tile, gradient_column) = band.gradient_place();
        let joint = &model.joints[j];
        let loss = Loss { tail: model.noise.tail };
        let [ia, ib] = joint.sensors;
        let (a, b) = (&state.motions[k * s + ia], &state.motions[k * s + ib]);
        let mut rows = Rows::new(band.wide, gradient_tile, gradient_column);

        let seats = joint.sensors.map(|s| self.seat(s, k, state));
        let drives = &self.drives[k * model.skins.len()..];
        let centers = [0, 1].map(|side| seats[side].point(&state.centers[j][side]));
        let center = joint_center::linearised(a, b, &centers);
        let inverse = Vector3::from(joint.center_std).map(|std| 1.0 / std);
        let (bent, residual) = loss.bend(&center.residual.component_mul(&inverse));
        let white = bent * Matrix3::from_diagonal(&inverse);
        rows.open(&residual);
        for (side, sign) in [(0, 1.0), (1, -1.0)] {
            rows.put(side, TURN, &(white * center.turns[side] * [a, b][side].turn.transpose()));
            rows.put(side, POSITION, &(white * sign));
            let by_center = white * center.centers[side];
            rows.put_wide(model.center_at(j, side), &(by_center * seats[side].turn));
            let by_turn = by_center * seats[side].by_turn(&state.centers[j][side]);
            for (n, (skin, angle)) in model.skins.iter().zip(drives).enumerate() {
                if skin.sensor == joint.sensors[side] {
                    rows.put_wide(model.skin_at(n), &(by_turn * *angle));
                    rows.put_wide(model.skin_at(n) + 3, &(by_center * *angle));
                }
            }
        }
        if let Some(std) = joint.hinge_std {
            let axes = &state.axes[j];
            let [rate_a, rate_b] = joint.sensors.map(|i| &self.moments.rates[k * s + i]);
            let precision = 1.0 / self.hinge_variance(std, k, joint);
            for side in 0..2 {
                let one = if side == 0 {
                    hinge::linearised(a, b, [rate_a, rate_b], &axes[0])
                } else {
                    hinge::linearised(b, a, [rate_b, rate_a], &axes[1])
                };
                let scale = ComplexField::sqrt(precision);
                let (bent, residual) = loss.bend(&(one.residual * scale));
                let white = bent * scale;
                rows.open(&residual);
                for (n, place) in [side, 1 - side].into_iter().enumerate() {
                    rows.put(place, TURN, &(white * one.turns[n] * [a, b][place].turn.transpose()));
                    rows.put(place, GYR_BIAS, &(white * one.biases[n]));
                }
                rows.put_pair(model.axis_at(j, side), &(white * one.axis));
            }
            if let Some(std) = joint.axes_std {
                let both = axes_agree::linearised(a, b, axes);
                let (bent, residual) = loss.bend(&(both.residual / std));
                let white = bent / std;
                rows.open(&residual);
                for side in 0..2 {
                    rows.put(side, TURN, &(white * both.turns[side] * [a, b][side].turn.transpose()));
                    rows.put_pair(model.axis_at(j, side), &(white * both.axes[side]));
                }
            }
        }
        let usual = self.usual[k * model.joints.len() + j];
        if usual > 0.0 {
            let both = axes_agree::linearised(a, b, &self.postures[j]);
            let scale = ComplexField::sqrt(usual);
            rows.open(&(both.residual * scale));
            for side in 0..2 {
                rows.put(side, TURN, &(both.turns[side] * [a, b][side].turn.transpose() * scale));
            }
        }
        rows.add_to(band, k, [ia, ib], s, tri);
    }

    /// Residual, standard deviation and derivatives (place in the border, value) of all that depends on the constants alone.
    fn constants(&self, state: &State, mut take: impl FnMut(f64, f64, &[(usize, f64)])) {
        let model = self.model;
        let seen = |at: &Seen| state.centers[at.joint][at.side];
        let bones: Vec<Vector3<f64>> = model.bones.iter().map(|b| seen(&b.ends[0]) - seen(&b.ends[1])).collect();
        let mut row: Vec<(usize, f64)> = Vec::with_capacity(16);
        let by_bone = |row: &mut Vec<(usize, f64)>, bone: usize, by: &Vector3<f64>| {
            for (end, sign) in model.bones[bone].ends.iter().zip([1.0, -1.0]) {
                (0..3).for_each(|c| row.push((model.center_at(end.joint, end.side) + c, sign * by[c])));
            }
        };
        for (n, bone) in model.bones.iter().enumerate() {
            if let Some([mean, std]) = bone.length {
                let (e, by) = segment_length::linearised(&bones[n], mean);
                row.clear();
                by_bone(&mut row, n, &by);
                take(e, std, &row);
            }
            if let Some(limits) = bone.limits {
                let (e, by) = length_limits::linearised(&bones[n], limits, LIMITS[0]);
                row.clear();
                by_bone(&mut row, n, &by);
                take(e, LIMITS[1], &row);
            }
        }
        for angle in &model.angles {
            let axis = &state.axes[angle.axis.joint][angle.axis.side];
            let (e, by_axis, by) = axis_angle::linearised(axis, &bones[angle.bone], angle.angle[0]);
            row.clear();
            by_bone(&mut row, angle.bone, &by);
            let at = model.axis_at(angle.axis.joint, angle.axis.side);
            (0..2).for_each(|c| row.push((at + c, by_axis[c])));
            take(e, angle.angle[1], &row);
        }
        for difference in &model.differences {
            let (e, by) = length_difference::linearised(difference.bones.map(|b| &bones[b]));
            row.clear();
            for (bone, by) in difference.bones.into_iter().zip(&by) {
                by_bone(&mut row, bone, by);
            }
            take(e, difference.std, &row);
        }
        for (n, (skin, [turn, shift])) in model.skins.iter().zip(&state.skins).enumerate() {
            for c in 0..3 {
                take(turn[c], skin.turn_std, &[(model.skin_at(n) + c, 1.0)]);
                take(shift[c], skin.shift_std, &[(model.skin_at(n) + 3 + c, 1.0)]);
            }
        }
        if model.noise.center.is_finite() {
            for (j, (now, before)) in state.centers.iter().zip(&self.centers).enumerate() {
                for side in 0..2 {
                    let off = now[side] - before[side];
                    (0..3).for_each(|c| take(off[c], model.noise.center, &[(model.center_at(j, side) + c, 1.0)]));
                }
            }
        }
    }
}

#[derive(Clone, Copy)]
struct Term {
    /// Of the white residual.
    square: f64,
}

/// White rows of one joint: the tiles of both sensors and those of the border.
struct Rows {
    count: usize,
    sides: [[Row; ROWS]; 2],
    wide: Vec<[Row; ROWS]>,
    /// Which tiles of the border hold anything: few do.
    used: Vec<bool>,
    gradient: (usize, usize),
}

impl Rows {
    fn new(wide: usize, gradient_tile: usize, gradient_column: usize) -> Self {
        let none = [[0.0; N]; ROWS];
        let mut used = vec![false; wide];
        used[gradient_tile] = true;
        Self { count: 0, sides: [none; 2], wide: vec![none; wide], used, gradient: (gradient_tile, gradient_column) }
    }

    /// Begins three rows with this residual.
    fn open(&mut self, residual: &Vector3<f64>) {
        (0..3).for_each(|c| self.wide[self.gradient.0][self.count + c][self.gradient.1] = residual[c]);
        self.count += 3;
    }

    fn put(&mut self, side: usize, at: usize, block: &Matrix3<f64>) {
        let from = self.count - 3;
        for r in 0..3 {
            (0..3).for_each(|c| self.sides[side][from + r][at + c] += block[(r, c)]);
        }
    }

    fn put_wide(&mut self, at: usize, block: &Matrix3<f64>) {
        let from = self.count - 3;
        for c in 0..3 {
            self.used[(at + c) / N] = true;
            (0..3).for_each(|r| self.wide[(at + c) / N][from + r][(at + c) % N] += block[(r, c)]);
        }
    }

    fn put_pair(&mut self, at: usize, block: &Matrix3x2<f64>) {
        let from = self.count - 3;
        for c in 0..2 {
            self.used[(at + c) / N] = true;
            (0..3).for_each(|r| self.wide[(at + c) / N][from + r][(at + c) % N] += block[(r, c)]);
        }
    }

    fn add_to(&self, band: &mut Band, k: usize, sensors: [usize; 2], s: usize, tri: usize) {
        let (width, count, wide) = (band.width(), self.count, band.wide);
        for (side, sensor) in sensors.into_iter().enumerate() {
            let rows = &self.sides[side][..count];
            add(width, &mut band.diagonal[k * tri + upper(sensor, sensor)], rows, rows);
            for (c, beside) in self.wide.iter().enumerate().filter(|(c, _)| self.used[*c]) {
                add(width, &mut band.border[(k * s + sensor) * wide + c], rows, &beside[..count]);
            }
        }
        let (low, high) = if sensors[0] < sensors[1] { (0, 1) } else { (1, 0) };
        let tile = &mut band.diagonal[k * tri + upper(sensors[low], sensors[high])];
        add(width, tile, &self.sides[low][..count], &self.sides[high][..count]);
        for c in (0..wide).filter(|c| self.used[*c]) {
            for b in (0..=c).filter(|b| self.used[*b]) {
                add(width, &mut band.corner[upper(b, c)], &self.wide[b][..count], &self.wide[c][..count]);
            }
        }
        // The square of the residual itself is no part of the system.
        let (tile, column) = self.gradient;
        let squares: f64 = self.wide[tile][..count].iter().map(|r| r[column] * r[column]).sum();
        band.corner[upper(tile, tile)].0[column][column] -= squares;
    }
}

fn put(rows: &mut [Row; 9], from: usize, at: usize, block: &Matrix3<f64>, sign: f64) {
    for r in 0..3 {
        (0..3).for_each(|c| rows[from + r][at + c] = sign * block[(r, c)]);
    }
}

fn flat(e: &imu::Residual) -> [f64; 9] {
    core::array::from_fn(|k| e[k / 3][k % 3])
}

fn whitened(whitening: &[[f64; 9]; 9], e: &[f64; 9]) -> [f64; 9] {
    core::array::from_fn(|i| whitening[i][..=i].iter().zip(e).map(|(w, v)| w * v).sum())
}

fn whitened_rows(whitening: &[[f64; 9]; 9], rows: &[Row; 9]) -> [Row; 9] {
    let mut white = [[0.0; N]; 9];
    for (i, out) in white.iter_mut().enumerate() {
        for (w, row) in whitening[i][..=i].iter().zip(rows) {
            out.iter_mut().zip(row).for_each(|(v, r)| *v += w * r);
        }
    }
    white
}
