//! Server-sent events of a map. The event "status" carries a [`super::Status`].

use serde::{Deserialize, Serialize};

/// Event "frame": the mapper has handled a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct FrameEvent {
    pub sequence: u64,
    /// "empty", "tracking" or "lost".
    pub tracking_state: String,
    /// Row-major 4x4, metres; absent when tracking is lost.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub world_from_camera: Option<[f64; 16]>,
    /// Whether the frame became a keyframe.
    pub keyframe: bool,
    pub revision: u64,
}

/// Event "input_warning": the frames of a stream are probably wrong.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct InputWarningEvent {
    /// The frame with which it was noticed.
    pub sequence: u64,
    /// "depth_unit", "inverted_poses", "camera_axes" or "unregistered_depth".
    pub problem: String,
    /// What is wrong, how sure that is, and what to do.
    pub message: String,
}

/// Event "revision": a newer map has been published to queries.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct RevisionEvent {
    pub revision: u64,
    pub gaussians: usize,
    pub keyframes: usize,
}

/// Event "refinement": the refinement of the map begins, pauses or ends; see [`super::Status::refinement`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct RefinementEvent {
    pub refinement: String,
}

/// Event "missed": the events with these ids are no longer kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct MissedEvent {
    pub first: u64,
    pub last: u64,
}
