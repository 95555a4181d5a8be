//! Exact motion gives its truth back under every loss, and a descent that is stopped says so.

use imufast_core::joint_center::{
    Unknowns,
    estimate::{Request, estimate},
    ls,
    moments::Moments,
    residual::residual,
    solve::{Knowledge, Method, Status},
};
use imufast_core::rigid_body::Moment;
use nalgebra::UnitQuaternion;

use crate::data::{BallJoint, scattered, truth};

const METHODS: [Method; 3] = [Method::Squares, Method::Huber, Method::Absolute];

fn request(method: Method, knowledge: Knowledge) -> Request {
    Request { method, knowledge, axis: None, undetermined_std: 0.02, minimum_norm: true, max_iterations: 200 }
}

fn known() -> Knowledge {
    Knowledge { bias_std: 0.3, lever_std: 1.0, correlated: 1.0, gyr_bias_std: 0.0 }
}

#[test]
fn exact_moments_give_levers_and_biases_back() {
    let moments = BallJoint::new(1, 1.0, 0.0).moments(400);
    let worst = (0..moments.len()).map(|k| residual(&moments.at(k), &truth()).0.abs()).fold(0.0, f64::max);
    assert!(worst < 1e-7, "the example is exact: {worst}");
    for method in METHODS {
        let found = estimate(&moments, &request(method, known()), &mut || true);
        assert_eq!(found.solution.status, Status::Converged, "{method:?}");
        assert!(found.open.is_empty() && found.open_bias.is_empty(), "{method:?}");
        let error = found.solution.x - truth();
        assert!(error.fixed_rows::<6>(0).norm() < 1e-5, "{method:?}: {error}");
        assert!(error.fixed_rows::<6>(6).norm() < 1e-4, "{method:?}: {error}");
        assert!(found.evidence.unexplained < 1e-3);
    }
}

#[test]
fn noise_leaves_the_truth_within_a_few_standard_deviations() {
    let moments = BallJoint::new(2, 1.0, 0.05).moments(1000);
    for method in METHODS {
        let found = estimate(&moments, &request(method, known()), &mut || true);
        let error = found.solution.x - truth();
        for k in 0..12 {
            let std = found.evidence.covariance[(k, k)].sqrt();
            assert!(error[k].abs() < 4.5 * std, "{method:?}, unknown {k}: {} of {std}", error[k]);
            assert!(std < if k < 6 { 0.005 } else { 0.05 }, "{method:?}, unknown {k}: {std}");
        }
    }
}

#[test]
fn the_cost_is_that_of_the_residuals_at_the_solution_alone() {
    let moments = BallJoint::new(3, 1.0, 0.3).moments(700);
    for (method, knowledge) in METHODS.into_iter().flat_map(|m| [(m, known()), (m, Knowledge::PUBLISHED)]) {
        let found = estimate(&moments, &request(method, knowledge), &mut || true);
        let residuals: Vec<f64> = (0..moments.len()).map(|k| residual(&moments.at(k), &found.solution.x).0).collect();
        let expected = match method {
            Method::Squares => residuals.iter().map(|e| e * e).sum::<f64>(),
            Method::Huber => residuals.iter().map(|e| 2.0 * found.solution.loss.of(*e).0).sum(),
            Method::Absolute => residuals.iter().map(|e| e.abs()).sum(),
        };
        assert!((found.solution.cost / expected - 1.0).abs() < 1e-10, "{method:?}");
    }
}

#[test]
fn a_descent_that_runs_out_or_is_stopped_says_so() {
    let moments = scattered(4, 3000);
    for method in METHODS {
        let few = Request { max_iterations: 1, ..request(method, known()) };
        let found = estimate(&moments, &few, &mut || true);
        assert_eq!(found.solution.status, Status::MaxIterations, "{method:?}");
        for patience in [0, 1, 3] {
            let mut asked = 0;
            let found = estimate(&moments, &request(method, known()), &mut || {
                asked += 1;
                asked <= patience
            });
            assert_eq!(found.solution.status, Status::Interrupted, "{method:?}");
            assert!(asked <= patience + 3, "{method:?}: asked {asked} times, patience {patience}");
        }
    }
}

#[test]
fn absurd_numbers_give_a_status_and_no_panic() {
    for size in [1e-300, 1e-160, 1e-20, 1e20, 1e100, 1e150, 1e160, 1e300] {
        let mut moments = Moments::default();
        let plain = scattered(5, 100);
        for k in 0..plain.len() {
            let [one, two] = plain.at(k);
            let mut sample = [0.0; 12];
            for c in 0..3 {
                (sample[c], sample[3 + c]) = (one.gyr[c] * size, one.a[c] * size);
                (sample[6 + c], sample[9 + c]) = (two.gyr[c] * size, two.a[c] * size);
            }
            let (gyr_dot1, gyr_dot2) = ((one.gyr * -size).into(), (two.gyr * size).into());
            moments.push(&Moment { time_s: k as f64, sample, gyr_dot1, gyr_dot2 });
        }
        for knowledge in [known(), Knowledge::PUBLISHED] {
            for method in METHODS {
                let found = estimate(&moments, &request(method, knowledge), &mut || true);
                let finite = found.solution.x.iter().all(|v| v.is_finite());
                assert!(finite, "{method:?} at {size:e}: {}", found.solution.x);
            }
            if size > 1e50 {
                continue; // see the next test
            }
            let still = vec![UnitQuaternion::identity(); moments.len()];
            assert!(ls::estimate(&moments, &still, &knowledge, None, 0.02).solution.x.iter().all(|v| v.is_finite()));
        }
    }
    for knowledge in [known(), Knowledge::PUBLISHED] {
        let nothing = Moments::default();
        for method in METHODS {
            let found = estimate(&nothing, &request(method, knowledge), &mut || true);
            assert_eq!(found.solution.x, Unknowns::zeros());
        }
        assert_eq!(ls::estimate(&nothing, &[], &knowledge, None, 0.02).solution.x, Unknowns::zeros());
    }
}

#[test]
fn numbers_that_overflow_end_the_linear_estimate_too() {
    let mut moments = Moments::default();
    for k in 0..20 {
        let value = 1e160 * (1.0 + f64::from(k % 7));
        let (gyr_dot1, gyr_dot2) = ([value; 3], [-value; 3]);
        moments.push(&Moment { time_s: f64::from(k), sample: [value; 12], gyr_dot1, gyr_dot2 });
    }
    let (send, ended) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let still = vec![UnitQuaternion::identity(); moments.len()];
        let _ = send.send(ls::estimate(&moments, &still, &known(), None, 0.02).solution.status);
    });
    assert_eq!(ended.recv_timeout(std::time::Duration::from_secs(10)), Ok(Status::NumericalError));
}
