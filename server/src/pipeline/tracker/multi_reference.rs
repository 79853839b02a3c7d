//! Aligns a frame with several references at once by summing their normal systems.
//!
//! The unknowns are base_from_live, with a left perturbation tau, and the exposure (a, b) that turns the
//! live intensity into the map's. Reference i stands at X = reference_from_base and has an exposure (c, d) of
//! its own (map = exp(c) I_i + d). Seen from it,
//!
//! - reference_from_live = X base_from_live is perturbed by Ad(X) tau,
//! - I_i = exp(a - c) live + (b - d) exp(-c),
//!
//! so that with A = diag(Ad(X), 1, exp(-c)) its system adds A^T H A and A^T g.
//!
//! Only the gain a is estimated; b stays at its start. With both free, image noise makes the contrast of each
//! keyframe one percent too low (regression dilution), and the error adds up along a walk.

use super::super::exposure;
use lexsplat_gpu::align::se3::adjoint;
use lexsplat_gpu::align::{Comparison, EXPOSURE_LIMIT};
use lexsplat_gpu::{Aligned, Aligner, Estimate, GpuError, NormalSystem, Pyramid, Schedule};
use nalgebra::{Isometry3, SMatrix};
use std::sync::Arc;

/// Information of b, far above what images contribute, so that b is fixed.
const OFFSET_INFORMATION: f64 = 1e12;

/// An image that a frame is compared with.
#[derive(Clone)]
pub(super) struct Reference {
    pub pyramid: Arc<Pyramid>,
    pub world_from_reference: Isometry3<f64>,
    /// Exposure (c, d): the map's intensity is exp(c) times the image's plus d.
    pub exposure: [f64; 2],
    /// Factor of its normal system.
    pub weight: f64,
}

/// Aligns `live` with all references, coarse to fine. Also returns each reference's own system at the final
/// estimate.
///
/// # Errors
/// [`GpuError::DeviceLost`].
pub(super) fn align(
    aligner: &mut Aligner,
    references: &[Reference],
    live: &Pyramid,
    world_from_base: &Isometry3<f64>,
    start: &Estimate,
    schedule: &Schedule,
) -> Result<(Aligned, Vec<NormalSystem>), GpuError> {
    let linear: Vec<LinearMap> =
        references.iter().map(|reference| LinearMap::new(reference, world_from_base)).collect();
    let mut systems_at = |level: usize, estimate: &Estimate| {
        let pairs = references.iter().zip(&linear);
        let comparisons: Vec<_> = pairs
            .map(|(reference, linear)| Comparison {
                reference: &reference.pyramid.levels()[level],
                live: &live.levels()[level],
                estimate: linear.estimate(estimate),
            })
            .collect();
        aligner.systems(&comparisons, &schedule.settings.at_level(level))
    };
    // Sums of the finest level and what they are of. The accepted one is among them.
    let mut finest: Vec<(NormalSystem, Vec<NormalSystem>)> = Vec::new();
    let aligned = lexsplat_gpu::align::align(start, schedule, |level, estimate| {
        let systems = systems_at(level, estimate)?;
        let mut sum = NormalSystem::default();
        sum.h[(7, 7)] = OFFSET_INFORMATION;
        for ((system, reference), linear) in systems.iter().zip(references).zip(&linear) {
            linear.add(&mut sum, system, reference.weight);
        }
        if level == 0 {
            finest.push((sum.clone(), systems));
        }
        Ok::<_, GpuError>(sum)
    })?;
    let last = finest.into_iter().rev().find(|(sum, _)| *sum == aligned.system);
    let systems = match last {
        Some((_, systems)) => systems,
        None => systems_at(0, &aligned.estimate)?,
    };
    Ok((aligned, systems))
}

/// The estimate with which the reference is aligned with the live image instead.
pub(super) fn reversed(
    reference: &Reference,
    world_from_live: &Isometry3<f64>,
    exposure: [f64; 2],
) -> Estimate {
    let base_from_live = Isometry3::identity();
    let linear = LinearMap::new(reference, world_from_live);
    let here = linear.estimate(&Estimate { reference_from_live: base_from_live, exposure });
    Estimate {
        reference_from_live: here.reference_from_live.inverse(),
        exposure: within_limit(exposure::inverse(here.exposure)),
    }
}

/// The gain of a frame relative to a reference may be the product of two large ones.
fn within_limit([a, b]: [f64; 2]) -> [f64; 2] {
    [a.clamp(-EXPOSURE_LIMIT, EXPOSURE_LIMIT), b]
}

/// Change of variables from the common unknowns to those of one reference.
struct LinearMap {
    reference_from_base: Isometry3<f64>,
    exposure: [f64; 2],
    jacobian: SMatrix<f64, 8, 8>,
}

impl LinearMap {
    fn new(reference: &Reference, world_from_base: &Isometry3<f64>) -> Self {
        let reference_from_base = reference.world_from_reference.inverse() * world_from_base;
        let mut jacobian = SMatrix::<f64, 8, 8>::identity();
        jacobian.fixed_view_mut::<6, 6>(0, 0).copy_from(&adjoint(&reference_from_base));
        jacobian[(7, 7)] = (-reference.exposure[0]).exp();
        Self { reference_from_base, exposure: reference.exposure, jacobian }
    }

    fn estimate(&self, estimate: &Estimate) -> Estimate {
        let ([a, b], [c, d]) = (estimate.exposure, self.exposure);
        Estimate {
            reference_from_live: self.reference_from_base * estimate.reference_from_live,
            exposure: within_limit([a - c, (b - d) * (-c).exp()]),
        }
    }

    fn add(&self, sum: &mut NormalSystem, system: &NormalSystem, weight: f64) {
        sum.h += self.jacobian.transpose() * system.h * self.jacobian * weight;
        sum.g += self.jacobian.transpose() * system.g * weight;
        sum.photometric_cost += weight * system.photometric_cost;
        sum.geometric_cost += weight * system.geometric_cost;
        let (all, one) = (&mut sum.counts, &system.counts);
        all.live += one.live;
        all.inside += one.inside;
        all.photometric += one.photometric;
        all.geometric += one.geometric;
        all.photometric_inliers += one.photometric_inliers;
        all.geometric_inliers += one.geometric_inliers;
        all.visible += one.visible;
        all.agreeing += one.agreeing;
        all.meeting += one.meeting;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_gain_between_two_images_stays_within_what_the_device_takes() {
        let relative = |a: f64, c: f64| {
            let exposure = [c, 0.0];
            let jacobian = SMatrix::identity();
            let linear =
                LinearMap { reference_from_base: Isometry3::identity(), exposure, jacobian };
            linear.estimate(&Estimate { exposure: [a, 0.0], ..Estimate::default() }).exposure[0]
        };
        assert_eq!(relative(2.0, -2.0), EXPOSURE_LIMIT, "a frame 50 times as dark");
        assert_eq!(relative(-2.0, 2.0), -EXPOSURE_LIMIT);
        assert_eq!(relative(1.0, -0.5), 1.5, "an ordinary gain is kept");
    }
}
