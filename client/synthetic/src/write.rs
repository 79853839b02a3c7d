//! Writes a synthetic room as a folder in Replica layout: `results/frame%06d.jpg`,
//! `results/depth%06d.png` (16 bit, 6553.5 per metre), `semantic/%06d.png` (instance ids),
//! `instances.json`, `traj.txt` (world_from_camera, 4x4 row-major per line), `cam_params.json`.

use crate::camera::{Camera, View};
use crate::room::Room;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageError};
use nalgebra::Isometry3;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Depth units per metre in the folders written here.
pub const DEPTH_SCALE: f64 = 6553.5;
const JPEG_QUALITY: u8 = 95;

/// The folder to write.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Seed of the room.
    pub seed: u64,
    /// Number of frames of the walk.
    pub frames: usize,
    /// Every N-th frame of the walk is rendered.
    pub every: usize,
    /// The camera of every frame.
    pub camera: Camera,
}

/// A folder that could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// A file cannot be written.
    #[error("cannot write {path}", path = path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// An image cannot be encoded.
    #[error("cannot encode a frame")]
    Encode(#[from] ImageError),
}

/// Renders and writes the walk; calls `progress` with the number of frames written so far.
///
/// # Errors
/// [`WriteError`] if a file cannot be written or an image cannot be encoded.
pub fn write(dir: &Path, plan: &Plan, mut progress: impl FnMut(usize)) -> Result<(), WriteError> {
    let room = Room::new(plan.seed);
    for folder in ["results", "semantic"] {
        let path = dir.join(folder);
        std::fs::create_dir_all(&path).map_err(|source| WriteError::File { path, source })?;
    }
    put(&dir.join("instances.json"), instances_json(&room).to_string().as_bytes())?;
    let c = plan.camera;
    let camera = json!({"camera": {"w": c.width, "h": c.height, "fx": c.fx, "fy": c.fy,
        "cx": c.cx, "cy": c.cy, "scale": DEPTH_SCALE}});
    put(&dir.join("cam_params.json"), camera.to_string().as_bytes())?;
    let poses: Vec<_> = room.path(plan.frames).into_iter().step_by(plan.every.max(1)).collect();
    let trajectory: String = poses.iter().map(|pose| matrix_line(pose) + "\n").collect();
    put(&dir.join("traj.txt"), trajectory.as_bytes())?;
    for (i, pose) in poses.iter().enumerate() {
        let view = room.render(&plan.camera, pose);
        put(&dir.join(format!("results/frame{i:06}.jpg")), &jpeg(&view)?)?;
        put(&dir.join(format!("results/depth{i:06}.png")), &depth_png(&view)?)?;
        put(&dir.join(format!("semantic/{i:06}.png")), &mask_png(&view)?)?;
        progress(i + 1);
    }
    Ok(())
}

fn put(path: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    std::fs::write(path, bytes)
        .map_err(|source| WriteError::File { path: path.to_path_buf(), source })
}

/// `world_from_camera` as sixteen numbers, row by row.
fn matrix_line(pose: &Isometry3<f64>) -> String {
    let m = pose.to_homogeneous();
    let numbers: Vec<String> = (0..16).map(|i| format!("{:.9}", m[(i / 4, i % 4)])).collect();
    numbers.join(" ")
}

fn instances_json(room: &Room) -> serde_json::Value {
    room.instances()
        .iter()
        .map(|i| {
            json!({"id": i.id, "name": i.name, "class": i.class,
                "aabb_min": i.aabb_min, "aabb_max": i.aabb_max})
        })
        .collect()
}

/// The color image of a view as JPEG.
///
/// # Errors
/// If the encoder fails.
pub fn jpeg(view: &View) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).write_image(
        &view.rgb,
        view.width,
        view.height,
        ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}

/// The depth of a view as 16-bit PNG, 6553.5 units per metre.
///
/// # Errors
/// If the encoder fails.
pub fn depth_png(view: &View) -> Result<Vec<u8>, ImageError> {
    // The encoder takes samples in native byte order.
    let units = |d: &f32| (f64::from(*d) * DEPTH_SCALE).round().clamp(0.0, 65535.0) as u16;
    let samples: Vec<u8> = view.depth.iter().flat_map(|d| units(d).to_ne_bytes()).collect();
    png(view, &samples, ExtendedColorType::L16)
}

/// The instance ids of a view as 8-bit PNG.
///
/// # Errors
/// If the encoder fails.
pub fn mask_png(view: &View) -> Result<Vec<u8>, ImageError> {
    png(view, &view.instances, ExtendedColorType::L8)
}

fn png(view: &View, samples: &[u8], kind: ExtendedColorType) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive)
        .write_image(samples, view.width, view.height, kind)?;
    Ok(bytes)
}
