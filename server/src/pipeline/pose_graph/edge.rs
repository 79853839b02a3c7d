//! Measured relative poses and their covariances.

use lexsplat_gpu::align::se3;
use nalgebra::{Isometry3, Matrix6, Vector6};
use serde::{Deserialize, Serialize};

/// Surfaces are about this far from a camera, metres: how much an error of a rotation counts.
const DISTANCE_METRES: f64 = 2.0;

/// A pose of one node relative to another, as it was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(in super::super) struct Edge {
    /// Index of a node.
    pub first: usize,
    /// Index of another node.
    pub second: usize,
    pub first_from_second: Isometry3<f64>,
    /// Covariance in the coordinates of `first`.
    pub covariance: Matrix6<f64>,
    /// Whether it closes a loop, so that it may be wrong altogether.
    pub is_closure: bool,
}

impl Edge {
    /// Squared distance of these poses from the measured one, in units of its covariance.
    pub fn disagreement(&self, poses: &[Isometry3<f64>]) -> f64 {
        let off = self.residual(poses);
        off.dot(&(self.information() * off))
    }

    /// The inverse of the covariance; 0 if that is singular.
    pub fn information(&self) -> Matrix6<f64> {
        self.covariance.cholesky().map_or_else(Matrix6::zeros, |cholesky| cholesky.inverse())
    }

    /// The twist from the measured pose to that of these poses, in the coordinates of `first`.
    pub fn residual(&self, poses: &[Isometry3<f64>]) -> Vector6<f64> {
        let first_from_second = poses[self.first].inverse() * poses[self.second];
        se3::log(&(first_from_second * self.first_from_second.inverse()))
    }
}

/// Squared distance of two relative poses in units of their covariance; infinite if that is singular. It is
/// 6 on average if both are right.
pub(in super::super) fn disagreement(
    expected: &Isometry3<f64>,
    measured: &Isometry3<f64>,
    covariance: &Matrix6<f64>,
) -> f64 {
    let off = se3::log(&(measured * expected.inverse()));
    covariance.cholesky().map_or(f64::INFINITY, |cholesky| off.dot(&cholesky.solve(&off)))
}

/// How far surfaces are misplaced, metres (standard deviation): of the position, and of the rotation at
/// two metres.
pub(super) fn expected_metres(covariance: &Matrix6<f64>) -> f64 {
    let trace = |from: usize| (from..from + 3).map(|i| covariance[(i, i)]).sum::<f64>();
    (trace(0) + DISTANCE_METRES.powi(2) * trace(3)).sqrt()
}
