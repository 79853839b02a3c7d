//! A map as a triangle mesh with colors and language (the paper's 3D protocol, §5: rendered maps of
//! the keyframes are fused into a TSDF, marching cubes finds the surface).
//!
//! In: a snapshot. Out: a [`Mesh`] in the map's world, metres. Depth and color are fused in space; codes
//! are averaged at the finished vertices from the views that see them, which is the same mean where
//! the surface is, in a fifth of the memory. Runs on a thread and a renderer of its own, so that neither
//! the mapper nor questions wait for it.

mod cases;
mod paint;
mod surface;
mod volume;

use super::scene::Scene;
use super::{QueryError, picture};
use crate::pipeline::backdrop;
use crate::pipeline::snapshot::{KeyframeInfo, MapSnapshot};
use lexsplat_gpu::{Camera, Gpu};
use nalgebra::{Point3, Vector3};
use std::sync::Arc;
use std::time::Instant;
use tokio::sync::oneshot;
use volume::Volume;

/// Side of a voxel if the asker does not say, metres: that of the paper's code (its text has 20 cm).
pub const DEFAULT_VOXEL_METRES: f32 = 0.02;
/// The sides that a voxel may have, metres.
pub const VOXEL_METRES: std::ops::RangeInclusive<f32> = 0.002..=1.0;
/// Memory for the field.
const VOLUME_MIB: usize = 768;
/// Columns at which keyframes are rendered: about a voxel per pixel in a room.
const COLUMNS: u32 = 320;
/// Keyframes that are fused; of more, every so many.
const MOST_VIEWS: usize = 240;
/// What is farther is left out: depths there are coarser than voxels.
const MOST_METRES: f32 = 12.0;
/// Opacity of what a pixel shows below which its depth is not trusted.
const LEAST_OPACITY: f32 = 0.8;

/// Triangles with colors and language.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Metres, in the map's world.
    pub positions: Vec<Point3<f32>>,
    /// Unit length, towards free space.
    pub normals: Vec<Vector3<f32>>,
    /// 0..1.
    pub colors: Vec<[f32; 3]>,
    /// Mean codes of the online stage, `[vertices * code_size]`; zeros where no view has language.
    pub codes: Vec<f32>,
    /// Length of a code.
    pub code_size: usize,
    /// Relevancies to a question, `[vertices]`; empty if none was asked.
    pub relevancies: Vec<f32>,
    /// Vertices of the triangles, counter-clockwise from outside.
    pub faces: Vec<[u32; 3]>,
}

/// What a keyframe shows of the map.
struct View {
    camera: Camera,
    /// `[height * width]`, metres; 0: nothing, or not trusted.
    depth: Vec<f32>,
    /// `[height * width * 3]`.
    rgb: Vec<f32>,
}

impl View {
    /// The pixel that a point of the camera falls into.
    fn pixel(&self, point: &Point3<f32>) -> Option<usize> {
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

/// Checks the side of a voxel, metres.
///
/// # Errors
/// [`QueryError::BadVoxel`].
pub fn checked_voxel(metres: f32) -> Result<f32, QueryError> {
    if VOXEL_METRES.contains(&metres) {
        Ok(metres)
    } else {
        Err(QueryError::BadVoxel { found: metres })
    }
}

/// Builds the mesh on a thread of its own; dropping the future ends that at the next view.
///
/// # Errors
/// [`QueryError::BadVoxel`], [`QueryError::MeshTooLarge`] if the surfaces do not fit into memory, or
/// what failed.
pub async fn mesh(
    gpu: Gpu,
    snapshot: Arc<MapSnapshot>,
    voxel_metres: f32,
) -> Result<Mesh, QueryError> {
    checked_voxel(voxel_metres)?;
    let (reply, built) = oneshot::channel();
    let name = format!("mesh {}", snapshot.map);
    let work = move || {
        let mesh = build(gpu, &snapshot, voxel_metres, || !reply.is_closed());
        // Whoever asked may have gone away.
        drop(reply.send(mesh));
    };
    std::thread::Builder::new().name(name).spawn(work).map_err(QueryError::Thread)?;
    built.await.map_err(|_| QueryError::Stopped)?
}

/// `wanted` is asked between views: false gives up.
fn build(
    gpu: Gpu,
    snapshot: &MapSnapshot,
    voxel_metres: f32,
    wanted: impl Fn() -> bool,
) -> Result<Mesh, QueryError> {
    let since = Instant::now();
    let gaussians = Arc::new(backdrop::without(&snapshot.gaussians));
    let snapshot = &MapSnapshot { gaussians, ..snapshot.clone() };
    let mut scene = Scene::new(gpu);
    let mut volume = Volume::new(voxel_metres, VOLUME_MIB << 20);
    let stride = snapshot.keyframes.len().div_ceil(MOST_VIEWS).max(1);
    let keyframes: Vec<&KeyframeInfo> = snapshot.keyframes.iter().step_by(stride).collect();
    let mut views = Vec::with_capacity(keyframes.len());
    let mut progress =
        Progress { map: &snapshot.map, what: "fusing", of: keyframes.len(), told: 0 };
    for (done, keyframe) in keyframes.iter().enumerate() {
        if !wanted() {
            return Err(QueryError::Stopped);
        }
        let mut view = render(&mut scene, snapshot, keyframe, volume.truncation_metres())?;
        volume.integrate(&view).map_err(|volume::Full| QueryError::MeshTooLarge {
            voxel_metres,
            limit_mib: VOLUME_MIB,
        })?;
        // Painting needs depths, to know what hides what.
        view.rgb = Vec::new();
        views.push(view);
        progress.tell(done + 1);
    }
    let mut mesh = surface::extract(&volume);
    drop(volume);
    progress = Progress { what: "painting", told: 0, ..progress };
    let mut painter = paint::Painter::new(&mesh, snapshot.online.code_size());
    for (done, view) in views.iter().enumerate() {
        if !wanted() {
            return Err(QueryError::Stopped);
        }
        painter.add(view, &scene.language(snapshot, &view.camera)?, voxel_metres);
        progress.tell(done + 1);
    }
    (mesh.codes, mesh.code_size) = painter.finish();
    let (vertices, triangles) = (mesh.positions.len(), mesh.faces.len());
    let seconds = since.elapsed().as_secs_f32();
    tracing::info!(map = snapshot.map, vertices, triangles, voxel_metres, seconds, "mesh built");
    Ok(mesh)
}

/// Says in the log, every tenth, how far it is.
struct Progress<'a> {
    map: &'a str,
    what: &'static str,
    of: usize,
    told: usize,
}

impl Progress<'_> {
    fn tell(&mut self, done: usize) {
        let tenth = done * 10 / self.of.max(1);
        if tenth > self.told {
            self.told = tenth;
            tracing::info!(map = self.map, done, of = self.of, "mesh: {}", self.what);
        }
    }
}

/// Depth and color of the map from a keyframe.
fn render(
    scene: &mut Scene,
    snapshot: &MapSnapshot,
    keyframe: &KeyframeInfo,
    truncation: f32,
) -> Result<View, QueryError> {
    let camera = keyframe.intrinsics.camera(&keyframe.frame.world_from_camera);
    let width = camera.width.min(COLUMNS);
    let height = (camera.height as f32 * width as f32 / camera.width as f32).round().max(1.0);
    let camera = camera.resized(width, height as u32);
    let image = scene.color(snapshot, &camera)?;
    let depth = picture::depth(&image, LEAST_OPACITY);
    let depth = without_edges(&depth, width as usize, truncation);
    let rgb = image
        .rgb
        .chunks_exact(3)
        .zip(&image.opacity)
        .flat_map(|(rgb, &opacity)| [0, 1, 2].map(|i| rgb[i] / opacity.max(LEAST_OPACITY)))
        .collect();
    Ok(View { camera, depth, rgb })
}

/// Depths without those at depth edges, where blending makes points between two surfaces, and
/// without those far away.
fn without_edges(depth: &[f32], width: usize, truncation: f32) -> Vec<f32> {
    let is_edge = |at: usize| {
        let (here, column) = (depth[at], at % width);
        let differs = |other: usize| depth[other] > 0.0 && (depth[other] - here).abs() > truncation;
        (column > 0 && differs(at - 1))
            || (column + 1 < width && differs(at + 1))
            || (at >= width && differs(at - width))
            || (at + width < depth.len() && differs(at + width))
    };
    (0..depth.len())
        .map(|at| if depth[at] > MOST_METRES || is_edge(at) { 0.0 } else { depth[at] })
        .collect()
}

#[cfg(test)]
mod tests;
