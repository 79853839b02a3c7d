//! Views of the keyframes, rendered from the map.

use crate::pipeline::frame::rasteriser_camera;
use crate::pipeline::query::camera;
use crate::pipeline::query::render::{Scene, depth};
use crate::pipeline::snapshot::{KeyframeInfo, MapSnapshot};
use lexsplat_gpu::{Camera, GpuError};
use nalgebra::Point3;

/// Columns of a view: about one pixel for each voxel of a room.
const COLUMNS: u32 = 320;
/// Farther depths are dropped: they are coarser than the voxels.
const MAX_METRES: f32 = 12.0;
/// Opacity below which the depth of a pixel is unreliable.
const MIN_OPACITY: f32 = 0.8;

/// Depth and color of the map, rendered from a keyframe.
pub(super) struct DepthView {
    pub camera: Camera,
    /// `[height * width]`, metres; 0: no or unreliable depth.
    pub depth: Vec<f32>,
    /// `[height * width * 3]`.
    pub rgb: Vec<f32>,
}

impl DepthView {
    /// Index of the pixel onto which a point in the camera's frame projects.
    pub(super) fn pixel(&self, point: &Point3<f32>) -> Option<usize> {
        let camera = &self.camera;
        if point.z <= 0.0 {
            return None;
        }
        let u = (camera.fx * point.x / point.z + camera.cx).round();
        let v = (camera.fy * point.y / point.z + camera.cy).round();
        let inside =
            (0.0..camera.width as f32).contains(&u) && (0.0..camera.height as f32).contains(&v);
        inside.then(|| v as usize * camera.width as usize + u as usize)
    }
}

/// Renders the map from a keyframe. Neighbouring depths that differ by more than `max_step_metres`
/// are an edge.
pub(super) fn render(
    scene: &mut Scene,
    snapshot: &MapSnapshot,
    keyframe: &KeyframeInfo,
    max_step_metres: f32,
) -> Result<DepthView, GpuError> {
    let camera = rasteriser_camera(&keyframe.intrinsics, &keyframe.frame.world_from_camera);
    let camera = camera::narrowed(&camera, COLUMNS);
    let image = scene.color(snapshot, &camera)?;
    let depth = depth(&image, MIN_OPACITY);
    let depth = without_edges(&depth, camera.width as usize, max_step_metres);
    let rgb = image
        .rgb
        .chunks_exact(3)
        .zip(&image.opacity)
        .flat_map(|(rgb, &opacity)| [0, 1, 2].map(|i| rgb[i] / opacity.max(MIN_OPACITY)))
        .collect();
    Ok(DepthView { camera, depth, rgb })
}

/// Depths without those at depth edges, where blending creates points between two surfaces, and
/// without those far away.
pub(super) fn without_edges(depth: &[f32], width: usize, max_step_metres: f32) -> Vec<f32> {
    let is_edge = |at: usize| {
        let (here, column) = (depth[at], at % width);
        let differs =
            |other: usize| depth[other] > 0.0 && (depth[other] - here).abs() > max_step_metres;
        (column > 0 && differs(at - 1))
            || (column + 1 < width && differs(at + 1))
            || (at >= width && differs(at - width))
            || (at + width < depth.len() && differs(at + width))
    };
    (0..depth.len())
        .map(|at| if depth[at] > MAX_METRES || is_edge(at) { 0.0 } else { depth[at] })
        .collect()
}
