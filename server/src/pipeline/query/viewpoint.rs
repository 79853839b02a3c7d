//! Where a request looks from: its [`View`] as a camera of the rasteriser.

use super::QueryError;
use super::request::{MAX_VIEW_SIDE, View};
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::Camera;

/// The view's camera; a tracked frame's is the stream's camera at the frame's pose.
pub(super) fn camera(snapshot: &MapSnapshot, view: &View) -> Result<Camera, QueryError> {
    let (intrinsics, world_from_camera) = match view {
        View::Frame(sequence) => snapshot
            .intrinsics
            .zip(snapshot.tracked(*sequence).map(|frame| frame.world_from_camera))
            .ok_or(QueryError::UnknownFrame { sequence: *sequence })?,
        View::Camera { intrinsics, world_from_camera } => (*intrinsics, *world_from_camera),
    };
    check_size("view.camera", intrinsics.width, intrinsics.height)?;
    Ok(intrinsics.camera(&world_from_camera))
}

/// The same view in another size.
pub(super) fn resized(camera: Camera, size: Option<(u32, u32)>) -> Result<Camera, QueryError> {
    let Some((width, height)) = size else { return Ok(camera) };
    check_size("size", width, height)?;
    Ok(camera.resized(width, height))
}

fn check_size(field: &'static str, width: u32, height: u32) -> Result<(), QueryError> {
    let fits = |side: u32| (1..=MAX_VIEW_SIDE).contains(&side);
    if fits(width) && fits(height) {
        return Ok(());
    }
    Err(QueryError::BadSize { field, limit: MAX_VIEW_SIDE, width, height })
}
