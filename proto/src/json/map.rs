//! Maps and their keyframes.

use super::camera::Camera;
use serde::{Deserialize, Serialize};

/// Request to create a map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct NewMap {
    /// 1 to 64 characters of A-Z a-z 0-9 . _ - and no dot at the start.
    #[cfg_attr(feature = "schema", schema(example = "kitchen"))]
    pub name: String,
}

/// Status of a map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Status {
    pub name: String,
    /// Whether the map can be used. While it is loaded, all numbers are 0.
    #[serde(default)]
    pub state: MapState,
    /// How far it is loaded; absent if it is not being loaded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loading: Option<LoadProgress>,
    /// Increases each time the mapper publishes a newer map to queries.
    pub revision: u64,
    /// Frames that passed the checks.
    pub frames_received: u64,
    /// Frames with a pose.
    pub frames_tracked: u64,
    /// Frames without a pose.
    pub frames_lost: u64,
    /// Frames accepted but never mapped.
    pub frames_dropped: u64,
    /// Frames that did not pass the checks.
    pub frames_refused: u64,
    pub keyframes: u64,
    pub gaussians: u64,
    /// GPU memory of the Gaussians.
    pub gpu_bytes: u64,
    /// Memory of the keyframes' images and language codes, on the host and the GPU.
    pub keyframe_bytes: u64,
    /// "empty", "tracking" or "lost".
    pub tracking_state: String,
    /// Version of the online language compressor.
    pub olae_version: u64,
    /// Frames in the map's queue.
    pub queue_depth: usize,
    pub queue_capacity: usize,
    /// No frame is in the queue and the mapper has finished optimising what it has.
    pub settled: bool,
    /// Refinement at the size of the camera's pictures, while nothing else is to be done: "waiting",
    /// "refining", "converged", or "off" if it is never done.
    #[serde(default)]
    pub refinement: String,
    /// Why the map takes no more frames, if it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
    /// What is wrong with the recording that the map was rebuilt from; absent if nothing is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording_damage: Option<String>,
    /// The direction up; absent while the map is empty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<Up>,
    /// What is probably wrong with the frames that were sent, one entry for each problem; left out if
    /// there is none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub input_warnings: Vec<InputWarning>,
}

/// Whether a map can be used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum MapState {
    /// It takes frames and questions.
    #[default]
    Ready,
    /// It is loaded after a start of the server, or waits for it.
    Loading,
    /// It takes no frames: `failure` says why.
    Failed,
}

/// How far a map is loaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct LoadProgress {
    /// Frames that are in the map.
    pub frames_done: u64,
    /// Frames in the recording; 0 if they are not counted yet.
    pub frames_total: u64,
}

/// The direction up in a map's coordinates. The best source that there is counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Up {
    /// Unit length.
    pub direction: [f64; 3],
    /// "given": by the sender. "gravity": measured with the frames. "floor": floors and other level
    /// surfaces, and walls. "camera": a guess, the cameras' upper side.
    pub source: String,
    /// How much speaks for it, 0 to 1: 1 if it was given; with gravity the share of the readings within 10
    /// degrees of it; with floors how much more of the surfaces than by chance is level or upright, within 10
    /// degrees; 0 for a guess.
    pub confidence: f64,
}

/// What is probably wrong with frames. They are mapped all the same.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct InputWarning {
    /// "depth_unit", "inverted_poses", "camera_axes" or "unregistered_depth".
    pub problem: String,
    /// What is wrong, how sure that is, and what to do.
    pub message: String,
}

/// Maps, sorted by name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Maps {
    pub maps: Vec<Status>,
    /// `after` of the next page; absent on the last one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
}

/// Keyframes of a map, the oldest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Frames {
    pub map: String,
    pub revision: u64,
    pub frames: Vec<Keyframe>,
    /// `after` of the next page; absent on the last one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<u64>,
}

/// A keyframe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Keyframe {
    /// The sequence number that the sender gave it.
    pub sequence: u64,
    /// Seconds.
    pub timestamp: f64,
    pub timestamp_nanos: u64,
    /// Row-major 4x4, metres.
    pub world_from_camera: [f64; 16],
    pub camera: Camera,
    /// Whether its language is in the map.
    pub has_language: bool,
}

/// What a backup had that was put in place.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Restored {
    pub frames: u64,
    /// What of it is not used, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}
