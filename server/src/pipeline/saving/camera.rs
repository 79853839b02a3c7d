//! The fields of the engine's camera, which knows no serde.

use lexsplat_gpu::Camera;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

/// For `#[serde(with = "CameraFields")]`.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Camera")]
pub(in super::super) struct CameraFields {
    width: u32,
    height: u32,
    fx: f32,
    fy: f32,
    cx: f32,
    cy: f32,
    camera_from_world: Isometry3<f32>,
}
