//! The normal system that the device sums, and its solution on the host: 8 unknowns
//! [rho, theta, a, b], in metres, radians and intensity.

use nalgebra::{Isometry3, Matrix6, SMatrix, SVector, Vector6};

use super::{Estimate, se3};

/// Smallest ratio of eigenvalues of the pose's information at which a step is trusted.
const MIN_CONDITIONING: f64 = 1e-7;
/// Largest |a| of an exposure: a factor of 20 in brightness.
pub const EXPOSURE_LIMIT: f64 = 3.0;

/// Counts of live pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// With a depth.
    pub live: u32,
    /// Inside the reference image.
    pub inside: u32,
    /// With a photometric residual.
    pub photometric: u32,
    /// With a geometric residual.
    pub geometric: u32,
    /// With a photometric residual within the threshold.
    pub photometric_inliers: u32,
    /// With a geometric residual within the threshold.
    pub geometric_inliers: u32,
    /// On a surface that the reference shows too: not behind the reference's surface, and both pixels
    /// have a normal.
    pub visible: u32,
    /// Of those the ones that agree with the reference in depth and in intensity.
    pub agreeing: u32,
    /// Of those the ones that agree in depth, whatever their intensity.
    pub meeting: u32,
}

/// Sum over pixels of both terms; see [`crate::track::align`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NormalSystem {
    /// Sum of w J^T J, symmetric.
    pub h: SMatrix<f64, 8, 8>,
    /// Sum of w J^T r.
    pub g: SVector<f64, 8>,
    /// Robust photometric cost, with its weight.
    pub photometric_cost: f64,
    /// Robust geometric cost, with its weight.
    pub geometric_cost: f64,
    /// Pixels.
    pub counts: Counts,
}

/// Prior knowledge of the pose, with the cost 1/2 tau^T information tau with
/// `Exp(tau) reference_from_live = estimate`.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    /// Information of [rho, theta].
    pub information: Matrix6<f64>,
    /// The pose that is expected.
    pub reference_from_live: Isometry3<f64>,
}

/// One Gauss-Newton step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseStep {
    /// [rho, theta] of the left perturbation.
    pub tau: Vector6<f64>,
    /// Change of (a, b); 0 if it is not estimated.
    pub exposure: [f64; 2],
    /// By how much the cost falls with it, the prior's included, if the system is right.
    pub promised: f64,
}

impl NormalSystem {
    /// From the sums as the device writes them: 36 of the upper triangle row by row, 8 of the
    /// gradient, 2 costs, 9 counts, 1 unused.
    pub(super) fn from_sums(sums: &[f32]) -> Self {
        let mut numbers = sums.iter().map(|v| f64::from(*v));
        let mut next = || numbers.next().expect("a system has 56 sums");
        let mut h = SMatrix::zeros();
        for row in 0..8 {
            for column in row..8 {
                h[(row, column)] = next();
                h[(column, row)] = h[(row, column)];
            }
        }
        let g = SVector::from_fn(|_, _| next());
        let (photometric_cost, geometric_cost) = (next(), next());
        let mut count = || next() as u32;
        let counts = Counts {
            live: count(),
            inside: count(),
            photometric: count(),
            geometric: count(),
            photometric_inliers: count(),
            geometric_inliers: count(),
            visible: count(),
            agreeing: count(),
            meeting: count(),
        };
        Self { h, g, photometric_cost, geometric_cost, counts }
    }

    /// Robust cost of both terms.
    pub fn cost(&self) -> f64 {
        self.photometric_cost + self.geometric_cost
    }

    /// Number of residuals.
    pub fn residuals(&self) -> u32 {
        self.counts.photometric + self.counts.geometric
    }

    /// Information of [rho, theta], the exposure being unknown too if it is estimated: the Schur
    /// complement of H. Its unit is that of the weights: with weights 1 / sigma² and independent
    /// pixels, the inverse is the covariance of the pose; neighbouring pixels are not independent.
    pub fn information(&self, with_exposure: bool) -> Matrix6<f64> {
        let pose = self.h.fixed_view::<6, 6>(0, 0).into_owned();
        let cross = self.h.fixed_view::<6, 2>(0, 6);
        let exposure = self.h.fixed_view::<2, 2>(6, 6).into_owned();
        match exposure.try_inverse() {
            Some(inverse) if with_exposure => pose - cross * inverse * cross.transpose(),
            _ => pose,
        }
    }

    /// Smallest over largest eigenvalue of [`NormalSystem::information`], with a prior's added: 0
    /// when some motion cannot be seen at all. Metres and radians count alike, which is fair for
    /// scenes of a few metres.
    pub fn conditioning(&self, with_exposure: bool, prior: Option<&Prior>) -> f64 {
        let prior = prior.map_or_else(Matrix6::zeros, |prior| prior.information);
        let information = self.information(with_exposure) + prior;
        if !information.iter().all(|v| v.is_finite()) {
            return 0.0;
        }
        let values = information.symmetric_eigenvalues();
        let (low, high) = (values.min(), values.max());
        if high > 0.0 { (low / high).max(0.0) } else { 0.0 }
    }

    /// The step (H + damping diag H + prior)^-1 (-g + prior): Levenberg-Marquardt. `None` if the
    /// system does not determine all six motions, or the exposure if it is estimated.
    pub fn solve(
        &self,
        damping: f64,
        with_exposure: bool,
        prior: Option<(&Prior, &Estimate)>,
    ) -> Option<PoseStep> {
        let conditioning = self.conditioning(with_exposure, prior.map(|(prior, _)| prior));
        let textured = !with_exposure || self.h[(6, 6)] * self.h[(7, 7)] > 0.0;
        if !(conditioning > MIN_CONDITIONING && textured) {
            return None;
        }
        let (mut h, mut g) = (self.h, self.g);
        if let Some((prior, estimate)) = prior {
            let off = prior.off(&estimate.reference_from_live);
            let mut pose = h.fixed_view_mut::<6, 6>(0, 0);
            pose += prior.information;
            let mut slope = g.fixed_rows_mut::<6>(0);
            slope -= prior.information * off;
        }
        if !with_exposure {
            h.fixed_view_mut::<8, 2>(0, 6).fill(0.0);
            h.fixed_view_mut::<2, 8>(6, 0).fill(0.0);
            h.fixed_view_mut::<2, 2>(6, 6).fill_with_identity();
            g.fixed_rows_mut::<2>(6).fill(0.0);
        }
        for i in 0..8 {
            h[(i, i)] *= 1.0 + damping;
        }
        let step = h.cholesky()?.solve(&-g);
        step.iter().all(|v| v.is_finite()).then(|| PoseStep {
            tau: step.fixed_rows::<6>(0).into_owned(),
            exposure: [step[6], step[7]],
            promised: -0.5 * g.dot(&step),
        })
    }
}

impl PoseStep {
    /// The step made so many times as long; what it promises stays.
    pub(super) fn stretched(&self, by: f64) -> Self {
        let Self { tau, exposure, promised } = *self;
        Self { tau: tau * by, exposure: exposure.map(|change| change * by), promised }
    }

    /// The slope along the step.
    pub(super) fn along(&self, slopes: &SVector<f64, 8>) -> f64 {
        let [a, b] = self.exposure;
        self.tau.dot(&slopes.fixed_rows::<6>(0)) + a * slopes[6] + b * slopes[7]
    }
}

impl Prior {
    /// The twist from a pose to the expected one.
    fn off(&self, reference_from_live: &Isometry3<f64>) -> Vector6<f64> {
        se3::log(&(self.reference_from_live * reference_from_live.inverse()))
    }

    /// 1/2 tau^T information tau.
    pub fn cost(&self, reference_from_live: &Isometry3<f64>) -> f64 {
        let off = self.off(reference_from_live);
        0.5 * off.dot(&(self.information * off))
    }
}

impl Estimate {
    /// The estimate after a step; a stays within ± [`EXPOSURE_LIMIT`].
    pub fn moved(&self, step: &PoseStep) -> Estimate {
        let a = self.exposure[0] + step.exposure[0];
        let b = self.exposure[1] + step.exposure[1];
        Estimate {
            reference_from_live: se3::exp(&step.tau) * self.reference_from_live,
            exposure: [a.clamp(-EXPOSURE_LIMIT, EXPOSURE_LIMIT), b],
        }
    }
}
