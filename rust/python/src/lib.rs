//! Python binding of imufast-core: check, view, release the GIL, call, wrap. Nothing else.

mod arrays;
mod blocks;
mod body;
mod center;
mod hinge;
mod orientation;
mod select;
mod signals;
mod smoother;
mod stream;

use pyo3::prelude::*;

/// Numerical core of imufast.
#[pymodule]
mod _core {
    #[pymodule_export]
    use super::body::{BodyFit, BodyProblem};
    #[pymodule_export]
    use super::center::{CenterFit, CenterStream, fit_center, fit_center_linear};
    #[pymodule_export]
    use super::hinge::{HingeFit, angular_deviation, hinge_axis, hinge_residuals};
    #[pymodule_export]
    use super::orientation::{OrientationFilter, filter_innovations, track_filter, track_filter_batch};
    #[pymodule_export]
    use super::select::select_samples;
    #[pymodule_export]
    use super::signals::condition;
    #[pymodule_export]
    use super::smoother::{SmootherFit, smooth_orientation};
    #[pymodule_export]
    use super::stream::{HingeRecord, HingeStream};
    use super::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("PRESENT_MOVING", imufast_core::hinge::stream::PRESENT_MOVING)?;
        module.add("build_profile", if cfg!(debug_assertions) { "debug" } else { "release" })
    }
}
