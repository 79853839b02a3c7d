//! What goes through the pipeline: a checked RGB-D frame, its pose and its outcome.
//!
//! A [`Frame`] has been checked where it entered the server; nothing in the pipeline checks it again.
//! Wire types never get here.

use super::exposure;
use super::input_warning::InputWarning;
use super::pose_covariance::carried;
use super::saving::{packed, texts};
pub use lexsplat_registration::Intrinsics;
use nalgebra::{Isometry3, Matrix6, UnitVector3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The rasteriser's camera at `world_from_camera`.
pub fn rasteriser_camera(
    intrinsics: &Intrinsics,
    world_from_camera: &Isometry3<f64>,
) -> lexsplat_gpu::Camera {
    lexsplat_gpu::Camera {
        width: intrinsics.width,
        height: intrinsics.height,
        fx: intrinsics.fx as f32,
        fy: intrinsics.fy as f32,
        cx: intrinsics.cx as f32,
        cy: intrinsics.cy as f32,
        camera_from_world: world_from_camera.inverse().cast(),
    }
}

/// One checked RGB-D frame: color and depth are registered and of the size of `intrinsics`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Frame {
    /// Strictly increasing within a map.
    pub sequence: u64,
    /// When it was taken.
    pub timestamp_nanos: u64,
    /// The camera.
    pub intrinsics: Intrinsics,
    /// `[height * width * 3]`, row-major RGB, 8 bit.
    #[serde(with = "packed")]
    pub rgb: Arc<[u8]>,
    /// `[height * width]`, camera z in metres; 0 is no measurement, nothing is NaN or infinite.
    #[serde(with = "packed")]
    pub depth_metres: Arc<[f32]>,
    /// How much later than color depth was taken, nanoseconds; negative if it was earlier.
    pub depth_lag_nanos: i64,
    /// The given pose, rigid and finite; `None` if the server is to track.
    pub world_from_camera: Option<Isometry3<f64>>,
    /// The robot's own estimate of its pose, where the server is to track.
    pub hint: Option<Box<PoseHint>>,
    /// Labels sent with the frame; `None`: the networks find its language.
    pub labels: Option<Labels>,
    /// Whether the frame is only tracked and never becomes a keyframe.
    pub held_out: bool,
    /// What is known of the direction up.
    pub up: FrameUp,
}

/// What a frame says of the direction up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameUp {
    /// In the coordinates of the frame's pose or hint, as the sender of its stream says; `None` without one.
    pub in_world: Option<UnitVector3<f64>>,
    /// In the camera's coordinates, as an accelerometer measured it.
    pub in_camera: Option<UnitVector3<f64>>,
}

/// Labels sent with a frame: a text for each pixel.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Labels {
    /// `[height * width]`; 0 is no label, n stands for `texts[n - 1]`; n is at most the number of texts.
    #[serde(with = "packed")]
    pub ids: Arc<[u16]>,
    /// The text of each label; an empty text counts as no label.
    #[serde(with = "texts")]
    pub texts: Arc<[String]>,
}

/// A robot's own estimate of its pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseHint {
    /// The pose, rigid and finite.
    pub world_from_camera: Isometry3<f64>,
    /// Covariance of a left perturbation [rho metres, theta radians]: finite, symmetric, positive
    /// semi-definite. Without one the estimate only places a map's first frame.
    pub covariance: Option<Matrix6<f64>>,
}

/// Whether the newest frame has a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TrackingState {
    /// No frame yet.
    Empty,
    /// The newest frame has a pose.
    Tracking,
    /// The newest frame has none.
    Lost,
}

impl TrackingState {
    /// The name in statuses and events.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Empty => "empty",
            Self::Tracking => "tracking",
            Self::Lost => "lost",
        }
    }
}

/// The estimated or given pose of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TrackedPose {
    pub world_from_camera: Isometry3<f64>,
    /// Covariance relative to the map around the camera, in the camera's coordinates (`pose_covariance.rs`);
    /// `None` if it was not estimated.
    pub covariance: Option<Matrix6<f64>>,
    /// Exposure (a, b): the map's intensity is exp(a) times the frame's plus b.
    pub exposure: [f64; 2],
    /// Whether the tracker estimated the pose; otherwise it was given.
    pub is_estimated: bool,
    /// Whether the pose was found again after the camera was lost or had jumped.
    pub relocalised: bool,
    /// Sequence number of the keyframe that it was found beside, if the motion before is not connected with
    /// that.
    pub beside: Option<u64>,
}

/// A tracked frame's place on the trajectory.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct TrackedFrame {
    /// Sequence number of the frame.
    pub sequence: u64,
    /// Time of capture, nanoseconds.
    pub timestamp_nanos: u64,
    /// Pose of the camera.
    pub world_from_camera: Isometry3<f64>,
    /// Covariance relative to the map around the camera, in the camera's coordinates; `None` if it was not
    /// estimated.
    pub covariance: Option<Matrix6<f64>>,
    /// Exposure (a, b): the frame's color is exp(a) times the map's plus b.
    pub exposure: [f32; 2],
}

impl TrackedFrame {
    /// Covariance of a left perturbation [rho metres, theta radians] of `world_from_camera`, relative to the
    /// map around the camera; `None` if it was not estimated.
    pub fn world_covariance(&self) -> Option<Matrix6<f64>> {
        self.covariance.map(|covariance| carried(&self.world_from_camera, &covariance))
    }

    pub(super) fn new(frame: &Frame, tracked: &TrackedPose) -> Self {
        Self {
            sequence: frame.sequence,
            timestamp_nanos: frame.timestamp_nanos,
            world_from_camera: tracked.world_from_camera,
            covariance: tracked.covariance,
            exposure: exposure::inverse(tracked.exposure).map(|value| value as f32),
        }
    }
}

/// The result of mapping one frame.
#[derive(Clone, Debug)]
pub struct FrameOutcome {
    /// The frame's sequence.
    pub sequence: u64,
    /// Whether it has a pose.
    pub tracking: TrackingState,
    /// Whether the pose was found again after the camera was lost.
    pub relocalised: bool,
    /// Its pose, if tracked.
    pub world_from_camera: Option<Isometry3<f64>>,
    /// Covariance of the pose, as of [`TrackedFrame::world_covariance`].
    pub covariance: Option<Matrix6<f64>>,
    /// Whether the map took it as a keyframe.
    pub keyframe: bool,
    /// The map's revision after it.
    pub revision: u64,
    /// What is probably wrong with the frames of this stream, if it can be said for the first time now.
    pub input_warnings: Vec<InputWarning>,
}
