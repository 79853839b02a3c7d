//! Replica layout: `results/frame%06d.jpg` (or `.png`), `results/depth%06d.png`, `traj.txt` (one
//! `world_from_camera` per line, 4x4 row-major; line `n` from 0 is frame `n`), `cam_params.json`
//! (`{"camera":{"w","h","fx","fy","cx","cy","scale"}}`, scale in depth units per metre), and
//! optionally `semantic/%06d.png` (8 or 16 bit, instance ids) with `instances.json`.

use super::error::DatasetError;
use super::files::Size;
use super::frame::{Intrinsics, RgbdFrame, counted_nanos};
use super::source::Dataset;
use super::truth::{Instance, Mask, Truth};
use super::{files, pose};
use nalgebra::Isometry3;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// A folder in Replica layout.
#[derive(Debug)]
pub struct Replica {
    name: String,
    intrinsics: Intrinsics,
    depth_unit_metres: f64,
    frames: Vec<Entry>,
    skipped: Vec<String>,
    labels: Option<Labels>,
}

#[derive(Debug)]
struct Entry {
    sequence: u64,
    color: PathBuf,
    depth: PathBuf,
    world_from_camera: Isometry3<f64>,
}

#[derive(Debug)]
struct Labels {
    folder: PathBuf,
    instances: Vec<Instance>,
    /// Number of each frame.
    sequences: Vec<u64>,
    size: Size,
}

#[derive(Deserialize)]
struct CamParams {
    camera: CameraParams,
}

#[derive(Deserialize)]
struct CameraParams {
    w: u32,
    h: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    scale: f64,
}

impl Replica {
    /// Finds the files and reads camera, poses and instances.
    ///
    /// # Errors
    /// [`DatasetError`] if a file is missing or damaged.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let (intrinsics, depth_unit_metres) = camera(&folder.join("cam_params.json"))?;
        let results = folder.join("results");
        let colors = files::numbered(&results, "frame", &[".jpg", ".png"])?;
        let mut depths = files::numbered(&results, "depth", &[".png"])?;
        let trajectory = folder.join("traj.txt");
        let poses = poses(&trajectory)?;
        let (mut frames, mut skipped) = (Vec::new(), Vec::new());
        for (sequence, color) in colors {
            let Some(depth) = depths.remove(&sequence) else {
                let reason = format!("expected depth{sequence:06}.png beside it, found none");
                return Err(DatasetError::content(&color, reason));
            };
            match usize::try_from(sequence).ok().and_then(|n| poses.get(n)) {
                Some(Ok(pose)) => {
                    frames.push(Entry { sequence, color, depth, world_from_camera: *pose });
                }
                Some(Err(reason)) => skipped.push(reason.clone()),
                None => {
                    let reason = format!(
                        "expected a pose for frame {sequence}, found only {} lines",
                        poses.len()
                    );
                    return Err(DatasetError::content(&trajectory, reason));
                }
            }
        }
        let Some(first) = frames.first() else {
            let reason = "expected frame%06d.jpg with a valid pose, found none";
            return Err(DatasetError::content(&results, reason));
        };
        let size = Size { width: intrinsics.width, height: intrinsics.height };
        files::check_size(&first.color, size)?;
        files::check_size(&first.depth, size)?;
        let sequences = frames.iter().map(|frame| frame.sequence).collect();
        let labels = Labels::open(folder, sequences, size)?;
        let name = files::name_of(folder);
        Ok(Self { name, intrinsics, depth_unit_metres, frames, skipped, labels })
    }
}

fn camera(path: &Path) -> Result<(Intrinsics, f64), DatasetError> {
    let CamParams { camera: c } = serde_json::from_str(&files::text(path)?)
        .map_err(|error| DatasetError::content(path, error.to_string()))?;
    if !(c.scale.is_finite() && c.scale > 0.0) {
        let reason = format!("camera.scale: expected depth units per metre, found {}", c.scale);
        return Err(DatasetError::content(path, reason));
    }
    let intrinsics = Intrinsics { width: c.w, height: c.h, fx: c.fx, fy: c.fy, cx: c.cx, cy: c.cy };
    Ok((intrinsics, 1.0 / c.scale))
}

/// One pose for each line, or the reason why the line has no valid one.
fn poses(path: &Path) -> Result<Vec<Result<Isometry3<f64>, String>>, DatasetError> {
    let text = files::text(path)?;
    let parse = |(number, line): (usize, &str)| {
        let matrix = files::numbers::<16>(line)
            .map_err(|reason| DatasetError::at_line(path, number, reason))?;
        let named = |reason| DatasetError::at_line(path, number, reason).to_string();
        Ok(pose::from_matrix(&matrix).map_err(named))
    };
    files::lines(&text).map(parse).collect()
}

impl Labels {
    fn open(folder: &Path, sequences: Vec<u64>, size: Size) -> Result<Option<Self>, DatasetError> {
        let list = folder.join("instances.json");
        let folder = folder.join("semantic");
        if !list.is_file() || !folder.is_dir() {
            return Ok(None);
        }
        let instances = serde_json::from_str(&files::text(&list)?)
            .map_err(|error| DatasetError::content(&list, error.to_string()))?;
        Ok(Some(Self { folder, instances, sequences, size }))
    }
}

impl Truth for Labels {
    fn instances(&self) -> &[Instance] {
        &self.instances
    }

    fn mask(&self, index: usize) -> Result<Mask, DatasetError> {
        let path = self.folder.join(format!("{:06}.png", self.sequences[index]));
        let Size { width, height } = self.size;
        let ids = match files::picture(&path, &files::bytes(&path)?)? {
            image::DynamicImage::ImageLuma8(ids) if ids.dimensions() == (width, height) => {
                ids.into_raw().into_iter().map(u16::from).collect()
            }
            image::DynamicImage::ImageLuma16(ids) if ids.dimensions() == (width, height) => {
                ids.into_raw()
            }
            other => {
                let reason = format!(
                    "expected {} grey pixels of 8 or 16 bits, found {}x{} {:?}",
                    self.size,
                    other.width(),
                    other.height(),
                    other.color()
                );
                return Err(DatasetError::content(&path, reason));
            }
        };
        Ok(Mask { width, height, ids })
    }
}

impl Dataset for Replica {
    fn name(&self) -> &str {
        &self.name
    }

    fn len(&self) -> usize {
        self.frames.len()
    }

    fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    fn depth_unit_metres(&self) -> f64 {
        self.depth_unit_metres
    }

    fn sequence(&self, index: usize) -> u64 {
        self.frames[index].sequence
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        let entry = &self.frames[index];
        Ok(RgbdFrame {
            sequence: entry.sequence,
            timestamp_nanos: counted_nanos(entry.sequence),
            color: files::color(&entry.color)?,
            depth: files::depth(&entry.depth)?,
            world_from_camera: Some(entry.world_from_camera),
        })
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }

    fn truth(&self) -> Option<&dyn Truth> {
        self.labels.as_ref().map(|labels| labels as &dyn Truth)
    }
}
