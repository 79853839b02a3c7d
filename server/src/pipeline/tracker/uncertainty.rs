//! How uncertain an aligned pose is.
//!
//! In: the normal system at the estimate. Out: the covariance of the pose. The inverse of the system would be
//! that, if each pixel were an independent measurement with the assumed noise. Three things differ:
//!
//! - the noise is read from the residuals,
//! - neighbouring pixels err together,
//! - errors that all pixels share (registration, rolling shutter) act in every direction, also where the
//!   picture determines the pose well. So the mean variance is added to each direction.

use lexsplat_gpu::NormalSystem;
use nalgebra::{Matrix6, Vector6};

/// As many neighbouring pixels are worth one independent measurement.
const CORRELATED_PIXELS: f64 = 100.0;
/// Nothing is known better than this, metres and radians.
const FINEST: f64 = 1e-5;
/// Variance of a pose that the images do not determine, metres² and radians².
const UNKNOWN: f64 = 1.0;

/// Covariance of a left perturbation [rho metres, theta radians] of `reference_from_live`. One in `stride`
/// pixels was compared.
pub(super) fn covariance(system: &NormalSystem, with_exposure: bool, stride: u32) -> Matrix6<f64> {
    let residuals = f64::from(system.residuals().max(1));
    // The cost of a residual r is half of its weighted square.
    let noise = 2.0 * system.cost() / residuals;
    let pixels = CORRELATED_PIXELS / f64::from(stride);
    let inverse = system.information(with_exposure).cholesky().map(|cholesky| cholesky.inverse());
    let covariance =
        inverse.map_or(Matrix6::identity() * UNKNOWN, |inverse| inverse * noise * pixels);
    covariance + shared(&covariance) + Matrix6::identity() * FINEST.powi(2)
}

/// The mean variance of the position in each direction, and that of the rotation about each axis.
fn shared(covariance: &Matrix6<f64>) -> Matrix6<f64> {
    let mean = |from: usize| (from..from + 3).map(|i| covariance[(i, i)]).sum::<f64>() / 3.0;
    let (metres, radians) = (mean(0), mean(3));
    Matrix6::from_diagonal(&Vector6::from_fn(|i, _| if i < 3 { metres } else { radians }))
}
