//! The camera of a request's [`View`].

use super::error::QueryError;
use super::limits::MAX_VIEW_SIDE;
use super::request::View;
use crate::pipeline::frame::rasteriser_camera;
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::Camera;

/// The camera of a view. A tracked frame's is the one that took it, at the frame's pose.
pub(super) fn of_view(snapshot: &MapSnapshot, view: &View) -> Result<Camera, QueryError> {
    let (intrinsics, world_from_camera) = match view {
        View::Frame(sequence) => snapshot
            .camera(*sequence)
            .zip(snapshot.tracked(*sequence).map(|frame| frame.world_from_camera))
            .ok_or(QueryError::UnknownFrame { sequence: *sequence })?,
        View::Camera { intrinsics, world_from_camera } => (*intrinsics, *world_from_camera),
    };
    check_size("view.camera", intrinsics.width, intrinsics.height)?;
    Ok(rasteriser_camera(&intrinsics, &world_from_camera))
}

/// The camera at a requested size, `(width, height)` in pixels.
pub(super) fn resized(camera: Camera, size: Option<(u32, u32)>) -> Result<Camera, QueryError> {
    let Some((width, height)) = size else { return Ok(camera) };
    check_size("size", width, height)?;
    Ok(camera.resized(width, height))
}

/// The camera at no more than `columns` columns, with the same aspect ratio.
pub(super) fn narrowed(camera: &Camera, columns: u32) -> Camera {
    let width = camera.width.min(columns);
    let height = (camera.height as f32 * width as f32 / camera.width as f32).round().max(1.0);
    camera.resized(width, height as u32)
}

fn check_size(field: &'static str, width: u32, height: u32) -> Result<(), QueryError> {
    let fits = |side: u32| (1..=MAX_VIEW_SIDE).contains(&side);
    if fits(width) && fits(height) {
        return Ok(());
    }
    Err(QueryError::BadSize { field, limit: MAX_VIEW_SIDE, width, height })
}
