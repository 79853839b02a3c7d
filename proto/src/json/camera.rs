//! Cameras and views.

use serde::{Deserialize, Serialize};

/// Pinhole intrinsics in pixels; the centre of the top-left pixel is (0, 0).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Camera {
    pub width: u32,
    pub height: u32,
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
}

/// The view of a tracked frame (`frame`), or of any camera (`camera` and `world_from_camera`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(default, deny_unknown_fields)]
pub struct View {
    /// The sequence number of a tracked frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Pose of `camera`: 16 numbers, row-major 4x4, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub world_from_camera: Option<Vec<f64>>,
}

impl View {
    /// The view of a tracked frame.
    pub fn of_frame(sequence: u64) -> Self {
        Self { frame: Some(sequence), ..Self::default() }
    }
}
