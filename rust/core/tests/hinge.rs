//! Algorithm 1 of Olsson et al. 2020 from outside the crate: derivatives against differences, sums against a plain loop,
//! and every way in which a descent can end.

use imufast_core::{
    Xyz,
    hinge::{
        AxisPair, Evidence, HingeCost, SolveOptions, Status, Weights,
        cost::{NormalEquations, Tangent, acc_row, gyr_residual, stack},
        deterministic_starts,
        evidence::{angular_deviation, tangent_covariance},
        solve::{same_axes, solve},
    },
    so3::angle_between,
};
use nalgebra::{Matrix2, Matrix4, Matrix6, Rotation3, Vector3, Vector4, Vector6};

/// Seeded numbers (splitmix64), so that a failure can be had again.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (core::f64::consts::TAU * self.uniform()).cos()
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal())
    }

    fn unit(&mut self) -> Vector3<f64> {
        self.vector().normalize()
    }

    fn axes(&mut self) -> AxisPair {
        AxisPair::new(self.unit(), self.unit())
    }
}

/// Pairs of axes where formulas break: random ones, the poles, a hair beside them, the coordinate axes.
fn delicate_axes(random: &mut Random) -> Vec<AxisPair> {
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

type Pairs = Vec<(f64, Xyz, Xyz)>;

/// What two sensors on a hinge read at rest in between: rates that satisfy eq. 14 and accelerations that satisfy eq. 18.
fn hinge_samples(random: &mut Random, axes: &AxisPair, count: usize, noise: f64) -> (Pairs, Pairs) {
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
fn any_samples(random: &mut Random, count: usize) -> (Pairs, Pairs) {
    let pairs = |scale: f64, random: &mut Random| -> Pairs {
        (0..count).map(|k| (k as f64 * 0.02, (scale * random.vector()).into(), (scale * random.vector()).into())).collect()
    };
    (pairs(2.0, random), pairs(9.0, random))
}

fn cost_of(weight_ratio: f64, gyr: &Pairs, acc: &Pairs) -> HingeCost {
    weighted_cost(Weights { ratio: weight_ratio, rate_scale: f64::INFINITY }, gyr, acc)
}

fn weighted_cost(weights: Weights, gyr: &Pairs, acc: &Pairs) -> HingeCost {
    HingeCost::new(weights, gyr.iter().map(|(t, a, b)| (*t, a, b)), acc.iter().map(|(t, a, b)| (*t, a, b)))
}

/// The largest error of a Jacobian over all components, by central differences along the tangent planes.
fn jacobian_error(axes: &AxisPair, residual: impl Fn(&AxisPair) -> f64, jacobian: &Vector4<f64>, step: f64) -> f64 {
    let tangent = axes.tangent();
    let mut worst = 0.0_f64;
    for k in 0..4 {
        let mut move_by = Vector4::zeros();
        move_by[k] = step;
        let difference = residual(&axes.step(&tangent, &move_by)) - residual(&axes.step(&tangent, &-move_by));
        worst = worst.max((difference / (2.0 * step) - jacobian[k]).abs());
    }
    worst
}

/// Eq. 24 as printed, unweighted.
fn literal_gyr_residual(gyr1: &Vector3<f64>, gyr2: &Vector3<f64>, axes: &AxisPair) -> f64 {
    gyr1.cross(&axes.j1).norm() - gyr2.cross(&axes.j2).norm()
}

#[test]
fn residual_and_jacobian_agree_with_the_printed_residual_and_its_differences() {
    let mut random = Random(1);
    for axes in delicate_axes(&mut random) {
        for _ in 0..10 {
            let (gyr1, gyr2) = (3.0 * random.vector(), 3.0 * random.vector());
            let (value, jacobian) = gyr_residual(&gyr1, &gyr2, &axes, &axes.tangent());
            assert!((value - literal_gyr_residual(&gyr1, &gyr2, &axes)).abs() < 1e-13);
            // Truncation grows where a rate comes close to its axis: its curvature is |ω|²/‖ω×j‖.
            let sharp = gyr1.cross(&axes.j1).norm().min(gyr2.cross(&axes.j2).norm());
            let error = jacobian_error(&axes, |at| literal_gyr_residual(&gyr1, &gyr2, at), &jacobian, 1e-5 * sharp.min(1.0));
            assert!(error < 1e-6 / sharp.min(1.0), "{error} at {axes:?}");
        }
    }
}

#[test]
fn jacobian_holds_where_the_rate_is_nearly_parallel_to_the_axis() {
    let mut random = Random(2);
    for axes in delicate_axes(&mut random) {
        for beside in [1e-2, 1e-4, 1e-6] {
            let gyr1 = 3.0 * (axes.j1 + beside * axes.tangent().b1 * nalgebra::Vector2::new(0.6, 0.8));
            let gyr2 = -2.0 * (axes.j2 + beside * axes.tangent().b2 * nalgebra::Vector2::new(-0.8, 0.6));
            let (_, jacobian) = gyr_residual(&gyr1, &gyr2, &axes, &axes.tangent());
            // Steps well within the cone; the residual itself is of the size of `beside`, so is its rounding.
            let error = jacobian_error(&axes, |at| literal_gyr_residual(&gyr1, &gyr2, at), &jacobian, 1e-3 * beside);
            assert!(error < 1e-4, "{error} at {axes:?}, {beside} beside the axis");
        }
    }
}

#[test]
fn the_difference_check_catches_each_wrong_component() {
    let mut random = Random(3);
    let axes = random.axes();
    let (gyr1, gyr2) = (3.0 * random.vector(), 3.0 * random.vector());
    let (_, jacobian) = gyr_residual(&gyr1, &gyr2, &axes, &axes.tangent());
    let residual = |at: &AxisPair| literal_gyr_residual(&gyr1, &gyr2, at);
    assert!(jacobian_error(&axes, residual, &jacobian, 1e-5) < 1e-6);
    for k in 0..4 {
        let mut wrong_sign = jacobian;
        wrong_sign[k] = -wrong_sign[k];
        assert!(jacobian_error(&axes, residual, &wrong_sign, 1e-5) > 1e-2);
        let mut slightly_off = jacobian;
        slightly_off[k] *= 1.001;
        assert!(jacobian_error(&axes, residual, &slightly_off, 1e-5) > 1e-5);
    }
}

#[test]
fn gradient_and_hessian_of_the_cost_agree_with_differences_in_every_component() {
    let mut random = Random(4);
    let (gyr, acc) = any_samples(&mut random, 45);
    let weight_ratio = 7.0_f64;
    let cost = cost_of(weight_ratio, &gyr, &acc);
    let (wg, wa) = (weight_ratio.sqrt(), weight_ratio.sqrt().recip());
    for axes in delicate_axes(&mut random) {
        let tangent = axes.tangent();
        let normal = cost.normal_equations(&axes, &tangent);
        // The residuals of eqs 24 and 25, and their Jacobian by central differences.
        let residuals = |at: &AxisPair| -> Vec<f64> {
            let rates = gyr.iter().map(|(_, a, b)| wg * literal_gyr_residual(&Vector3::from(*a), &Vector3::from(*b), at));
            let forces = acc.iter().map(|(_, a, b)| wa * (at.j1.dot(&Vector3::from(*a)) - at.j2.dot(&Vector3::from(*b))));
            rates.chain(forces).collect()
        };
        let here = residuals(&axes);
        let half_cost = 0.5 * here.iter().map(|e| e * e).sum::<f64>();
        assert!((normal.half_cost - half_cost).abs() < 1e-12 * half_cost);
        let h = 1e-6;
        let columns: [Vec<f64>; 4] = core::array::from_fn(|k| {
            let mut step = Vector4::zeros();
            step[k] = h;
            let (plus, minus) = (residuals(&axes.step(&tangent, &step)), residuals(&axes.step(&tangent, &-step)));
            plus.iter().zip(&minus).map(|(p, m)| (p - m) / (2.0 * h)).collect()
        });
        let scale = normal.hessian.trace();
        for a in 0..4 {
            let gradient: f64 = columns[a].iter().zip(&here).map(|(d, e)| d * e).sum();
            assert!((normal.gradient[a] - gradient).abs() < 1e-7 * scale, "gradient {a}");
            for b in 0..4 {
                let hessian: f64 = columns[a].iter().zip(&columns[b]).map(|(x, y)| x * y).sum();
                assert!((normal.hessian[(a, b)] - hessian).abs() < 1e-7 * scale, "hessian {a} {b}");
                assert!((normal.hessian[(a, b)] - normal.hessian[(b, a)]).abs() < 1e-14 * scale, "symmetry {a} {b}");
            }
        }
    }
}

fn plain_sums(gyr: &Pairs, axes: &AxisPair, tangent: &Tangent) -> NormalEquations {
    let mut sums = NormalEquations { half_cost: 0.0, gradient: Vector4::zeros(), hessian: Matrix4::zeros() };
    for (_, a, b) in gyr {
        let (e, d) = gyr_residual(&Vector3::from(*a), &Vector3::from(*b), axes, tangent);
        sums.half_cost += 0.5 * e * e;
        sums.gradient += d * e;
        sums.hessian += d * d.transpose();
    }
    sums
}

#[test]
fn sums_in_chunks_equal_a_plain_loop_for_every_count() {
    let mut random = Random(5);
    let (gyr, _) = any_samples(&mut random, 70);
    for count in 0..=70 {
        let some = gyr[..count].to_vec();
        let cost = cost_of(50.0, &some, &Pairs::new());
        assert_eq!((cost.gyr_count(), cost.acc_count()), (count, 0));
        let axes = random.axes();
        let tangent = axes.tangent();
        let (fast, plain) = (cost.gyr_normal_equations(&axes, &tangent), plain_sums(&some, &axes, &tangent));
        let scale = 1e-14 * (1.0 + plain.half_cost + plain.hessian.trace());
        assert!((fast.half_cost - plain.half_cost).abs() <= scale, "{count}");
        assert!((fast.gradient - plain.gradient).amax() <= scale, "{count}");
        assert!((fast.hessian - plain.hessian).amax() <= scale, "{count}");
    }
}

#[test]
fn the_gram_form_equals_the_sum_over_samples() {
    let mut random = Random(6);
    let (_, acc) = any_samples(&mut random, 131);
    let cost = cost_of(50.0, &Pairs::new(), &acc);
    let gram: Matrix6<f64> = acc.iter().map(|(_, a, b)| acc_row(a, b) * acc_row(a, b).transpose()).sum();
    let sum: Vector6<f64> = acc.iter().map(|(_, a, b)| acc_row(a, b)).sum();
    assert!((cost.acc_gram() - gram).amax() < 1e-12 * gram.trace());
    assert!((cost.acc_sum() - sum).amax() < 1e-12 * gram.trace());
    for axes in delicate_axes(&mut random) {
        let tangent = axes.tangent();
        let normal = cost.acc_normal_equations(&axes, &tangent);
        let (mut half_cost, mut gradient, mut hessian) = (0.0, Vector4::zeros(), Matrix4::zeros());
        for (_, a, b) in &acc {
            let e = axes.j1.dot(&Vector3::from(*a)) - axes.j2.dot(&Vector3::from(*b));
            assert!((e - acc_row(a, b).dot(&stack(&axes))).abs() < 1e-13);
            let d = tangent.stacked().transpose() * acc_row(a, b);
            half_cost += 0.5 * e * e;
            gradient += d * e;
            hessian += d * d.transpose();
        }
        let scale = 1e-12 * (half_cost + hessian.trace());
        assert!((normal.half_cost - half_cost).abs() < scale);
        assert!((normal.gradient - gradient).amax() < scale);
        assert!((normal.hessian - hessian).amax() < scale);
    }
}

#[test]
fn a_rate_along_its_axis_has_a_zero_block_and_leaves_the_rest() {
    // Corrected eq. 37: the norm has no gradient there; residual and the other sensor's block stay.
    let axes = AxisPair::new(Vector3::z(), Vector3::x());
    let tangent = axes.tangent();
    let other = Vector3::new(0.3, -0.5, 0.7);
    let (value, jacobian) = gyr_residual(&(4.0 * Vector3::z()), &other, &axes, &tangent);
    assert_eq!(value, -other.cross(&axes.j2).norm());
    assert_eq!((jacobian[0], jacobian[1]), (0.0, 0.0));
    assert!(jacobian.fixed_rows::<2>(2).norm() > 0.1);
    let (value, jacobian) = gyr_residual(&other, &(-4.0 * Vector3::x()), &axes, &tangent);
    assert_eq!(value, other.cross(&axes.j1).norm());
    assert_eq!((jacobian[2], jacobian[3]), (0.0, 0.0));
    let (value, jacobian) = gyr_residual(&Vector3::zeros(), &Vector3::zeros(), &axes, &tangent);
    assert_eq!((value, jacobian), (0.0, Vector4::zeros()));
    // The chunked sums take the same side at the same place.
    let gyr = vec![(0.0, [0.0, 0.0, 4.0], other.into()), (0.02, [0.0, 0.0, -2.0], [5.0, 0.0, 0.0])];
    let sums = cost_of(50.0, &gyr, &Pairs::new()).gyr_normal_equations(&axes, &tangent);
    let plain = plain_sums(&gyr, &axes, &tangent);
    assert!((sums.hessian - plain.hessian).amax() < 1e-15 && (sums.gradient - plain.gradient).amax() < 1e-15);
    assert!(sums.hessian.fixed_view::<2, 4>(0, 0).iter().all(|h| *h == 0.0));
}

#[test]
fn the_same_data_give_the_same_bits_again() {
    let mut random = Random(7);
    let truth = random.axes();
    let (gyr, acc) = hinge_samples(&mut random, &truth, 777, 0.02);
    let run = || {
        let cost = cost_of(50.0, &gyr, &acc);
        let solution = solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || true);
        let evidence = Evidence::at(&solution.best().axes, &cost);
        let mut bits: Vec<u64> = stack(&solution.best().axes).iter().map(|x| x.to_bits()).collect();
        bits.push(solution.best().cost.to_bits());
        bits.extend(evidence.covariance.iter().chain(evidence.published_covariance.iter()).map(|x| x.to_bits()));
        (bits, solution.iterations)
    };
    let first = run();
    assert!((0..5).all(|_| run() == first));
}

#[test]
fn costs_and_scores_of_all_pieces_sum_to_cost_and_gradient() {
    let mut random = Random(8);
    let (gyr, mut acc) = any_samples(&mut random, 333); // 6.66 s: seven pieces
    acc.drain(40..160); // other samples of the accelerometer: piece 1 and 2 have rates alone
    for rate_scale in [f64::INFINITY, 3.0] {
        let weights = Weights { ratio: 50.0, rate_scale };
        let cost = weighted_cost(weights, &gyr, &acc);
        let axes = random.axes();
        let tangent = axes.tangent();
        let pieces = cost.pieces(&axes, &tangent);
        assert_eq!(pieces.iter().map(|p| p.number).collect::<Vec<_>>(), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let normal = cost.normal_equations(&axes, &tangent);
        let score: Vector4<f64> = pieces.iter().map(|p| p.score).sum();
        assert!((score - normal.gradient).amax() < 1e-12 * normal.hessian.trace());
        assert!((pieces.iter().map(|p| p.cost).sum::<f64>() - 2.0 * normal.half_cost).abs() < 1e-12 * normal.half_cost);
        // One piece alone is the cost over that piece alone.
        let third = |pairs: &Pairs| -> Pairs { pairs.iter().filter(|(t, _, _)| (3.0..4.0).contains(t)).copied().collect() };
        let alone = weighted_cost(weights, &third(&gyr), &third(&acc)).normal_equations(&axes, &tangent);
        assert!((pieces[3].score - alone.gradient).amax() < 1e-12 * normal.hessian.trace());
        assert!((pieces[3].cost - 2.0 * alone.half_cost).abs() < 1e-12 * normal.half_cost);
    }
}

#[test]
fn fast_samples_count_less_where_a_rate_scale_asks_for_it() {
    let mut random = Random(19);
    let (gyr, acc) = any_samples(&mut random, 77);
    let (scale, axes) = (2.5, random.axes());
    let tangent = axes.tangent();
    let sums = weighted_cost(Weights { ratio: 50.0, rate_scale: scale }, &gyr, &acc).gyr_normal_equations(&axes, &tangent);
    let (mut half_cost, mut gradient, mut hessian) = (0.0, Vector4::zeros(), Matrix4::zeros());
    for (_, a, b) in &gyr {
        let (a, b) = (Vector3::from(*a), Vector3::from(*b));
        let weight = scale / (scale + a.norm() + b.norm());
        let (e, d) = gyr_residual(&a, &b, &axes, &tangent);
        half_cost += 0.5 * weight * weight * e * e;
        gradient += d * e * weight * weight;
        hessian += d * d.transpose() * weight * weight;
    }
    let limit = 1e-13 * (half_cost + hessian.trace());
    assert!((sums.half_cost - half_cost).abs() < limit && (sums.gradient - gradient).amax() < limit);
    assert!((sums.hessian - hessian).amax() < limit);
}

#[test]
fn offsets_move_the_gradient_as_the_sensitivity_says() {
    // Gauss-Newton's part: the Jacobian held, the residuals moved by a constant offset of each channel.
    let mut random = Random(20);
    let (gyr, acc) = any_samples(&mut random, 60);
    let (ratio, axes) = (50.0, random.axes());
    let tangent = axes.tangent();
    for rate_scale in [f64::INFINITY, 3.0] {
        let (of_gyr, of_acc) = weighted_cost(Weights { ratio, rate_scale }, &gyr, &acc).offset_sensitivity(&axes, &tangent);
        let h = 1e-6;
        for channel in 0..6 {
            let mut expected = Vector4::zeros();
            for (_, a, b) in &gyr {
                let (a, b) = (Vector3::from(*a), Vector3::from(*b));
                let weight = if rate_scale.is_finite() { rate_scale / (rate_scale + a.norm() + b.norm()) } else { 1.0 };
                let moved = |by: f64| {
                    let (mut a, mut b) = (a, b);
                    if channel < 3 {
                        a[channel] += by
                    } else {
                        b[channel - 3] += by
                    }
                    literal_gyr_residual(&a, &b, &axes)
                };
                let slope = (moved(h) - moved(-h)) / (2.0 * h);
                expected += gyr_residual(&a, &b, &axes, &tangent).1 * (weight * weight * ratio * slope);
            }
            assert!((of_gyr.column(channel) - expected).amax() < 1e-6 * expected.norm().max(1.0), "{channel}");
        }
        let rows: Vector6<f64> = acc.iter().map(|(_, a, b)| acc_row(a, b)).sum();
        assert!((of_acc - tangent.stacked().transpose() * rows / ratio).amax() < 1e-12 * rows.norm());
    }
}

#[test]
fn a_thinned_cost_is_the_cost_of_every_nth_sample() {
    let mut random = Random(9);
    let (gyr, acc) = any_samples(&mut random, 1003);
    let cost = cost_of(50.0, &gyr, &acc);
    let axes = random.axes();
    let tangent = axes.tangent();
    for (count, stride) in [(1003, 1), (2000, 1), (502, 1), (501, 2), (100, 10), (1, 1003), (0, 1003)] {
        let thin = cost.thinned(count);
        let expected: Pairs = gyr.iter().step_by(stride).copied().collect();
        assert_eq!(thin.gyr_count(), expected.len(), "about {count}");
        let (sums, plain) = (thin.gyr_normal_equations(&axes, &tangent), plain_sums(&expected, &axes, &tangent));
        assert!((sums.half_cost - plain.half_cost).abs() < 1e-12 * plain.half_cost);
        assert!((thin.acc_gram() * stride as f64 - cost.acc_gram()).amax() < 1e-12 * cost.acc_gram().trace());
    }
}

#[test]
fn the_axes_of_an_exact_hinge_are_found_to_rounding_with_their_sign_pair() {
    let mut random = Random(10);
    for truth in delicate_axes(&mut random) {
        let (gyr, acc) = hinge_samples(&mut random, &truth, 200, 0.0);
        let cost = cost_of(50.0, &gyr, &acc);
        let solution = solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || true);
        let best = solution.best();
        assert_eq!(best.status, Status::Converged);
        assert!(same_axes(&best.axes, &truth, 1e-9), "{truth:?} gave {:?}", best.axes);
        assert!(best.axes == best.axes.canonical());
        assert!(solution.minima.windows(2).all(|pair| pair[0].cost <= pair[1].cost));
    }
}

#[test]
fn random_starts_end_in_the_same_minimum() {
    let mut random = Random(11);
    let truth = random.axes();
    let (gyr, acc) = hinge_samples(&mut random, &truth, 600, 0.05);
    let cost = cost_of(50.0, &gyr, &acc);
    let options = SolveOptions { coarse_first: false, ..SolveOptions::default() };
    let starts: Vec<AxisPair> = (0..50).map(|_| random.axes()).collect();
    let (many, few) = (
        solve(&cost, &starts, &options, &mut || true),
        solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || true),
    );
    assert!(few.best().cost <= many.best().cost * (1.0 + 1e-9));
    assert!(same_axes(&few.best().axes, &many.best().axes, 1e-6));
}

#[test]
fn one_start_with_its_sign_pair_is_algorithm_1() {
    let mut random = Random(12);
    let truth = random.axes();
    let (gyr, acc) = hinge_samples(&mut random, &truth, 400, 0.01);
    let cost = cost_of(50.0, &gyr, &acc);
    let options = SolveOptions { coarse_first: false, ..SolveOptions::default() };
    let wrong_sign = AxisPair::new(truth.j1, -truth.j2);
    let solution = solve(&cost, &[wrong_sign], &options, &mut || true);
    assert!(same_axes(&solution.best().axes, &truth, 0.01));
    assert!(solution.minima.len() <= 2);
}

#[test]
fn data_without_any_motion_or_force_are_not_identifiable() {
    let zeros: Pairs = (0..300).map(|k| (k as f64 * 0.02, [0.0; 3], [0.0; 3])).collect();
    let cost = cost_of(50.0, &zeros, &zeros);
    let solution = solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || true);
    assert_eq!(solution.best().status, Status::NotIdentifiable);
    let evidence = Evidence::at(&solution.best().axes, &cost);
    assert!(evidence.covariance.iter().all(|p| !p.is_nan()));
    assert!(evidence.covariance.trace().is_infinite() && evidence.published_covariance.trace().is_infinite());
    let nothing = cost_of(50.0, &Pairs::new(), &Pairs::new());
    assert_eq!(solve(&nothing, &[], &SolveOptions::default(), &mut || true).best().status, Status::NotIdentifiable);
}

#[test]
fn data_that_overflow_are_a_numerical_error_and_end() {
    for size in [1e160, 1e200, 1e300] {
        for (gyr_size, acc_size) in [(size, 1.0), (1.0, size), (size, size)] {
            let mut random = Random(13);
            let (mut gyr, mut acc) = any_samples(&mut random, 60);
            gyr.iter_mut().for_each(|(_, a, b)| a.iter_mut().chain(b).for_each(|x| *x *= gyr_size));
            acc.iter_mut().for_each(|(_, a, b)| a.iter_mut().chain(b).for_each(|x| *x *= acc_size));
            let cost = cost_of(50.0, &gyr, &acc);
            let starts: Vec<AxisPair> = (0..4).map(|_| random.axes()).collect();
            let solution = solve(&cost, &starts, &SolveOptions::default(), &mut || true);
            assert_eq!(solution.best().status, Status::NumericalError, "gyr {gyr_size:e}, acc {acc_size:e}");
        }
    }
}

#[test]
fn deterministic_starts_are_unit_vectors_whatever_the_data() {
    let mut random = Random(14);
    for size in [0.0, 1e-300, 1e-160, 1.0, 1e150] {
        assert_unit_starts(size, &mut random);
    }
}

#[test]
#[ignore = "bug: starts of NaN where the sums overflow"]
fn deterministic_starts_are_unit_vectors_even_where_sums_overflow() {
    for size in [1e155, 1e200, 1e300] {
        assert_unit_starts(size, &mut Random(14));
    }
}

#[test]
#[ignore = "bug: lengths that overflow when squared give a zero axis, lengths of NaN an axis of NaN"]
fn a_pair_has_unit_axes_whatever_it_is_made_of() {
    for x in [0.0, 1e-320, 1e-200, 1e200, f64::MAX, f64::NAN, f64::INFINITY] {
        let pair = AxisPair::new(Vector3::new(x, 0.0, 0.0), Vector3::new(0.0, x, x));
        assert!((pair.j1.norm() - 1.0).abs() < 1e-12 && (pair.j2.norm() - 1.0).abs() < 1e-12, "{x:e}: {pair:?}");
    }
}

fn assert_unit_starts(size: f64, random: &mut Random) {
    {
        let (mut gyr, mut acc) = any_samples(random, 40);
        let all = gyr.iter_mut().chain(acc.iter_mut());
        all.for_each(|(_, a, b)| a.iter_mut().chain(b).for_each(|x| *x *= size));
        for start in deterministic_starts(&cost_of(50.0, &gyr, &acc)) {
            assert!((start.j1.norm() - 1.0).abs() < 1e-12 && (start.j2.norm() - 1.0).abs() < 1e-12, "{size:e}: {start:?}");
        }
    }
}

#[test]
fn a_caller_who_says_stop_is_obeyed() {
    let mut random = Random(15);
    let truth = random.axes();
    let (gyr, acc) = hinge_samples(&mut random, &truth, 300, 0.05);
    let cost = cost_of(50.0, &gyr, &acc);
    for allowed in 0..5 {
        let mut asked = 0;
        let solution = solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || {
            asked += 1;
            asked <= allowed
        });
        assert_eq!(solution.best().status, Status::Interrupted, "after {allowed} iterations");
        assert!(asked <= allowed + 2, "asked {asked} times, {allowed} allowed");
    }
}

/// A caller who can say no only once, as a pending Ctrl-C does: asking clears it.
fn interrupted_once(count: usize, allowed: usize) -> (Status, usize) {
    let mut random = Random(15);
    let truth = random.axes();
    let (gyr, acc) = hinge_samples(&mut random, &truth, count, 0.05);
    let cost = cost_of(50.0, &gyr, &acc);
    let mut asked = 0;
    let solution = solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || {
        asked += 1;
        asked != allowed + 1
    });
    (solution.best().status, asked)
}

#[test]
#[ignore = "bug: after a no the other sign pair is still walked to its end"]
fn one_no_is_enough_on_few_samples() {
    for allowed in 0..5 {
        assert_eq!(interrupted_once(300, allowed), (Status::Interrupted, allowed + 1));
    }
}

#[test]
#[ignore = "bug: a no during the coarse walk is forgotten, the solution comes back as converged"]
fn one_no_is_enough_on_many_samples() {
    for allowed in 0..5 {
        assert_eq!(interrupted_once(2000, allowed), (Status::Interrupted, allowed + 1));
    }
}

#[test]
fn iterations_that_run_out_are_reported() {
    let mut random = Random(16);
    let truth = random.axes();
    let (gyr, acc) = hinge_samples(&mut random, &truth, 300, 0.05);
    let cost = cost_of(50.0, &gyr, &acc);
    let options = SolveOptions { max_iterations: 1, coarse_first: false, ..SolveOptions::default() };
    let solution = solve(&cost, &[random.axes()], &options, &mut || true);
    assert!(solution.minima.iter().all(|m| m.status == Status::MaxIterations && m.iterations == 1));
}

#[test]
fn covariance_is_tangent_to_the_axes_and_the_deviation_is_its_moment() {
    let mut random = Random(17);
    for truth in delicate_axes(&mut random) {
        let (gyr, acc) = hinge_samples(&mut random, &truth, 500, 0.05);
        let cost = cost_of(50.0, &gyr, &acc);
        let best = solve(&cost, &deterministic_starts(&cost), &SolveOptions::default(), &mut || true).best().axes;
        let evidence = Evidence::at(&best, &cost);
        for p in [&evidence.covariance, &evidence.published_covariance] {
            assert!((p - p.transpose()).amax() <= 1e-12 * p.trace());
            assert!(p.symmetric_eigenvalues().min() > -1e-12 * p.trace());
            let along1 = Vector6::new(best.j1.x, best.j1.y, best.j1.z, 0.0, 0.0, 0.0);
            let along2 = Vector6::new(0.0, 0.0, 0.0, best.j2.x, best.j2.y, best.j2.z);
            assert!((p * along1).norm() < 1e-12 * p.trace() && (p * along2).norm() < 1e-12 * p.trace());
            for part in tangent_covariance(p, &best.tangent()) {
                let (mean, std) = angular_deviation(&part);
                assert!((mean * mean + std * std - part.trace()).abs() < 1e-12 * part.trace());
            }
        }
        assert!(angle_between(&best.j1, &truth.j1).sin() < 0.02);
    }
}

#[test]
fn the_closed_form_of_the_angular_deviation_agrees_with_drawing_it() {
    // Eqs 62-65 by Monte Carlo; 200 000 draws, so means are good to about 0.3 %.
    let mut random = Random(18);
    for (a, b) in [(1.0_f64, 1.0_f64), (1.0, 0.3), (1.0, 0.01), (1.0, 0.0), (0.2, 0.7)] {
        let turn = nalgebra::Rotation2::new(random.uniform() * 6.0);
        let root = turn.matrix() * Matrix2::new(a.sqrt(), 0.0, 0.0, b.sqrt());
        let draws = 200_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..draws {
            let length = (root * nalgebra::Vector2::new(random.normal(), random.normal())).norm();
            sum += length;
            squares += length * length;
        }
        let drawn_mean = sum / f64::from(draws);
        let drawn_std = (squares / f64::from(draws) - drawn_mean * drawn_mean).sqrt();
        let (mean, std) = angular_deviation(&(root * root.transpose()));
        assert!((mean - drawn_mean).abs() < 0.01 * mean && (std - drawn_std).abs() < 0.01 * std, "{a} {b}");
    }
}
