//! Compares the newest tracked frame with single keyframes.
//!
//! In: keyframes, and where the frame is relative to them. Out: measured relative poses with covariances,
//! which the pose graph is made of. The pose of the frame does not change.

use super::super::keyframes::Keyframe;
use super::super::pose_covariance::carried;
use super::candidate::PoseCandidate;
use super::config::TrackerConfig;
use super::frame_aligner::{FrameAligner, distance};
use super::judge::Judge;
use lexsplat_gpu::GpuError;
use lexsplat_pictures::{FeaturePose, Features};
use nalgebra::{Isometry3, Matrix6};

/// A place is recognised with at least this share of the picture in view of the keyframe,
const LEAST_OVERLAP: f64 = 0.4;
/// and with an aligned pose that is as near to its start as this, metres
const NEAR_METRES: f64 = 0.1;
/// and radians.
const NEAR_RADIANS: f64 = 0.05;

/// A measured pose of the newest frame relative to a keyframe.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Comparison {
    pub keyframe_from_camera: Isometry3<f64>,
    /// Covariance of a left perturbation [rho metres, theta radians], in the keyframe's coordinates.
    pub covariance: Matrix6<f64>,
}

impl Comparison {
    /// `None` if the covariance was not estimated.
    fn new(keyframe: &Keyframe, found: &PoseCandidate) -> Option<Self> {
        let world_from_keyframe = keyframe.frame.world_from_camera;
        let keyframe_from_camera = world_from_keyframe.inverse() * found.world_from_camera;
        let covariance = carried(&keyframe_from_camera, &found.covariance?);
        Some(Self { keyframe_from_camera, covariance })
    }
}

/// Measures the pose of the newest tracked frame relative to keyframes where it was tracked. One that it does
/// not fit is left out.
///
/// # Errors
/// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
pub(super) fn compare<'a>(
    aligner: &mut FrameAligner,
    config: &TrackerConfig,
    keyframes: &[&'a Keyframe],
) -> Result<Vec<(&'a Keyframe, Comparison)>, GpuError> {
    let mut compared = Vec::new();
    for keyframe in keyframes {
        let Some(found) = aligner.compare_last(keyframe, keyframes)? else { break };
        if found.quality.is_aligned(config) {
            compared.extend(Comparison::new(keyframe, &found).map(|found| (*keyframe, found)));
        }
    }
    Ok(compared)
}

/// Measures the pose of the newest tracked frame relative to a keyframe that shows the same place; `None`
/// unless that is beyond doubt, judged by these two pictures alone. It starts from matched features, or
/// else from where the camera is expected, if that is known to a few centimetres.
///
/// # Errors
/// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
pub(super) fn recognise(
    aligner: &mut FrameAligner,
    (config, judge): (&TrackerConfig, &Judge),
    features: &Features,
    keyframe: &Keyframe,
    expected: Option<Isometry3<f64>>,
) -> Result<Option<Comparison>, GpuError> {
    let matched = FeaturePose::find(features, &keyframe.features);
    tracing::debug!(keyframe = keyframe.frame.sequence, ?matched);
    let matched = matched.filter(FeaturePose::is_certain).map(|found| found.keyframe_from_camera);
    let Some(start) = matched.or(expected) else { return Ok(None) };
    let Some(found) = aligner.align_last(keyframe, &start)? else { return Ok(None) };
    let Some(comparison) = Comparison::new(keyframe, &found) else { return Ok(None) };
    let (metres, radians) = distance(&start, &comparison.keyframe_from_camera);
    tracing::debug!(metres, radians, quality = ?found.quality, "aligned with a keyframe");
    let is_sure = metres <= NEAR_METRES
        && radians <= NEAR_RADIANS
        && found.quality.overlap >= LEAST_OVERLAP
        && found.quality.is_relocalised(config)
        && judge.is_convincing(&found.quality, config);
    Ok(is_sure.then_some(comparison))
}
