//! A simulated pair of legs, made here of smooth angles, solved from a start that is off.

use imufast_core::{
    Xyz,
    body::{
        assemble::Problem,
        band::Band,
        model::{AxisAngle, Bone, Difference, Joint, Model, Noise, Seen, Skin},
        moments::{Moments, Readings, Sampling, Spacing},
        solve::{Descent, Status, eliminated, minimise},
        states::{Motion, State},
        tiles::N,
    },
};
use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3};

use crate::data::Random;

/// Pelvis, thigh and shank: a ball and a hinge.
pub fn model() -> Model {
    let center_std = [0.01; 3];
    Model {
        sensors: 3,
        joints: vec![
            Joint { sensors: [0, 1], center_std, hinge_std: None, axes_std: None },
            Joint { sensors: [1, 2], center_std, hinge_std: Some(0.1), axes_std: None },
        ],
        bones: vec![
            Bone {
                ends: [Seen { joint: 0, side: 1 }, Seen { joint: 1, side: 0 }],
                length: Some([0.4, 0.03]),
                limits: Some([0.32, 0.48]),
            },
            Bone { ends: [Seen { joint: 0, side: 0 }, Seen { joint: 0, side: 0 }], length: None, limits: None },
        ],
        angles: vec![AxisAngle { axis: Seen { joint: 1, side: 0 }, bone: 0, angle: [1.5, 0.04] }],
        differences: vec![],
        skins: vec![],
        noise: Noise {
            gyr: 2e-4,
            acc: 3e-3,
            position: 1e-4,
            gyr_walk: 2e-5,
            acc_walk: 2e-4,
            rate: 1e-3,
            gyr_bias: 0.01,
            acc_bias: 0.05,
            center: 0.2,
            gauge: 1e-3,
            tail: f64::INFINITY,
        },
        gravity: 9.81,
    }
}

struct Wave([[f64; 3]; 3]);

impl Wave {
    fn new(random: &mut Random, size: f64) -> Self {
        Self(core::array::from_fn(|_| [size * (0.5 + random.uniform()), 1.0 + 3.0 * random.uniform(), 6.3 * random.uniform()]))
    }

    fn at(&self, t: f64) -> f64 {
        self.0.iter().map(|[a, w, p]| a * (w * t + p).sin()).sum()
    }
}

pub struct Body {
    pub time: Vec<f64>,
    pub gyr: Vec<Vec<Xyz>>,
    pub acc: Vec<Vec<Xyz>>,
    /// Truth at the samples, by sensor.
    pub truth: Vec<Vec<Motion>>,
    pub centers: Vec<[Vector3<f64>; 2]>,
    pub axes: Vec<[Vector3<f64>; 2]>,
}

/// Samples at 100 Hz by differences of an exact chain, with the noise of `model` or none.
pub fn body(seconds: f64, noise: bool, seed: u64) -> Body {
    let mut random = Random(seed);
    let waves: Vec<Wave> = [0.15, 0.15, 0.1, 0.3, 0.3, 0.2, 0.5].map(|size| Wave::new(&mut random, size)).into();
    let places: Vec<Wave> = (0..3).map(|_| Wave::new(&mut random, 0.05)).collect();
    let axis = Vector3::new(1.5f64.sin(), 0.0, 1.5f64.cos());
    let mounts: Vec<UnitQuaternion<f64>> = (0..3).map(|_| UnitQuaternion::from_scaled_axis(random.vector(1.0))).collect();
    let sensors = [Vector3::new(0.0, -0.12, 0.1), Vector3::new(0.08, 0.02, -0.22), Vector3::new(0.05, 0.02, -0.14)];
    let (hip, knee) = (Vector3::new(0.09, 0.0, 0.0), Vector3::new(0.0, 0.0, -0.4));
    let pose = |t: f64| -> Vec<(UnitQuaternion<f64>, Vector3<f64>)> {
        let turned =
            |k: usize| UnitQuaternion::from_scaled_axis(Vector3::new(waves[k].at(t), waves[k + 1].at(t), waves[k + 2].at(t)));
        let pelvis = turned(0);
        let thigh = pelvis * turned(3);
        let shank = thigh * UnitQuaternion::from_scaled_axis(axis * (waves[6].at(t) - 0.6));
        let at = Vector3::new(places[0].at(t), places[1].at(t), places[2].at(t));
        let hip_at = at + pelvis * hip;
        let knee_at = hip_at + thigh * knee;
        [(pelvis, at), (thigh, hip_at), (shank, knee_at)]
            .iter()
            .zip(&sensors)
            .zip(&mounts)
            .map(|((bone, seat), mount)| (bone.0 * mount, bone.1 + bone.0 * seat))
            .collect()
    };
    let h = 1e-3;
    let noise_of = model().noise;
    let count = (seconds * 100.0).round() as usize + 1;
    let time: Vec<f64> = (0..count).map(|n| n as f64 / 100.0).collect();
    let (mut gyr, mut acc, mut truth) = (vec![vec![]; 3], vec![vec![]; 3], vec![vec![]; 3]);
    let biases: Vec<[Vector3<f64>; 2]> =
        (0..3).map(|_| if noise { [random.vector(0.005), random.vector(0.03)] } else { [Vector3::zeros(); 2] }).collect();
    for &t in &time {
        let near: Vec<_> = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|k| pose(t + k * h)).into();
        for s in 0..3 {
            let q = |k: usize| near[k][s].0;
            let p = |k: usize| near[k][s].1;
            let small = (q(1).inverse() * q(3)).scaled_axis() / (2.0 * h);
            let wide = (q(0).inverse() * q(4)).scaled_axis() / (4.0 * h);
            let rate = (small * 4.0 - wide) / 3.0;
            let a = (-p(0) + p(1) * 16.0 - p(2) * 30.0 + p(3) * 16.0 - p(4)) / (12.0 * h * h);
            let force = q(2).inverse() * (a + Vector3::new(0.0, 0.0, 9.81));
            let white = if noise { 10.0 } else { 0.0 };
            let [bias_gyr, bias_acc] = biases[s];
            gyr[s].push((rate + bias_gyr + random.vector(noise_of.gyr * white)).into());
            acc[s].push((force + bias_acc + random.vector(noise_of.acc * white)).into());
            let mut motion = Motion::turned(q(2));
            motion.position = p(2);
            motion.velocity = (p(0) - p(1) * 8.0 + p(3) * 8.0 - p(4)) / (12.0 * h);
            (motion.gyr_bias, motion.acc_bias) = (bias_gyr, bias_acc);
            truth[s].push(motion);
        }
    }
    let seen = |s: usize, at: Vector3<f64>| mounts[s].inverse() * (at - sensors[s]);
    let zero = Vector3::zeros();
    let centers = vec![[seen(0, hip), seen(1, zero)], [seen(1, knee), seen(2, zero)]];
    let axes = vec![[Vector3::x(); 2], [mounts[1].inverse() * axis, mounts[2].inverse() * axis]];
    Body { time, gyr, acc, truth, centers, axes }
}

impl Body {
    pub fn readings(&self) -> Readings<'_> {
        Readings {
            time_s: &self.time,
            gyr: self.gyr.iter().map(|g| g.as_slice()).collect(),
            acc: self.acc.iter().map(|a| a.as_slice()).collect(),
            step_s: 0.01,
            sampling: Sampling::Instant,
        }
    }

    pub fn moments(&self, model: &Model) -> Moments {
        let spacing = Spacing { key_samples: 10, rate_samples: 0, bridge_s: 0.3 };
        Moments::new(&self.readings(), &spacing, &[[Vector3::zeros(); 2]; 3], &model.noise).expect("there is noise")
    }

    /// The truth, shaken.
    pub fn start(&self, moments: &Moments, random: &mut Random, turn: f64) -> State {
        let off: Vec<UnitQuaternion<f64>> = (0..3).map(|_| UnitQuaternion::from_scaled_axis(random.vector(turn))).collect();
        let mut motions = vec![];
        for moment in &moments.moments {
            for (s, off) in off.iter().enumerate() {
                let mut motion = self.truth[s][moment.sample];
                let turned = Motion::turned(off * motion.q);
                (motion.q, motion.turn) = (turned.q, turned.turn);
                (motion.gyr_bias, motion.acc_bias) = (Vector3::zeros(), Vector3::zeros());
                motions.push(motion);
            }
        }
        let shake = turn * 0.3;
        let centers = self.centers.iter().map(|c| c.map(|v| v + random.vector(shake * 0.3))).collect();
        let axes = self.axes.iter().map(|a| a.map(|v| (v + random.vector(shake)).normalize())).collect();
        State { motions, centers, axes, skins: vec![] }
    }
}

/// Angle between the relative orientations of two sensors, in degrees, at its worst.
fn worst_deg(body: &Body, moments: &Moments, state: &State, joint: [usize; 2]) -> f64 {
    let mut worst: f64 = 0.0;
    for (k, moment) in moments.moments.iter().enumerate() {
        let found = state.motions[k * 3 + joint[0]].q.inverse() * state.motions[k * 3 + joint[1]].q;
        let true_q = body.truth[joint[0]][moment.sample].q.inverse() * body.truth[joint[1]][moment.sample].q;
        worst = worst.max(found.angle_to(&true_q));
    }
    worst.to_degrees()
}

#[test]
fn the_system_is_the_gradient_of_the_cost_and_the_step_solves_it() {
    let (body, mut model) = (body(1.1, true, 5), model());
    model.joints[1].axes_std = Some(0.05);
    model.differences = vec![Difference { bones: [0, 0], std: 0.01 }];
    model.skins = [1, 1, 2].map(|sensor| Skin { sensor, turn_std: 0.05, shift_std: 0.01 }).into();
    for tail in [f64::INFINITY, 4.0] {
        model.noise.tail = tail;
        let moments = body.moments(&model);
        let mut random = Random(6);
        let mut start = body.start(&moments, &mut random, 0.05);
        start.skins = vec![[Vector3::zeros(); 2]; 3];
        let mut problem = Problem::new(&model, &moments, &start);
        problem.drives.iter_mut().for_each(|angle| *angle = random.normal());
        problem.rests.iter_mut().for_each(|rest| *rest = 1e4 * random.uniform());
        problem.usual.iter_mut().for_each(|usual| *usual = 30.0 * random.uniform());
        problem.postures.iter_mut().for_each(|pair| *pair = [random.direction(), random.direction()]);
        // Away from where gauge and priors are zero.
        let count = moments.len() * 3;
        let shake: Vec<f64> = (0..count * N).map(|_| 0.002 * random.normal()).collect();
        let beside: Vec<f64> = (0..model.constants()).map(|_| 0.01 * random.normal()).collect();
        let state = start.moved(&model, &shake, &beside);
        let mut band = Band::new(moments.len(), 3, model.constants());
        problem.begin(&state, 0.0, &mut band);
        (0..moments.len()).for_each(|k| problem.node(k, &state, 0.0, &mut band));
        let (tile, column) = band.gradient_place();
        let zeros = (vec![0.0; count * N], vec![0.0; model.constants()]);
        let scale = problem.cost(&state);
        let slope = |node: Option<usize>, at: usize| {
            let h = 1e-6;
            let cost = |by: f64| {
                let (mut steps, mut border) = zeros.clone();
                match node {
                    Some(node) => steps[node * N + at] = by,
                    None => border[at] = by,
                }
                problem.cost(&state.moved(&model, &steps, &border))
            };
            (cost(h) - cost(-h)) / (2.0 * h)
        };
        for node in 0..count {
            for at in 0..15 {
                let stated = band.border[node * band.wide + tile].0[at][column];
                let found = slope(Some(node), at);
                assert!((stated - found).abs() < 1e-9 * scale + 2e-5 * stated.abs(), "{node} {at}: {stated} {found}");
            }
        }
        for at in 0..model.constants() {
            let (stated, found) = (band.corner_at(at, model.constants()), slope(None, at));
            assert!((stated - found).abs() < 1e-9 * scale + 2e-5 * stated.abs(), "{at}: {stated} {found}");
        }
    }
}

#[test]
fn a_body_without_noise_is_found_exactly_and_its_cost_is_nearly_nothing() {
    let (body, mut model) = (body(3.0, false, 1), model());
    // What is known beforehand is right here.
    model.bones[0].length = Some([0.4, 0.03]);
    let moments = body.moments(&model);
    let start = body.start(&moments, &mut Random(2), 0.08);
    let problem = Problem::new(&model, &moments, &start);
    let end = minimise(&problem, start, &Descent::default(), &mut |_| true);
    assert_eq!(end.status, Status::Converged);
    assert!(end.trials.len() <= 12, "{}", end.trials.len());
    assert!(end.cost < 1.0, "{}", end.cost);
    for joint in [[0, 1], [1, 2]] {
        assert!(worst_deg(&body, &moments, &end.state, joint) < 0.3);
    }
    for (found, axis) in end.state.axes[1].iter().zip(&body.axes[1]) {
        assert!(found.cross(axis).norm() < 0.01);
    }
}

#[test]
fn a_noisy_body_is_found() {
    let (body, model) = (body(4.0, true, 7), model());
    let moments = body.moments(&model);
    let start = body.start(&moments, &mut Random(8), 0.05);
    let problem = Problem::new(&model, &moments, &start);
    let mut told = 0;
    let end = minimise(&problem, start, &Descent::default(), &mut |trial| {
        told += 1;
        trial.cost.is_finite()
    });
    assert_eq!((end.status, told), (Status::Converged, end.trials.len()));
    // Dynamics have no more residuals than unknowns; what is left are the joints, and those hold to rounding.
    assert!(end.cost < 10.0, "{}", end.cost);
    assert!(worst_deg(&body, &moments, &end.state, [1, 2]) < 1.0);
    assert!(end.trials.windows(2).all(|t| !t[0].taken || t[1].cost < t[0].cost));
}

#[test]
fn a_gap_leaves_two_stretches_that_share_the_body() {
    let (mut body, model) = (body(4.0, true, 9), model());
    let gone = 150..230;
    body.time.drain(gone.clone());
    for s in 0..3 {
        body.gyr[s].drain(gone.clone());
        body.acc[s].drain(gone.clone());
        body.truth[s].drain(gone.clone());
    }
    let moments = body.moments(&model);
    assert_eq!((0..moments.len()).filter(|&k| moments.begins(k)).count(), 2);
    let start = body.start(&moments, &mut Random(8), 0.05);
    let problem = Problem::new(&model, &moments, &start);
    let end = minimise(&problem, start, &Descent::default(), &mut |_| true);
    assert_eq!(end.status, Status::Converged);
    assert!(worst_deg(&body, &moments, &end.state, [1, 2]) < 1.5);
}

#[test]
fn skin_that_moves_with_the_knee_is_found() {
    let (body, mut model) = (body(6.0, false, 7), model());
    model.skins = vec![Skin { sensor: 2, turn_std: 0.1, shift_std: 0.05 }];
    let moments = body.moments(&model);
    let mut start = body.start(&moments, &mut Random(8), 0.05);
    // As if the shank's sensor had slid over the bone: its true place now shifts with an angle.
    let angle = |k: usize| (0.9 * k as f64).sin();
    start.skins = vec![[Vector3::zeros(); 2]];
    let found = |skins: bool| {
        let mut slid = body.moments(&model);
        let shift = Vector3::new(0.01, -0.02, 0.015);
        // A sensor that is displaced by `shift θ` sees the knee displaced by less than that: increments change by it.
        for k in 0..slid.len() - 1 {
            let (here, after) = (shift * angle(k), shift * angle(k + 1));
            let turn = body.truth[2][slid.moments[k + 1].sample].turn;
            let from = body.truth[2][slid.moments[k].sample].turn;
            if let Some(link) = &mut slid.links[k * 3 + 2] {
                link.pre.position -= from.tr_mul(&(turn * after)) - here;
            }
        }
        let mut model = model.clone();
        let mut start = start.clone();
        if !skins {
            model.skins.clear();
            start.skins.clear();
        }
        let mut problem = Problem::new(&model, &slid, &start);
        problem.drives.iter_mut().enumerate().for_each(|(k, drive)| *drive = angle(k));
        minimise(&problem, start, &Descent::default(), &mut |_| true)
    };
    let (with, without) = (found(true), found(false));
    assert!(with.cost < 0.2 * without.cost, "{} {}", with.cost, without.cost);
    let off = with.state.skins[0][1] - Vector3::new(0.01, -0.02, 0.015);
    assert!(off.norm() < 0.003, "{:?}", with.state.skins);
}

#[test]
fn ends_are_told_by_name() {
    let (body, model) = (body(1.5, true, 3), model());
    let moments = body.moments(&model);
    let start = body.start(&moments, &mut Random(8), 0.1);
    let problem = Problem::new(&model, &moments, &start);
    let run = |start: State, descent: Descent, go_on: bool| minimise(&problem, start, &descent, &mut |_| go_on).status;
    let once = Descent { max_iterations: 1, ..Descent::default() };
    assert_eq!(run(start.clone(), once, true), Status::MaxIterations);
    assert_eq!(run(start.clone(), Descent::default(), false), Status::Interrupted);
    let mut broken = start;
    broken.motions[4].velocity.x = f64::NAN;
    assert_eq!(run(broken, Descent::default(), true), Status::NumericalError);
}

#[test]
fn a_body_that_makes_no_sense_is_named() {
    assert_eq!(model().fault(), None);
    let mut loose = model();
    loose.joints.pop();
    assert_eq!(loose.fault(), Some("the joints must make a tree"));
    let mut strange = model();
    strange.angles[0].axis.joint = 0;
    assert_eq!(strange.fault(), Some("an angle names no hinge"));
    let mut bare = model();
    bare.skins = vec![Skin { sensor: 3, turn_std: 0.05, shift_std: 0.01 }];
    assert_eq!(bare.fault(), Some("a skin names no sensor"));
}

#[test]
fn the_step_is_that_of_the_dense_normal_equations() {
    let (body, model) = (body(0.55, true, 4), model());
    let moments = body.moments(&model);
    let start = body.start(&moments, &mut Random(6), 0.05);
    let problem = Problem::new(&model, &moments, &start);
    let (count, constants) = (moments.len(), model.constants());
    let mut band = Band::new(count, 3, constants);
    problem.begin(&start, 1e-2, &mut band);
    (0..count).for_each(|k| problem.node(k, &start, 1e-2, &mut band));
    let size = count * 3 * N;
    let mut h = DMatrix::zeros(size + constants, size + constants);
    let mut g = DVector::zeros(size + constants);
    let (tile, column) = band.gradient_place();
    for k in 0..count {
        for j in 0..3 {
            for a in 0..N {
                let row = (k * 3 + j) * N + a;
                g[row] = band.border[(k * 3 + j) * band.wide + tile].0[a][column];
                for c in 0..constants {
                    let v = band.border[(k * 3 + j) * band.wide + c / N].0[a][c % N];
                    (h[(row, size + c)], h[(size + c, row)]) = (v, v);
                }
                for i in 0..=j {
                    for b in 0..N {
                        let v = band.diagonal[k * 6 + j * (j + 1) / 2 + i].0[b][a];
                        let other = (k * 3 + i) * N + b;
                        (h[(other, row)], h[(row, other)]) = (v, v);
                    }
                }
                if band.linked[k] {
                    for b in 0..N {
                        let v = band.next[k * 3 + j].0[a][b];
                        let other = row - a + 3 * N + b;
                        (h[(row, other)], h[(other, row)]) = (v, v);
                    }
                }
            }
        }
    }
    for i in 0..constants {
        g[size + i] = band.corner_at(i, constants);
        for j in i..constants {
            (h[(size + i, size + j)], h[(size + j, size + i)]) = (band.corner_at(i, j), band.corner_at(i, j));
        }
    }
    let expected = -h.lu().solve(&g).expect("it can be solved");
    assert!(eliminated(&problem, &start, 1e-2, &mut band));
    let found = band.solve().expect("it can be solved");
    let scale = expected.amax();
    for k in 0..size {
        assert!((found.steps[k] - expected[k]).abs() < 1e-5 * scale, "{k}: {} {}", found.steps[k], expected[k]);
    }
    (0..constants).for_each(|k| assert!((found.border[k] - expected[size + k]).abs() < 1e-5 * scale));
}

#[test]
fn lengths_that_contradict_the_joints_do_not_keep_the_search_leaping() {
    let (body, mut model) = (body(4.0, true, 7), model());
    // The bone is 40 cm long; what is known beforehand says otherwise, more firmly than the joints do: the length bends, which
    // its square in the normal equations leaves out. Full steps alone take 12.
    model.bones[0].length = Some([0.6, 0.005]);
    model.bones[0].limits = None;
    model.joints.iter_mut().for_each(|joint| joint.center_std = [0.1; 3]);
    let moments = body.moments(&model);
    let start = body.start(&moments, &mut Random(8), 0.05);
    let problem = Problem::new(&model, &moments, &start);
    let end = minimise(&problem, start, &Descent::default(), &mut |_| true);
    assert_eq!(end.status, Status::Converged);
    assert!(end.trials.len() <= 9, "{}", end.trials.len());
    // A shortened step counts as its own cost says.
    assert!(end.trials.iter().filter(|t| t.taken).all(|t| t.tried < t.cost));
    // What the residuals cost is part of the whole.
    let (links, joints) = problem.squares(&end.state);
    let squares = links.iter().sum::<f64>() + joints.iter().flatten().sum::<f64>();
    assert!(0.5 * squares < end.cost && squares > 0.0);
    assert_eq!((links.len(), joints.len()), (moments.len() * 3, moments.len() * 2));
}
