//! Nerfstudio layout with depth, as Polycam, Record3D and `ns-process-data` write it: `transforms.json` with
//! the camera (`w`, `h`, `fl_x`, `fl_y`, `cx`, `cy`, `k1` …) and `frames`, each with `file_path`,
//! `depth_file_path` and `transform_matrix`, `world_from_camera` with camera axes x right, y up, z back.
//!
//! Depth is 16-bit PNG or `.npy`, of any size, taken through color's lens; its unit is
//! `depth_unit_scale_factor` metres, or a millimetre. A frame may have a camera of its own. Poses that
//! `applied_scale` says were scaled are scaled back. Frames come in the order of their names; a frame's
//! number is its place in it.

use super::error::DatasetError;
use super::files::{self, Size};
use super::frame::{
    Camera, Cameras, DepthCamera, Distortion, FrameExtras, FrameRate, Intrinsics, counted_nanos,
};
use super::layer::Layer;
use super::name;
use super::natural::natural_order;
use super::picture_files::{FrameFiles, PictureFiles};
use super::pose;
use super::prepare::{self, FINE_UNIT_METRES, Preparation};
use super::recording::{MaybePose, Recording, Shot};
use super::root::Root;
use super::source::Dataset;
use serde::Deserialize;
use std::path::{Path, PathBuf};

const LIST: &str = "transforms.json";
const UNIT_METRES: f64 = 0.001;
/// Nerfstudio has the centre of the top-left pixel at (0.5, 0.5).
const CENTRE: f64 = 0.5;
const FISHEYE: &str = "OPENCV_FISHEYE";
/// Models of cameras that are understood.
const MODELS: [&str; 7] =
    ["OPENCV", FISHEYE, "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE", "SIMPLE_RADIAL", "RADIAL"];
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
    depth_unit_scale_factor: Option<f64>,
    applied_scale: Option<f64>,
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
    w: Option<f64>,
    h: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

/// The frames with depth, and why others are left out.
struct Found {
    shots: Vec<Shot>,
    files: Vec<FrameFiles>,
    skipped: Vec<String>,
}

impl Nerfstudio {
    /// Finds the files and reads camera and poses.
    ///
    /// # Errors
    /// [`DatasetError`] if the list or the camera is missing or damaged, or no frame has depth.
    pub fn open(root: impl Into<Root>) -> Result<Self, DatasetError> {
        let root = root.into();
        let folder = root.folder();
        let path = folder.join(LIST);
        let wrong = |reason: String| DatasetError::content(&path, reason);
        let mut list: Transforms = files::json(&path)?;
        list.frames.sort_by(|a, b| natural_order(&a.file_path, &b.file_path));
        let unit = positive("depth_unit_scale_factor", list.depth_unit_scale_factor);
        let unit = unit.map_err(wrong)?;
        let scale = positive("applied_scale", list.applied_scale).map_err(wrong)?.unwrap_or(1.0);
        let Found { mut shots, files, skipped } = list.found(&root, &path, scale)?;
        if shots.is_empty() {
            let expected = "expected frames with depth_file_path, found none";
            return Err(DatasetError::no_frames(&path, expected, &skipped));
        }
        let is_array = files.iter().any(|files| prepare::is_array(&files.depth));
        let mut notes = Vec::new();
        if is_array && unit.is_none() {
            notes.push(format!(
                "{} has no depth_unit_scale_factor: values of depth in .npy files are taken to be millimetres",
                path.display()
            ));
        }
        let stored = unit.unwrap_or(UNIT_METRES);
        let sent = if is_array { FINE_UNIT_METRES } else { stored };
        let preparation = Preparation { scale: stored / sent, ..Preparation::default() };
        let pictures = PictureFiles { frames: files, preparation };
        let [color, depth] = pictures.sizes()?;
        let camera = list.camera(color, &mut notes).map_err(wrong)?;
        for shot in &mut shots {
            let own = &list.frames[shot.sequence as usize].lens;
            shot.extras = own.extras(&list.lens, color, &camera.intrinsics);
        }
        let Size { width, height } = depth;
        let depth = (color != depth).then_some(DepthCamera::SameLens { width, height });
        let cameras = Cameras { color: camera.clone(), depth, ..camera.intrinsics.into() };
        let (name, depth_unit_metres, pictures) = (name::of(folder), sent, Box::new(pictures));
        let recording =
            Recording { name, cameras, depth_unit_metres, shots, pictures, skipped, notes };
        Ok(Self { recording })
    }

    /// The same frames at other times: the layout has none.
    #[must_use]
    pub fn at_rate(mut self, rate: FrameRate) -> Self {
        self.recording.count_times(rate);
        self
    }
}

fn positive(key: &str, value: Option<f64>) -> Result<Option<f64>, String> {
    match value {
        Some(value) if !(value.is_finite() && value > 0.0) => {
            Err(format!("{key}: expected more than 0, found {value}"))
        }
        value => Ok(value),
    }
}

/// A file of the list, whose name may lack its extension.
fn picture(root: &Root, name: &str) -> Result<PathBuf, String> {
    let path = root.listed(name)?;
    if path.extension().is_some() || path.is_file() {
        return Ok(path);
    }
    let with = |extension: &&str| path.with_extension(extension);
    Ok(EXTENSIONS.iter().map(with).find(|path| path.is_file()).unwrap_or(path))
}

/// A pose with camera axes x right, y down, z forward, metres.
fn pose(rows: &[Vec<f64>], applied_scale: f64) -> MaybePose {
    let numbers: Vec<f64> = rows.concat();
    let mut matrix = [0.0; 16];
    matrix[15] = 1.0;
    if !matches!(numbers.len(), 12 | 16) {
        return Err(format!("expected a transform_matrix of 4x4, found {} numbers", numbers.len()));
    }
    matrix[..numbers.len()].copy_from_slice(&numbers);
    [3, 7, 11].into_iter().for_each(|at| matrix[at] /= applied_scale);
    Ok(pose::Axes::OpenGl.to_opencv(&pose::from_matrix(&matrix)?))
}

impl Transforms {
    /// The frames with depth, and why others are left out.
    fn found(&self, root: &Root, path: &Path, applied_scale: f64) -> Result<Found, DatasetError> {
        let picture =
            |name: &str| picture(root, name).map_err(|reason| DatasetError::content(path, reason));
        let (mut shots, mut files, mut skipped) = (Vec::new(), Vec::new(), Vec::new());
        for (sequence, listed) in (0..).zip(&self.frames) {
            let color = picture(&listed.file_path)?;
            let Some(depth) = &listed.depth_file_path else {
                let reason = "expected depth_file_path in transforms.json, found none";
                skipped.push(DatasetError::content(&color, reason).to_string());
                continue;
            };
            let world_from_camera =
                pose(&listed.transform_matrix, applied_scale).map_err(|reason| {
                    let reason = format!("{}: {reason}", listed.file_path);
                    DatasetError::content(path, reason).to_string()
                });
            shots.push(Shot::new(sequence, counted_nanos(sequence), world_from_camera));
            files.push(FrameFiles::new(color, picture(depth)?));
        }
        Ok(Found { shots, files, skipped })
    }

    /// The camera of all frames: the list's, or the first frame's.
    fn camera(&self, size: Size, notes: &mut Vec<String>) -> Result<Camera, String> {
        let model = self.camera_model.as_deref().unwrap_or(MODELS[0]);
        if !MODELS.contains(&model) {
            let expected = MODELS.join(", ");
            return Err(format!("camera_model: expected one of {expected}, found {model}"));
        }
        let first = self.frames.first().map(|frame| &frame.lens);
        let lens = first.map_or(self.lens.clone(), |first| self.lens.or(first));
        let distortion = lens.distortion(model)?;
        let is_other = |frame: &Listed| {
            frame.lens.or(&lens).distortion(model).is_ok_and(|other| other != distortion)
        };
        if let Some(other) = self.frames.iter().find(|frame| is_other(frame)) {
            notes.push(format!(
                "{}: its own distortion is not used: all frames have that of the first",
                other.file_path
            ));
        }
        Ok(Camera { intrinsics: lens.intrinsics(size)?, distortion })
    }
}

impl Lens {
    /// This lens, and what `other` says where this one says nothing.
    fn or(&self, other: &Self) -> Self {
        Self {
            w: self.w.or(other.w),
            h: self.h.or(other.h),
            fl_x: self.fl_x.or(other.fl_x),
            fl_y: self.fl_y.or(other.fl_y),
            cx: self.cx.or(other.cx),
            cy: self.cy.or(other.cy),
            k1: self.k1.or(other.k1),
            k2: self.k2.or(other.k2),
            k3: self.k3.or(other.k3),
            k4: self.k4.or(other.k4),
            p1: self.p1.or(other.p1),
            p2: self.p2.or(other.p2),
        }
    }

    /// The pinhole camera for pictures of a size, which may be another one than the list's.
    fn intrinsics(&self, size: Size) -> Result<Intrinsics, String> {
        let number = |value: Option<f64>, field| value.ok_or(format!("missing field {field}"));
        let (fx, cx) = (number(self.fl_x, "fl_x")?, number(self.cx, "cx")? - CENTRE);
        let (fy, cy) = (self.fl_y.unwrap_or(fx), number(self.cy, "cy")? - CENTRE);
        let side = |value: Option<f64>, found: u32| match value {
            None => Ok(found),
            Some(value) if value.fract() == 0.0 && (1.0..=1e6).contains(&value) => Ok(value as u32),
            Some(value) => Err(format!("w, h: expected pixels, found {value}")),
        };
        let (width, height) = (side(self.w, size.width)?, side(self.h, size.height)?);
        let listed = Intrinsics { width, height, fx, fy, cx, cy };
        Ok(listed.scaled(size.width, size.height))
    }

    fn distortion(&self, model: &str) -> Result<Distortion, String> {
        let Self { k1, k2, k3, k4, p1, p2, .. } = self;
        let coefficients = |all: &[&Option<f64>]| -> Vec<f64> {
            all.iter().map(|coefficient| coefficient.unwrap_or_default()).collect()
        };
        if model == FISHEYE {
            return Distortion::named(model, &coefficients(&[k1, k2, k3, k4]));
        }
        match k4 {
            Some(k4) if *k4 != 0.0 => Err(format!("k4: expected 0 with {model}, found {k4}")),
            _ => Distortion::named("OPENCV", &coefficients(&[k1, k2, p1, p2, k3])),
        }
    }

    /// The frame's own camera, if it has one.
    fn extras(&self, list: &Self, size: Size, usual: &Intrinsics) -> FrameExtras {
        let own = self.or(list).intrinsics(size).ok().filter(|own| own != usual);
        FrameExtras { intrinsics: own, ..FrameExtras::default() }
    }
}

impl Layer for Nerfstudio {
    fn below(&self) -> &dyn Dataset {
        &self.recording
    }
}
