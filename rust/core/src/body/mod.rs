//! Lower body from sensors on pelvis, thighs, shanks and feet: McGrath & Stirling 2020, as a maximum a posteriori estimate over
//! a whole recording. Equation numbers without a year are of that paper.
//!
//! # Unknowns
//!
//! Of every sensor ten times a second ([`moments`]): orientation, velocity, position, gyroscope and accelerometer bias, 15
//! numbers, so 105 for seven sensors ([`states`]). Of the body: each joint's centre as seen from the sensors on either side (36
//! numbers), each knee's axis in thigh and shank (8), and how skin turns and shifts the sensors of thighs and shanks as knees and
//! hips bend (36, [`factors::skin`]; not in the paper). The paper also estimates the angular rate at every moment (21 more);
//! it enters only linearly and only into the hinge, so it is eliminated beforehand, exactly where both axes agree
//! ([`factors::hinge`]).
//!
//! Orientations are turned from the left, `R ← Exp(φ) R`, axes moved on the tangent plane of the sphere, all else by sums. World z
//! is up. Parametrisation moves not the minimum but the way there, and two that look better are worse: SE₂(3) from the left,
//! in which dynamics are exactly linear, and the bending of velocity and position by `J_l(φ)` alone took 16 to 18 iterations on
//! 30 s of the peer's simulation, sums take 9 (all without climbs, see [`solve`]).
//!
//! # Terms
//!
//! One file each in [`factors`], all with analytic derivatives: dynamics by preintegration ([`preintegration`]), random walk of
//! the biases, hinge, joint centre, and of the body alone length, limits, difference, and angle of axis and bone. Joint centres
//! and hinges may have Student's t ([`loss`]): soft tissue enters there, but for what of it follows the flexion of a joint. That
//! moves a joint's centre in the sensor in proportion; taken for white it would push centres aside by millimetres, and would
//! count as known ever better the longer it lasts.
//!
//! # Solution
//!
//! Moment by moment the normal equations are a chain of dense blocks with a border of 80 constants ([`band`]): every moment is
//! tied to the next sensor by sensor only, and eliminating one fills the next completely (the joints see to that), so a general
//! sparse solver finds no more zeros than this order has. A block of 16×16 a sensor ([`tiles`]) keeps all of the work in a
//! few kernels, which are compiled for 128, 256 and 512 bits and chosen when run: 0.05 s an iteration of 30 s, 0.13 s of 90 s
//! (printed by benches/body/gtsam_peer.py on a shared core; GTSAM's own multifrontal solver needs 0.25 and 0.9 s a factorisation
//! there). faer's dense kernels (0.24, one thread) take 0.21 s for the factors, solves and products of the same 900 blocks alone,
//! without what block-diagonal coupling saves, and two more minutes to compile. The coupling's being block diagonal halves the
//! work against a general block tridiagonal matrix. Time and memory are linear in the recording's length.
//!
//! Levenberg–Marquardt with damping in physical units, which may climb for one step where the next leads below where it
//! was ([`solve`], [`assemble`]).

pub mod assemble;
pub mod band;
pub mod factors;
pub mod loss;
pub mod marginals;
pub mod model;
pub mod moments;
pub mod preintegration;
pub mod solve;
pub mod states;
pub mod tiles;
pub mod uncertainty;
