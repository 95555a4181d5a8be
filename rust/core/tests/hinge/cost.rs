//! Residuals, derivatives and sums.

use imufast_core::hinge::{
    AxisPair, Weights,
    axes::{Tangent, stack},
    residual::{NormalEquations, acc_row, gyr_residual},
};
use nalgebra::{Matrix4, Matrix6, Vector3, Vector4, Vector6};

use crate::data::{Pairs, Random, any_samples, cost_of, delicate_axes, weighted_cost};

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
    let mut sums = NormalEquations { half_cost: 0.0, sum: 0.0, gradient: Vector4::zeros(), hessian: Matrix4::zeros() };
    for (_, a, b) in gyr {
        let (e, d) = gyr_residual(&Vector3::from(*a), &Vector3::from(*b), axes, tangent);
        sums.half_cost += 0.5 * e * e;
        sums.sum += e;
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
        assert!((fast.sum - plain.sum).abs() <= scale, "{count}");
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
    assert!((cost.acc_gram() - gram).amax() < 1e-12 * gram.trace());
    assert_eq!(cost.acc_count(), 131);
    for axes in delicate_axes(&mut random) {
        let tangent = axes.tangent();
        let normal = cost.acc_normal_equations(&axes, &tangent);
        let (mut half_cost, mut sum, mut gradient, mut hessian) = (0.0, 0.0, Vector4::zeros(), Matrix4::zeros());
        for (_, a, b) in &acc {
            let e = axes.j1.dot(&Vector3::from(*a)) - axes.j2.dot(&Vector3::from(*b));
            assert!((e - acc_row(a, b).dot(&stack(&axes))).abs() < 1e-13);
            let d = tangent.stacked().transpose() * acc_row(a, b);
            half_cost += 0.5 * e * e;
            sum += e;
            gradient += d * e;
            hessian += d * d.transpose();
        }
        let scale = 1e-12 * (half_cost + hessian.trace());
        assert!((normal.half_cost - half_cost).abs() < scale);
        assert!((normal.sum - sum).abs() < scale);
        assert!((cost.acc_squares(&axes) - 2.0 * half_cost).abs() < scale);
        assert_eq!(cost.acc_offset(&axes), 0.0);
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
fn costs_and_scores_of_all_pieces_sum_to_cost_and_gradient() {
    let mut random = Random(8);
    let (mut gyr, mut acc) = any_samples(&mut random, 333); // 6.66 s: seven pieces
    acc.drain(40..160); // other samples of the accelerometer: piece 1 and 2 have rates alone
    // Pieces are counted from the first sample of either kind, whatever the clock says.
    let begin = 1234.75;
    gyr.iter_mut().chain(&mut acc).for_each(|(t, _, _)| *t += begin);
    gyr.drain(..7);
    for (rate_scale, offset_prior) in [(f64::INFINITY, f64::INFINITY), (3.0, f64::INFINITY), (f64::INFINITY, 40.0), (3.0, 1.0)]
    {
        let weights = Weights { ratio: 50.0, rate_scale, offset_prior };
        let cost = weighted_cost(weights, &gyr, &acc);
        let axes = random.axes();
        let tangent = axes.tangent();
        let pieces = cost.pieces(&axes, &tangent);
        assert_eq!(pieces.iter().map(|p| p.number).collect::<Vec<_>>(), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let normal = cost.normal_equations(&axes, &tangent);
        let score: Vector4<f64> = pieces.iter().map(|p| p.score).sum();
        assert!((score - normal.gradient).amax() < 1e-12 * normal.hessian.trace());
        assert!((pieces.iter().map(|p| p.cost).sum::<f64>() - 2.0 * normal.half_cost).abs() < 1e-12 * normal.half_cost);
        if offset_prior.is_infinite() {
            // One piece alone is the cost over that piece alone.
            let within = begin + 3.0 - 1e-9..begin + 4.0 - 1e-9;
            let third = |pairs: &Pairs| -> Pairs { pairs.iter().filter(|(t, _, _)| within.contains(t)).copied().collect() };
            let (gyr, acc) = (third(&gyr), third(&acc));
            assert_eq!((gyr.len(), acc.len()), (50, 40));
            let alone = weighted_cost(weights, &gyr, &acc).normal_equations(&axes, &tangent);
            assert!((pieces[3].score - alone.gradient).amax() < 1e-12 * normal.hessian.trace());
            assert!((pieces[3].cost - 2.0 * alone.half_cost).abs() < 1e-12 * normal.half_cost);
        }
        let of_acc: Vec<f64> = cost.acc_pieces(&axes, &tangent).map(|p| p.number).collect();
        assert_eq!(of_acc, [0.0, 3.0, 4.0, 5.0, 6.0]);
    }
}

/// Minimum of a parabola through three of its points.
fn least_of_parabola(value: impl Fn(f64) -> f64) -> (f64, f64) {
    let (left, middle, right) = (value(-1.0), value(0.0), value(1.0));
    let (slope, curvature) = (0.5 * (right - left), right - 2.0 * middle + left);
    let at = -slope / curvature;
    (at, value(at))
}

#[test]
fn a_constant_difference_of_the_accelerations_is_the_best_one_under_its_prior() {
    let mut random = Random(21);
    let (gyr, mut acc) = any_samples(&mut random, 60);
    acc.iter_mut().for_each(|(_, a, _)| a.iter_mut().for_each(|x| *x += 3.0));
    let ratio = 7.0_f64;
    for offset_prior in [0.0, 0.5, 60.0, 1e4] {
        let cost = weighted_cost(Weights { offset_prior, ..Weights::published(ratio) }, &gyr, &acc);
        let rates_alone = cost_of(ratio, &gyr, &Pairs::new());
        // The literal cost, least over the constant: each constant pays as much as so many samples would charge for it.
        let literal = |axes: &AxisPair| {
            let residual = |(_, a, b): &(f64, [f64; 3], [f64; 3])| acc_row(a, b).dot(&stack(axes));
            let with = |by: f64| acc.iter().map(|row| (residual(row) - by).powi(2)).sum::<f64>() + offset_prior * by * by;
            least_of_parabola(with)
        };
        for axes in delicate_axes(&mut random) {
            let tangent = axes.tangent();
            let (offset, least) = literal(&axes);
            assert!((cost.acc_offset(&axes) - offset).abs() < 1e-9);
            let normal = cost.acc_normal_equations(&axes, &tangent);
            assert!((2.0 * normal.half_cost - least).abs() < 1e-11 * least, "{offset_prior}");
            let both = 2.0 * rates_alone.normal_equations(&axes, &tangent).half_cost + least / ratio;
            assert!((2.0 * cost.normal_equations(&axes, &tangent).half_cost - both).abs() < 1e-11 * both);
            // The gradient is that of the least, the Hessian its second derivative along the stacked axes.
            let h = 1e-5;
            for k in 0..4 {
                let mut step = Vector4::zeros();
                step[k] = h;
                let half = |step: &Vector4<f64>| 0.5 * literal(&axes.step(&tangent, step)).1;
                let slope = (half(&step) - half(&-step)) / (2.0 * h);
                assert!((normal.gradient[k] - slope).abs() < 1e-6 * least, "gradient {k} at {offset_prior}");
            }
            // What is published stays beside it: squares and sum without any constant.
            let published = cost_of(ratio, &gyr, &acc);
            assert!((cost.acc_squares(&axes) - published.acc_squares(&axes)).abs() < 1e-12 * least.max(1.0) * 60.0);
            assert!((normal.sum - published.acc_normal_equations(&axes, &tangent).sum).abs() < 1e-9);
        }
        let rows: Vec<Vector6<f64>> = acc.iter().map(|(_, a, b)| acc_row(a, b)).collect();
        let sum: Vector6<f64> = rows.iter().sum();
        let gram: Matrix6<f64> = rows.iter().map(|row| row * row.transpose()).sum();
        let left = gram - sum * sum.transpose() / (60.0 + offset_prior);
        assert!((cost.acc_gram() - left).amax() < 1e-12 * gram.trace());
    }
}

#[test]
fn an_infinite_prior_is_the_limit_of_a_large_one_and_what_is_published() {
    let mut random = Random(22);
    let (gyr, acc) = any_samples(&mut random, 50);
    let published = cost_of(50.0, &gyr, &acc);
    let strict = weighted_cost(Weights { offset_prior: 1e18, ..Weights::published(50.0) }, &gyr, &acc);
    assert_eq!(Weights::published(50.0).offset_prior, f64::INFINITY);
    assert!((published.acc_gram() - strict.acc_gram()).amax() < 1e-12 * published.acc_gram().trace());
    let axes = random.axes();
    let (_, free) = published.offset_sensitivity(&axes, &axes.tangent());
    let (_, held) = strict.offset_sensitivity(&axes, &axes.tangent());
    assert!((free - held).amax() < 1e-12 * free.norm());
}

#[test]
fn what_the_axes_leave_unexplained_is_a_share_of_the_plain_difference_of_the_rates() {
    let mut random = Random(23);
    let (gyr, acc) = any_samples(&mut random, 71);
    for rate_scale in [f64::INFINITY, 2.0] {
        let cost = weighted_cost(Weights { rate_scale, ..Weights::published(50.0) }, &gyr, &acc);
        let axes = random.axes();
        let (mut residual, mut plain) = (0.0, 0.0);
        for (_, a, b) in &gyr {
            let (a, b) = (Vector3::from(*a), Vector3::from(*b));
            let weight = if rate_scale.is_finite() { rate_scale / (rate_scale + a.norm() + b.norm()) } else { 1.0 };
            residual += (weight * literal_gyr_residual(&a, &b, &axes)).powi(2);
            plain += (weight * (a.norm() - b.norm())).powi(2);
        }
        assert!((cost.unexplained(&axes) - (residual / plain).sqrt()).abs() < 1e-12);
    }
    let still: Pairs = (0..30).map(|k| (f64::from(k), [0.0; 3], [0.0; 3])).collect();
    assert_eq!(cost_of(50.0, &still, &acc).unexplained(&random.axes()), f64::INFINITY);
}

#[test]
fn a_cost_knows_whether_it_will_be_a_number() {
    let mut random = Random(24);
    let (gyr, acc) = any_samples(&mut random, 40);
    assert!(cost_of(50.0, &gyr, &acc).is_finite());
    assert!(cost_of(50.0, &Pairs::new(), &Pairs::new()).is_finite());
    for bad in [f64::NAN, f64::INFINITY, 1e160] {
        for of_gyr in [true, false] {
            let (mut gyr, mut acc) = (gyr.clone(), acc.clone());
            if of_gyr {
                gyr[17].2[1] = bad
            } else {
                acc[17].2[1] = bad
            }
            assert!(!cost_of(50.0, &gyr, &acc).is_finite(), "{bad:e}, {of_gyr}");
        }
    }
}

#[test]
fn fast_samples_count_less_where_a_rate_scale_asks_for_it() {
    let mut random = Random(19);
    let (gyr, acc) = any_samples(&mut random, 77);
    let (scale, axes) = (2.5, random.axes());
    let tangent = axes.tangent();
    let sums = weighted_cost(Weights { rate_scale: scale, ..Weights::published(50.0) }, &gyr, &acc)
        .gyr_normal_equations(&axes, &tangent);
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
    for (rate_scale, offset_prior) in [(f64::INFINITY, f64::INFINITY), (3.0, f64::INFINITY), (3.0, 20.0), (3.0, 0.0)] {
        let weights = Weights { ratio, rate_scale, offset_prior };
        let (of_gyr, of_acc) = weighted_cost(weights, &gyr, &acc).offset_sensitivity(&axes, &tangent);
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
        // A constant that is estimated too takes up n of n + κ parts of what an offset does.
        let left = if offset_prior.is_finite() { offset_prior / (60.0 + offset_prior) } else { 1.0 };
        assert!((of_acc - tangent.stacked().transpose() * rows * left / ratio).amax() < 1e-12 * rows.norm());
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
