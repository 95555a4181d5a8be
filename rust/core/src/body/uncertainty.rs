//! How far a found body may be off: what an angle at a joint needs of the covariance.

use alloc::{vec, vec::Vec};

use super::{assemble::Problem, band::Band, marginals::marginals, solve::eliminated, states::State, states::TURN};

/// Covariances of orientations and constants.
#[derive(Clone, Debug)]
pub struct Uncertainty {
    /// Of every joint at every moment, moment by moment: (6, 6) by rows, of the rotation vectors by which its two
    /// sensors may be turned in the world, rad².
    pub joints: Vec<[f64; 36]>,
    /// The same six with all constants, (6, constants) by rows.
    pub beside: Vec<f64>,
    /// Of the constants, by rows.
    pub constants: Vec<f64>,
}

/// The covariance at a minimum, as the curvature says, with constants that are held as uncertain as was stated; None where the curvature is not positive.
pub fn uncertainty(problem: &Problem<'_>, state: &State) -> Option<Uncertainty> {
    let (model, count) = (problem.model, problem.moments.len());
    let (joints, constants) = (model.joints.len(), model.constants());
    let mut band = Band::new(count, model.sensors, constants);
    // Nothing but damping says where the whole is: a standard deviation of a kilometre beforehand, or where rounding asks for
    // more of a hundred metres, takes nothing from what is between the sensors.
    let unplaced = problem.unplaced();
    [1e-6, 1e-5, 1e-4].iter().find(|damping| eliminated(&unplaced, state, **damping, &mut band))?;
    let mut found = Uncertainty {
        joints: vec![[0.0; 36]; count * joints],
        beside: vec![0.0; count * joints * 6 * constants],
        constants: Vec::new(),
    };
    found.constants = marginals(&band, problem.held.as_deref(), |k, marginal| {
        for (j, joint) in model.joints.iter().enumerate() {
            let own = &mut found.joints[k * joints + j];
            for a in 0..6 {
                for b in 0..6 {
                    own[6 * a + b] = marginal.own([joint.sensors[a / 3], joint.sensors[b / 3]], TURN + a % 3, TURN + b % 3);
                }
                let row = ((k * joints + j) * 6 + a) * constants;
                for (c, v) in found.beside[row..row + constants].iter_mut().enumerate() {
                    *v = marginal.beside(joint.sensors[a / 3], TURN + a % 3, c);
                }
            }
        }
    })?;
    Some(found)
}
