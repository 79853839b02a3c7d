//! Cameras and poses in JSON: `{"frame": N}` or `{"camera": {…}, "world_from_camera": [16 numbers]}`.

use crate::ingest::convert::{Refusal, camera};
use crate::pipeline::frame::Intrinsics;
use crate::pipeline::query::{MAX_VIEW_SIDE, View};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Pinhole intrinsics, pixels; the centre of the top-left pixel is (0, 0).
#[derive(Debug, Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Camera {
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
}

impl From<Intrinsics> for Camera {
    fn from(intrinsics: Intrinsics) -> Self {
        let Intrinsics { width, height, fx, fy, cx, cy } = intrinsics;
        Self { width, height, fx, fy, cx, cy }
    }
}

/// A view as it came: `frame`, or `camera` and `world_from_camera`.
#[derive(Debug, Default, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub(super) struct WireView {
    /// The sequence of a tracked frame.
    pub(super) frame: Option<u64>,
    /// Any camera …
    pub(super) camera: Option<Camera>,
    /// … and its pose: 16 numbers, row-major 4x4, metres.
    pub(super) world_from_camera: Option<Vec<f64>>,
}

impl WireView {
    /// Checks it; `prefix` is what its fields' names begin with: "view." or nothing.
    ///
    /// # Errors
    /// [`Refusal`] names the field.
    pub(super) fn checked(self, prefix: &str, max_pixels: u64) -> Result<View, Refusal> {
        let field = |name: &str| format!("{prefix}{name}");
        match (self.frame, self.camera, self.world_from_camera) {
            (Some(sequence), None, None) => Ok(View::Frame(sequence)),
            (None, Some(wire), Some(pose)) => {
                let Camera { width, height, fx, fy, cx, cy } = wire;
                let intrinsics = Intrinsics { width, height, fx, fy, cx, cy };
                side(&field("camera.width"), width)?;
                side(&field("camera.height"), height)?;
                Ok(View::Camera {
                    intrinsics: camera::intrinsics(&field("camera"), intrinsics, max_pixels)?,
                    world_from_camera: camera::pose_from_matrix(
                        &field("world_from_camera"),
                        &pose,
                    )?,
                })
            }
            (None, Some(_), None) => {
                Err(Refusal::new(field("world_from_camera"), "missing beside camera"))
            }
            (None, None, Some(_)) => {
                Err(Refusal::new(field("camera"), "missing beside world_from_camera"))
            }
            _ => Err(Refusal::new(
                field("frame"),
                "expected either frame, or camera and world_from_camera",
            )),
        }
    }
}

/// Checks a picture's side.
///
/// # Errors
/// [`Refusal`].
pub(super) fn side(field: &str, pixels: u32) -> Result<(), Refusal> {
    match pixels {
        1..=MAX_VIEW_SIDE => Ok(()),
        found => {
            Err(Refusal::new(field, format!("expected 1 to {MAX_VIEW_SIDE} pixels, found {found}")))
        }
    }
}

/// A transform as 16 numbers, row-major.
pub(super) fn rows(transform: &Isometry3<f64>) -> [f64; 16] {
    let matrix = transform.to_homogeneous();
    std::array::from_fn(|at| matrix[(at / 4, at % 4)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn camera() -> Camera {
        Camera { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5 }
    }

    fn field(view: WireView) -> String {
        view.checked("view.", 1 << 20).err().map(|refusal| refusal.field).unwrap_or_default()
    }

    #[test]
    fn a_view_is_a_frame_or_a_camera_with_a_pose() {
        let pose = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.0, 0.4, 0.0));
        let view = || WireView {
            frame: None,
            camera: Some(camera()),
            world_from_camera: Some(rows(&pose).to_vec()),
        };
        let View::Camera { intrinsics, world_from_camera } = view().checked("", 1 << 20).unwrap()
        else {
            panic!("a camera was given");
        };
        assert_eq!(intrinsics.width, 64);
        assert!((world_from_camera.to_homogeneous() - pose.to_homogeneous()).amax() < 1e-12);
        assert_eq!(field(WireView { frame: Some(3), ..WireView::default() }), "");
        assert_eq!(field(WireView { frame: Some(3), ..view() }), "view.frame");
        assert_eq!(field(WireView::default()), "view.frame");
        assert_eq!(field(WireView { camera: None, ..view() }), "view.camera");
        assert_eq!(field(WireView { world_from_camera: None, ..view() }), "view.world_from_camera");
        let wide = Camera { width: 100_000, ..camera() };
        assert_eq!(field(WireView { camera: Some(wide), ..view() }), "view.camera.width");
        let wide = Camera { fx: 0.0, ..camera() };
        assert_eq!(field(WireView { camera: Some(wide), ..view() }), "view.camera.fx");
    }
}
