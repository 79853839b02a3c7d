//! Replica layout: `results/frame%06d.jpg` (or `.jpeg`, `.png`), `results/depth%06d.png`, `traj.txt` (one
//! `world_from_camera` per line, 4x4 row-major; line `n` from 0 is frame `n`), `cam_params.json`
//! (`{"camera":{"w","h","fx","fy","cx","cy","scale"}}`, scale in depth units per metre) in the folder or in
//! the one above it, and optionally `semantic/%06d.png` (8 or 16 bit, instance ids) with `instances.json`.

use super::error::DatasetError;
use super::files::Size;
use super::frame::{FrameRate, Intrinsics, counted_nanos};
use super::layer::Layer;
use super::numbered::{self, Pattern};
use super::picture_files::{FrameFiles, PictureFiles};
use super::recording::{MaybePose, Recording, Shot};
use super::source::Dataset;
use super::truth::{Instance, Mask, Truth};
use super::{files, name, pose, text};
use serde::Deserialize;
use std::path::{Path, PathBuf};

const COLOR: Pattern = Pattern { before: "frame", between: "", extensions: numbered::COLOR };
const DEPTH: Pattern = Pattern { before: "depth", between: "", extensions: numbered::DEPTH };

/// A folder in Replica layout.
#[derive(Debug)]
pub struct Replica {
    recording: Recording,
    labels: Option<Labels>,
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
    #[serde(deserialize_with = "text::whole_number")]
    w: u32,
    #[serde(deserialize_with = "text::whole_number")]
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
    /// [`DatasetError`] if the camera is missing or damaged, or no frame is there.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let parameters = parameters(folder);
        let (intrinsics, depth_unit_metres) = camera(&parameters)?;
        let results = folder.join("results");
        let numbered::Pairs { frames: pairs, skipped } = numbered::pairs(&results, &COLOR, &DEPTH)?;
        let poses = Poses::read(folder.join("traj.txt"))?;
        let entry = |(sequence, color, depth)| {
            let (nanos, world_from_camera) = (counted_nanos(sequence), poses.of(sequence));
            let shot = Shot::new(sequence, nanos, world_from_camera);
            (shot, FrameFiles::new(color, depth))
        };
        let (shots, files): (Vec<Shot>, Vec<FrameFiles>) = pairs.into_iter().map(entry).unzip();
        let Some(first) = files.first().cloned() else {
            let expected = "expected frame%06d.jpg and depth%06d.png, found none";
            return Err(DatasetError::no_frames(&results, expected, &skipped));
        };
        let pictures = PictureFiles::plain(files);
        let (found, Intrinsics { width, height, .. }) = (pictures.size()?, intrinsics);
        let size = Size { width, height };
        if found != size {
            let reason = format!("expected {size} pixels as in cam_params.json, found {found}");
            return Err(DatasetError::content(&first.color, reason));
        }
        let sequences = shots.iter().map(|shot| shot.sequence).collect();
        let labels = Labels::open(folder, sequences, size)?;
        let (name, notes) = (name::of(folder), Vec::new());
        let (cameras, pictures) = (intrinsics.into(), Box::new(pictures));
        let recording =
            Recording { name, cameras, depth_unit_metres, shots, pictures, skipped, notes };
        Ok(Self { recording, labels })
    }

    /// The same frames at other times: the layout has none.
    #[must_use]
    pub fn at_rate(mut self, rate: FrameRate) -> Self {
        self.recording.count_times(rate);
        self
    }
}

/// `cam_params.json` of the folder, or the one beside it that several scenes share.
fn parameters(folder: &Path) -> PathBuf {
    let (own, shared) = (folder.join("cam_params.json"), folder.join("../cam_params.json"));
    if !own.is_file() && shared.is_file() { shared } else { own }
}

fn camera(path: &Path) -> Result<(Intrinsics, f64), DatasetError> {
    let CamParams { camera: c } = files::json(path)?;
    if !(c.scale.is_finite() && c.scale > 0.0) {
        let reason = format!("camera.scale: expected depth units per metre, found {}", c.scale);
        return Err(DatasetError::content(path, reason));
    }
    let intrinsics = Intrinsics { width: c.w, height: c.h, fx: c.fx, fy: c.fy, cx: c.cx, cy: c.cy };
    Ok((intrinsics, 1.0 / c.scale))
}

/// The poses of `traj.txt`, one a line.
struct Poses {
    path: PathBuf,
    /// `None` without a file.
    lines: Option<Vec<MaybePose>>,
}

impl Poses {
    fn read(path: PathBuf) -> Result<Self, DatasetError> {
        if !path.is_file() {
            return Ok(Self { path, lines: None });
        }
        let lines = Some(pose::lines(&path)?);
        Ok(Self { path, lines })
    }

    /// The pose of a frame: line `n` from 0 is frame `n`.
    fn of(&self, sequence: u64) -> MaybePose {
        let missing = |reason: String| Err(DatasetError::content(&self.path, reason).to_string());
        let Some(lines) = &self.lines else { return missing("there is no such file".into()) };
        let at = usize::try_from(sequence).ok();
        at.and_then(|at| lines.get(at)).cloned().unwrap_or_else(|| {
            missing(format!(
                "expected a pose for frame {sequence}, found only {} lines",
                lines.len()
            ))
        })
    }
}

impl Labels {
    fn open(folder: &Path, sequences: Vec<u64>, size: Size) -> Result<Option<Self>, DatasetError> {
        let list = folder.join("instances.json");
        let folder = folder.join("semantic");
        if !list.is_file() || !folder.is_dir() {
            return Ok(None);
        }
        let instances = files::json(&list)?;
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

impl Layer for Replica {
    fn below(&self) -> &dyn Dataset {
        &self.recording
    }

    fn truth(&self) -> Option<&dyn Truth> {
        self.labels.as_ref().map(|labels| labels as &dyn Truth)
    }
}
