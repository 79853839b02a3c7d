//! Builds a mesh on a thread of its own.

use super::depth_view::{self, DepthView};
use super::surface;
use super::triangles::Mesh;
use super::tsdf::{Full, Tsdf};
use super::vertex_codes::VertexCodes;
use crate::pipeline::backdrop;
use crate::pipeline::query::error::QueryError;
use crate::pipeline::query::limits::VOXEL_METRES;
use crate::pipeline::query::render::Scene;
use crate::pipeline::snapshot::{KeyframeInfo, MapSnapshot};
use lexsplat_gpu::Gpu;
use std::sync::Arc;
use std::time::Instant;
use tokio::sync::oneshot;

/// Memory for the TSDF, MiB.
const TSDF_MIB: usize = 768;
/// The most keyframes that are fused. Of more, a regular subset is used.
const MAX_VIEWS: usize = 240;

/// Builds the mesh of a snapshot on a thread of its own. Dropping the future stops it at the next
/// view.
///
/// # Errors
/// [`QueryError::BadVoxel`]; [`QueryError::MeshTooLarge`] if the surfaces do not fit into memory;
/// or the error of the renderer or the thread.
pub(crate) async fn mesh(
    gpu: Gpu,
    snapshot: Arc<MapSnapshot>,
    voxel_metres: f32,
) -> Result<Mesh, QueryError> {
    if !VOXEL_METRES.contains(&voxel_metres) {
        return Err(QueryError::BadVoxel { found: voxel_metres });
    }
    let (reply, built) = oneshot::channel();
    let name = format!("mesh {}", snapshot.map);
    let work = move || {
        let mesh = build(gpu, &snapshot, voxel_metres, || !reply.is_closed());
        // The receiver may have been dropped.
        drop(reply.send(mesh));
    };
    std::thread::Builder::new().name(name).spawn(work).map_err(QueryError::Thread)?;
    built.await.map_err(|_| QueryError::Stopped)?
}

/// Builds the mesh. `is_wanted` is called between views; false stops the work.
fn build(
    gpu: Gpu,
    snapshot: &MapSnapshot,
    voxel_metres: f32,
    is_wanted: impl Fn() -> bool,
) -> Result<Mesh, QueryError> {
    let since = Instant::now();
    let gaussians = Arc::new(backdrop::without(&snapshot.gaussians));
    let snapshot = &MapSnapshot { gaussians, evidence: Arc::default(), ..snapshot.clone() };
    let mut scene = Scene::new(gpu);
    let mut tsdf = Tsdf::new(voxel_metres, TSDF_MIB << 20);
    let views = fuse(&mut scene, snapshot, &mut tsdf, &is_wanted)?;
    let mut mesh = surface::extract(&tsdf);
    drop(tsdf);
    mesh.code_size = snapshot.online.code_size();
    mesh.codes = average_codes(&mut scene, snapshot, &mesh, &views, voxel_metres, &is_wanted)?;
    let (vertices, triangles) = (mesh.positions.len(), mesh.faces.len());
    let seconds = since.elapsed().as_secs_f32();
    tracing::info!(map = snapshot.map, vertices, triangles, voxel_metres, seconds, "mesh built");
    Ok(mesh)
}

/// Renders the keyframes and fuses their depths and colors. Returns the views without colors.
fn fuse(
    scene: &mut Scene,
    snapshot: &MapSnapshot,
    tsdf: &mut Tsdf,
    is_wanted: &impl Fn() -> bool,
) -> Result<Vec<DepthView>, QueryError> {
    let stride = snapshot.keyframes.len().div_ceil(MAX_VIEWS).max(1);
    let keyframes: Vec<&KeyframeInfo> = snapshot.keyframes.iter().step_by(stride).collect();
    let mut progress = Progress::new(&snapshot.map, "fusing", keyframes.len());
    let mut views = Vec::with_capacity(keyframes.len());
    for (at, keyframe) in keyframes.into_iter().enumerate() {
        if !is_wanted() {
            return Err(QueryError::Stopped);
        }
        let mut view = depth_view::render(scene, snapshot, keyframe, tsdf.truncation_metres())?;
        tsdf.integrate(&view).map_err(|Full| QueryError::MeshTooLarge {
            voxel_metres: tsdf.voxel_metres(),
            limit_mib: TSDF_MIB,
        })?;
        // Only the depths are used again, for occlusion.
        view.rgb = Vec::new();
        views.push(view);
        progress.log(at + 1);
    }
    Ok(views)
}

/// Mean codes of the vertices over the views that see them, `[vertices * code_size]`.
fn average_codes(
    scene: &mut Scene,
    snapshot: &MapSnapshot,
    mesh: &Mesh,
    views: &[DepthView],
    voxel_metres: f32,
    is_wanted: &impl Fn() -> bool,
) -> Result<Vec<f32>, QueryError> {
    let mut progress = Progress::new(&snapshot.map, "averaging codes", views.len());
    let mut codes = VertexCodes::new(&mesh.positions, snapshot.online.code_size());
    for (at, view) in views.iter().enumerate() {
        if !is_wanted() {
            return Err(QueryError::Stopped);
        }
        codes.add(view, &scene.language(snapshot, &view.camera)?, voxel_metres);
        progress.log(at + 1);
    }
    Ok(codes.means())
}

/// Logs the progress in steps of a tenth.
struct Progress<'a> {
    map: &'a str,
    step: &'static str,
    of: usize,
    logged_tenths: usize,
}

impl<'a> Progress<'a> {
    fn new(map: &'a str, step: &'static str, of: usize) -> Self {
        Self { map, step, of, logged_tenths: 0 }
    }

    fn log(&mut self, done: usize) {
        let tenths = done * 10 / self.of.max(1);
        if tenths > self.logged_tenths {
            self.logged_tenths = tenths;
            tracing::info!(map = self.map, done, of = self.of, "mesh: {}", self.step);
        }
    }
}
