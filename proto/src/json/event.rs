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

/// Event "revision": a newer map has been published to queries.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct RevisionEvent {
    pub revision: u64,
    pub gaussians: usize,
    pub keyframes: usize,
}

/// Event "missed": the events with these ids are no longer kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct MissedEvent {
    pub first: u64,
    pub last: u64,
}
