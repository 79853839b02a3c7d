//! Nerfstudio layout with depth, as Polycam, Record3D and `ns-process-data` write it: `transforms.json` with
//! the camera (`w`, `h`, `fl_x`, `fl_y`, `cx`, `cy`) and `frames`, each with `file_path`, `depth_file_path`
//! (16-bit PNG, millimetres) and `transform_matrix`, `world_from_camera` with camera axes x right, y up, z
//! back. Depth of another size is enlarged to color's by its nearest pixels, as nerfstudio does. Frames come in
//! the order of their names; a frame's number is its place in it.

use super::error::DatasetError;
use super::files;
use super::frame::{Depth, DepthFormat, Intrinsics, RgbdFrame, counted_nanos};
use super::layer::Layer;
use super::name;
use super::natural::natural_order;
use super::pose;
use super::recording::{self, Entry, MaybePose, Recording};
use super::source::Dataset;
use image::imageops::{FilterType, resize};
use image::{DynamicImage, ImageFormat};
use serde::Deserialize;
use std::io::Cursor;
use std::path::{Path, PathBuf};

const LIST: &str = "transforms.json";
const DEPTH_UNIT_METRES: f64 = 0.001;
/// Nerfstudio has the centre of the top-left pixel at (0.5, 0.5).
const CENTRE: f64 = 0.5;
/// Cameras with straight lenses, up to a distortion that is told of.
const MODELS: [&str; 4] = ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE"];
/// Focal lengths of frames that differ by more than this share are told of.
const NOTED_SHARE: f64 = 0.002;
/// Extensions of pictures whose name has none in the list.
const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// A folder in nerfstudio layout.
#[derive(Debug)]
pub struct Nerfstudio {
    recording: Recording,
}

#[derive(Deserialize)]
struct Transforms {
    camera_model: Option<String>,
    #[serde(flatten)]
    lens: Lens,
    frames: Vec<Listed>,
}

#[derive(Deserialize)]
struct Listed {
    file_path: String,
    depth_file_path: Option<String>,
    transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    lens: Lens,
}

/// What the whole list, or one frame, says of the lens.
#[derive(Clone, Deserialize)]
struct Lens {
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

impl Nerfstudio {
    /// Finds the files and reads camera and poses.
    ///
    /// # Errors
    /// [`DatasetError`] if the list or the camera is missing or damaged, or no frame has depth.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let path = folder.join(LIST);
        let mut list: Transforms = files::json(&path)?;
        let model = list.camera_model.as_deref().unwrap_or(MODELS[0]);
        if !MODELS.contains(&model) {
            let reason =
                format!("camera_model: expected one of {}, found {model}", MODELS.join(", "));
            return Err(DatasetError::content(&path, reason));
        }
        list.frames.sort_by(|a, b| natural_order(&a.file_path, &b.file_path));
        let (mut frames, mut skipped) = (Vec::new(), Vec::new());
        for (sequence, listed) in (0..).zip(&list.frames) {
            let color = picture(folder, &listed.file_path);
            let Some(depth) = &listed.depth_file_path else {
                let reason = "expected depth_file_path in transforms.json, found none";
                skipped.push(DatasetError::content(&color, reason).to_string());
                continue;
            };
            let (nanos, depth) = (counted_nanos(sequence), picture(folder, depth));
            let world_from_camera = pose(&listed.transform_matrix).map_err(|reason| {
                DatasetError::content(&path, format!("{}: {reason}", listed.file_path)).to_string()
            });
            frames.push(Entry { sequence, nanos, color, depth, world_from_camera });
        }
        if frames.is_empty() {
            let expected = "expected frames with depth_file_path, found none";
            return Err(DatasetError::no_frames(&path, expected, &skipped));
        }
        let mut notes = Vec::new();
        let intrinsics = intrinsics(&path, &list, recording::color_size(&frames)?, &mut notes)?;
        let (name, depth_unit_metres) = (name::of(folder), DEPTH_UNIT_METRES);
        let cameras = intrinsics.into();
        let recording = Recording { name, cameras, depth_unit_metres, frames, skipped, notes };
        Ok(Self { recording })
    }
}

/// A file of the list, whose name may lack its extension.
fn picture(folder: &Path, name: &str) -> PathBuf {
    let path = folder.join(name.replace('\\', "/"));
    if path.extension().is_some() || path.is_file() {
        return path;
    }
    let with = |extension: &&str| path.with_extension(extension);
    EXTENSIONS.iter().map(with).find(|path| path.is_file()).unwrap_or(path)
}

/// A pose with camera axes x right, y down, z forward.
fn pose(rows: &[Vec<f64>]) -> MaybePose {
    let numbers: Vec<f64> = rows.concat();
    let mut matrix = [0.0; 16];
    matrix[15] = 1.0;
    if !matches!(numbers.len(), 12 | 16) {
        return Err(format!("expected a transform_matrix of 4x4, found {} numbers", numbers.len()));
    }
    matrix[..numbers.len()].copy_from_slice(&numbers);
    Ok(pose::Axes::OpenGl.to_opencv(&pose::from_matrix(&matrix)?))
}

fn intrinsics(
    path: &Path,
    list: &Transforms,
    size: files::Size,
    notes: &mut Vec<String>,
) -> Result<Intrinsics, DatasetError> {
    let own: Vec<&Lens> = list.frames.iter().map(|frame| &frame.lens).collect();
    let mut number = |field: &str, get: fn(&Lens) -> Option<f64>| {
        let each: Vec<f64> = own.iter().filter_map(|lens| get(lens)).collect();
        let first = get(&list.lens).or(each.first().copied());
        let first =
            first.ok_or_else(|| DatasetError::content(path, format!("missing field {field}")))?;
        let (least, most) = each.iter().fold((first, first), |(a, b), x| (a.min(*x), b.max(*x)));
        if most - least > NOTED_SHARE * first.abs() {
            notes.push(format!(
                "{}: {field} is {least:.1} to {most:.1}, by frame: all are taken to have {first:.1}",
                path.display()
            ));
        }
        Ok::<f64, DatasetError>(first)
    };
    let (fx, fy) =
        (number("fl_x", |lens| lens.fl_x)?, number("fl_y", |lens| lens.fl_y.or(lens.fl_x))?);
    let (cx, cy) = (number("cx", |lens| lens.cx)?, number("cy", |lens| lens.cy)?);
    let bent = |lens: &Lens| {
        let all = [lens.k1, lens.k2, lens.k3, lens.p1, lens.p2];
        all.into_iter().flatten().any(|coefficient| coefficient != 0.0)
    };
    if bent(&list.lens) || own.iter().any(|lens| bent(lens)) {
        notes.push(format!(
            "{}: the distortion is not used: pictures are taken as if the lens were straight; undistort them \
             first if that is too coarse",
            path.display()
        ));
    }
    let (width, height) = (size.width, size.height);
    Ok(Intrinsics { width, height, fx, fy, cx: cx - CENTRE, cy: cy - CENTRE })
}

impl Nerfstudio {
    /// Depth at color's size.
    fn enlarged(&self, entry: &Entry, depth: Depth) -> Result<Depth, DatasetError> {
        let units = match files::picture(&entry.depth, &depth.bytes)? {
            DynamicImage::ImageLuma16(units) => units,
            other => {
                let reason = format!("expected 16-bit grey, found {:?}", other.color());
                return Err(DatasetError::content(&entry.depth, reason));
            }
        };
        let Intrinsics { width, height, .. } = self.recording.intrinsics();
        if units.dimensions() == (width, height) {
            return Ok(depth);
        }
        let mut bytes = Vec::new();
        resize(&units, width, height, FilterType::Nearest)
            .write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png)
            .map_err(|source| DatasetError::Encode { sequence: entry.sequence, source })?;
        Ok(Depth { format: DepthFormat::Png16, bytes })
    }
}

impl Layer for Nerfstudio {
    fn below(&self) -> &dyn Dataset {
        &self.recording
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        let frame = self.recording.frame(index)?;
        let depth = self.enlarged(&self.recording.frames[index], frame.depth)?;
        Ok(RgbdFrame { depth, ..frame })
    }
}
