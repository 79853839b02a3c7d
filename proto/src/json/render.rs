//! Requests for rendered images.

use super::camera::Camera;
use serde::{Deserialize, Serialize};

/// A rendered image from a tracked frame or any camera; `width` and `height` scale it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(default, deny_unknown_fields)]
pub struct RenderRequest {
    /// The sequence number of a tracked frame; or `camera` and `world_from_camera`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Pose of `camera`: 16 numbers, row-major 4x4, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub world_from_camera: Option<Vec<f64>>,
    pub channel: Channel,
    /// Columns; if only `height` is given, they follow from it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width: Option<u32>,
    /// Rows; if only `width` is given, they follow from it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height: Option<u32>,
}

/// What a rendered image shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Channel {
    #[default]
    Color,
    /// 16-bit millimetres as PNG, float32 metres as npy.
    Depth,
    /// Language codes as colors.
    Language,
    Opacity,
    /// How far the codes of keyframes spread around the map's: 0 where they agree and where nothing was seen,
    /// about 0.2 in clean rooms; dark blue to red from 0 to 1 as PNG, float32 as npy.
    Spread,
}
