//! Views: a tracked frame, or a camera with a pose.

use super::camera;
use super::refusal::Refusal;
use crate::pipeline::frame::Intrinsics;
use crate::pipeline::query::{MAX_VIEW_SIDE, View};
use lexsplat_proto::{json, v1};

/// Checks the view of a gRPC query; `None` if there is none.
///
/// # Errors
/// [`Refusal`] names the field.
pub(super) fn from_wire(wire: Option<v1::View>, max_pixels: u64) -> Result<Option<View>, Refusal> {
    let camera = match wire.and_then(|view| view.view) {
        None => return Ok(None),
        Some(v1::view::View::Frame(sequence)) => return Ok(Some(View::Frame(sequence))),
        Some(v1::view::View::Camera(camera)) => camera,
    };
    let missing = |part: &str| Refusal::new(format!("view.camera.{part}"), "missing");
    let intrinsics = camera.intrinsics.ok_or_else(|| missing("intrinsics"))?;
    let pose = camera.world_from_camera.ok_or_else(|| missing("world_from_camera"))?;
    Ok(Some(View::Camera {
        intrinsics: camera::from_wire("view.camera.intrinsics", &intrinsics, max_pixels)?,
        world_from_camera: camera::pose_from_wire("view.camera.world_from_camera", &pose)?,
    }))
}

/// Checks a view in JSON. `prefix` is put before the names of its fields: "view." or nothing.
///
/// # Errors
/// [`Refusal`] names the field.
pub(super) fn from_json(view: json::View, prefix: &str, max_pixels: u64) -> Result<View, Refusal> {
    let field = |name: &str| format!("{prefix}{name}");
    match (view.frame, view.camera, view.world_from_camera) {
        (Some(sequence), None, None) => Ok(View::Frame(sequence)),
        (None, Some(camera), Some(pose)) => {
            let json::Camera { width, height, fx, fy, cx, cy } = camera;
            let intrinsics = Intrinsics { width, height, fx, fy, cx, cy };
            side(&field("camera.width"), width)?;
            side(&field("camera.height"), height)?;
            Ok(View::Camera {
                intrinsics: camera::intrinsics(&field("camera"), intrinsics, max_pixels)?,
                world_from_camera: camera::pose_from_matrix(&field("world_from_camera"), &pose)?,
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

/// Checks the width or height of a rendered image.
///
/// # Errors
/// [`Refusal`] names `field`.
pub(super) fn side(field: &str, pixels: u32) -> Result<(), Refusal> {
    match pixels {
        1..=MAX_VIEW_SIDE => Ok(()),
        found => {
            Err(Refusal::new(field, format!("expected 1 to {MAX_VIEW_SIDE} pixels, found {found}")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};

    fn camera() -> json::Camera {
        json::Camera { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5 }
    }

    fn field(view: json::View) -> String {
        from_json(view, "view.", 1 << 20).err().map(|refusal| refusal.field).unwrap_or_default()
    }

    #[test]
    fn a_view_is_a_frame_or_a_camera_with_a_pose() {
        let pose = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.0, 0.4, 0.0));
        let rows = pose.to_homogeneous().transpose().as_slice().to_vec();
        let view = || json::View {
            frame: None,
            camera: Some(camera()),
            world_from_camera: Some(rows.clone()),
        };
        let View::Camera { intrinsics, world_from_camera } =
            from_json(view(), "", 1 << 20).unwrap()
        else {
            panic!("a camera was given");
        };
        assert_eq!(intrinsics.width, 64);
        assert!((world_from_camera.to_homogeneous() - pose.to_homogeneous()).amax() < 1e-12);
        assert_eq!(field(json::View::of_frame(3)), "");
        assert_eq!(field(json::View { frame: Some(3), ..view() }), "view.frame");
        assert_eq!(field(json::View::default()), "view.frame");
        assert_eq!(field(json::View { camera: None, ..view() }), "view.camera");
        let without_pose = json::View { world_from_camera: None, ..view() };
        assert_eq!(field(without_pose), "view.world_from_camera");
        let wide = json::Camera { width: 100_000, ..camera() };
        assert_eq!(field(json::View { camera: Some(wide), ..view() }), "view.camera.width");
        let flat = json::Camera { fx: 0.0, ..camera() };
        assert_eq!(field(json::View { camera: Some(flat), ..view() }), "view.camera.fx");
    }
}
