//! Where an alignment starts, and where it ended.

use super::super::frame::{PoseHint, TrackedPose};
use super::super::keyframes::Keyframe;
use super::quality::AlignmentQuality;
use nalgebra::{Isometry3, Matrix6};
use serde::{Deserialize, Serialize};

/// Smallest standard deviation of a pose hint that is believed, metres and radians.
const FINEST_HINT: f64 = 1e-4;

/// The initial guess of an alignment.
#[derive(Clone, Debug)]
pub(super) struct InitialPose {
    pub world_from_camera: Isometry3<f64>,
    /// Exposure (a, b), see [`PoseCandidate`].
    pub exposure: [f64; 2],
    /// Whether the guess may be far off. Thresholds are wider then.
    pub is_wide: bool,
    /// Information matrix of a left perturbation of the pose, if its uncertainty is known.
    pub information: Option<Matrix6<f64>>,
}

/// A pose estimate and how well the frame agrees with the map there.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct PoseCandidate {
    pub world_from_camera: Isometry3<f64>,
    /// Exposure (a, b): the map's intensity is exp(a) times the frame's plus b.
    pub exposure: [f64; 2],
    pub quality: AlignmentQuality,
    /// Covariance relative to the references, in the camera's coordinates (`pose_covariance.rs`); `None` if
    /// it was not estimated.
    pub covariance: Option<Matrix6<f64>>,
    /// The keyframe that it was found beside, if that is not connected with the newest.
    pub beside: Option<u64>,
    /// Whether the pose was searched for far from the predicted one.
    pub jumped: bool,
}

impl InitialPose {
    /// The robot's own estimate; `None` if it gives no covariance.
    pub fn from_hint(hint: &PoseHint, exposure: [f64; 2]) -> Option<Self> {
        let covariance = hint.covariance? + Matrix6::identity() * FINEST_HINT.powi(2);
        let information = Some(covariance.cholesky()?.inverse());
        let world_from_camera = hint.world_from_camera;
        Some(Self { world_from_camera, exposure, is_wide: false, information })
    }

    /// A pose relative to a keyframe that shares features with the frame.
    pub fn beside_keyframe(keyframe: &Keyframe, keyframe_from_camera: &Isometry3<f64>) -> Self {
        let world_from_camera = keyframe.frame.world_from_camera * keyframe_from_camera;
        Self { world_from_camera, ..Self::at_keyframe(keyframe) }
    }

    /// The pose of a keyframe that looks like the frame.
    pub fn at_keyframe(keyframe: &Keyframe) -> Self {
        Self {
            world_from_camera: keyframe.frame.world_from_camera,
            exposure: keyframe.map_exposure,
            is_wide: true,
            information: None,
        }
    }
}

impl PoseCandidate {
    /// The same found beside this keyframe alone.
    pub fn beside(self, keyframe: &Keyframe) -> Self {
        let beside = (!keyframe.is_connected).then_some(keyframe.frame.sequence);
        Self { beside, ..self }
    }

    /// The pose of a tracked frame.
    pub fn tracked(&self, is_estimated: bool, relocalised: bool) -> TrackedPose {
        let Self { world_from_camera, covariance, exposure, beside, .. } = *self;
        TrackedPose { world_from_camera, covariance, exposure, is_estimated, relocalised, beside }
    }

    /// A given pose: it is not in doubt.
    pub fn given(world_from_camera: Isometry3<f64>) -> Self {
        let quality = AlignmentQuality::PERFECT;
        Self {
            world_from_camera,
            exposure: [0.0; 2],
            quality,
            covariance: None,
            beside: None,
            jumped: false,
        }
    }
}
