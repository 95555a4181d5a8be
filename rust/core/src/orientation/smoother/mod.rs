//! Smoother: maximum a posteriori over a whole recording of what two sensors on one joint say about `q_12`, jointly with the
//! joint centre as seen from both, and the biases of both accelerometers and gyroscopes.
//!
//! Only the relative orientation matters to the link between the sensors (eq. 3 of Remmerswaal et al. 2021), so one rotation
//! a moment is unknown, not two. Both sensors' samples are brought into frames that their own gyroscopes keep from turning
//! ([`keys`]); what is left unknown there is a rotation that drifts slowly, so that ten unknowns a second are plenty, each
//! held by a link averaged over a fraction of a second. No rate is ever differenced, and no filter acts on turning axes.
//! Time is linear in the length of the recording: the Gauss–Newton system is a chain of 3×3 blocks with a border of 18
//! constants ([`arrowhead`]), and so are the marginal covariances ([`marginals`]). How much to trust links and gyroscopes is
//! estimated with the rest ([`noise`]).
//!
//! * [`kernel`], [`keys`]: windows; what the sensors say at the keys
//! * [`residual`], [`assemble`]: residuals with Jacobians; cost and system
//! * [`arrowhead`], [`marginals`]: solution and covariances
//! * [`noise`], [`norms`], [`start`]: scales; where to begin
//! * [`solve`], [`observability`], [`output`]: the descent; what the data show at all; from keys back to samples

pub mod arrowhead;
pub mod assemble;
pub mod kernel;
pub mod keys;
pub mod marginals;
pub mod noise;
pub mod norms;
pub mod observability;
pub mod output;
pub mod residual;
pub mod solve;
pub mod start;

pub use assemble::Prior;
pub use output::Smoothed;
pub use solve::{Options, Status, smooth};
