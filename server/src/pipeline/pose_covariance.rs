//! Covariances of poses in other coordinates.
//!
//! A covariance is that of a perturbation [rho metres, theta radians]. The covariance of `a_from_b` in the
//! coordinates of a belongs to a left perturbation, `Exp(tau) a_from_b`; in those of b to a right one.

use lexsplat_gpu::align::se3::adjoint;
use nalgebra::{Isometry3, Matrix6};

/// A covariance in the coordinates of a, in those of b.
pub(super) fn carried(b_from_a: &Isometry3<f64>, covariance: &Matrix6<f64>) -> Matrix6<f64> {
    let adjoint = adjoint(b_from_a);
    adjoint * covariance * adjoint.transpose()
}

/// The same knowledge of `b_from_a`, in the coordinates of b, if this is the covariance of `a_from_b` in
/// those of a.
pub(super) fn inverted(a_from_b: &Isometry3<f64>, covariance: &Matrix6<f64>) -> Matrix6<f64> {
    carried(&a_from_b.inverse(), covariance)
}
