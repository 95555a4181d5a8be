//! Relative orientation of two connected sensors, drift-free without a magnetometer: the filters of Remmerswaal et al. 2021.
//!
//! | module | holds |
//! | --- | --- |
//! | [`lane`], `eight`, `registers` | numbers of one instant, or of eight side by side |
//! | `algebra` | quaternions and symmetric matrices over them |
//! | [`start`] | the closed form over the first seconds |
//! | [`state`] | what a filter knows, what an instant tells |
//! | [`leaning`] | what unknown gyroscope biases do to it |
//! | [`method`] | what the filters share: noise, steps |
//! | [`complementary`], `stages`, `interleaved` | Algorithm 1 |
//! | [`mekf`] | multiplicative extended Kalman filter |
//! | [`settings`], [`filter`] | samples in, estimates out: delay, gaps, restarts |
//! | [`run`](mod@run) | whole recordings: what comes in, what is carried back |
//! | [`innovation`] | what they did not foresee |
//! | [`batch`], `pack`, `rows`, `results` | one recording, or many side by side |
//! | [`smoother`] | the most probable orientation over a whole recording |
//!
//! What `wide` registers work on has to be inlined into code that was compiled for them. In debug builds, where every step has
//! a place of its own on the stack, the largest functions are not, lest a thread's stack be too small.

mod algebra;
pub mod batch;
mod bytes;
pub mod complementary;
mod eight;
pub mod filter;
pub mod innovation;
mod interleaved;
pub mod lane;
pub mod leaning;
pub mod mekf;
pub mod method;
mod pack;
#[cfg(all(feature = "std", target_arch = "x86_64"))]
mod registers;
mod results;
mod ring;
mod rows;
pub mod run;
pub mod settings;
pub mod smoother;
mod stages;
pub mod start;
pub mod state;
mod turns;

pub use batch::{run, run_batch};
pub use complementary::Complementary;
pub use filter::{Estimate, Filter, Status};
pub use innovation::{Innovations, innovations};
pub use mekf::{Mekf, Outliers};
pub use run::{Done, Estimates, Page, Signals};
pub use settings::Settings;
pub use start::start_of;
pub use state::{Joint, Noise};
