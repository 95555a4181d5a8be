//! How well each kind of term fits: root mean squares of white residuals, so that 1 is as expected of Gaussian noise.

use alloc::{vec, vec::Vec};
use nalgebra::ComplexField;

use super::{
    assemble::{Problem, flat, whitened},
    factors::imu,
    states::State,
};

/// Root mean squares of white residuals, a component at a time; NaN where there is no such term.
#[derive(Clone, Debug)]
pub struct Residuals {
    /// Of each sensor: its dynamics (9 components a step), the steps of its gyroscope bias and of its accelerometer bias.
    pub sensors: Vec<[f64; 3]>,
    /// Of each joint: its centre, its hinge from both sides (2 components each), the angle between its axes (2 components).
    pub joints: Vec<[f64; 3]>,
}

/// Sum of squares and number of components.
type Sum = (f64, f64);

/// The residuals at `state`.
pub fn residuals(problem: &Problem<'_>, state: &State) -> Residuals {
    let (sensors, gravity) = (problem.model.sensors, problem.model.gravity);
    let none: [Sum; 3] = [(0.0, 0.0); 3];
    let (mut of_sensors, mut of_joints) = (vec![none; sensors], vec![none; problem.model.joints.len()]);
    let add = |sum: &mut Sum, squares: f64, components: f64| {
        sum.0 += squares;
        sum.1 += components;
    };
    for k in 0..problem.moments.len() {
        let here = &state.motions[k * sensors..];
        if let Some(after) = state.motions.get((k + 1) * sensors..(k + 2) * sensors) {
            let [gyr, acc] = problem.walk_weights(k);
            for (s, sums) in of_sensors.iter_mut().enumerate() {
                if let Some(link) = &problem.moments.links[k * sensors + s] {
                    let e = flat(&imu::residual(&link.pre, &here[s], &after[s], gravity));
                    add(&mut sums[0], whitened(&link.whitening, &e).iter().map(|v| v * v).sum(), 9.0);
                }
                add(&mut sums[1], gyr * (after[s].gyr_bias - here[s].gyr_bias).norm_squared(), 3.0);
                add(&mut sums[2], acc * (after[s].acc_bias - here[s].acc_bias).norm_squared(), 3.0);
            }
        }
        let mut joint = of_joints.iter_mut();
        problem.joints(k, state, |terms| {
            let Some(sums) = joint.next() else { return };
            // Centre, hinge, hinge, axes; those across an axis have two components.
            for (term, (place, components)) in terms.iter().zip([(0, 3.0), (1, 2.0), (1, 2.0), (2, 2.0)]) {
                add(&mut sums[place], term.square, components);
            }
        });
    }
    let root = |sums: [Sum; 3]| sums.map(|(squares, count)| ComplexField::sqrt(squares / count));
    Residuals { sensors: of_sensors.into_iter().map(root).collect(), joints: of_joints.into_iter().map(root).collect() }
}
