//! A folder of pictures that a small file describes, `recording.toml`:
//!
//! ```toml
//! names = "numbers"            # what * stands for: "numbers", "seconds" or "nanoseconds"
//! frames_per_second = 30.0     # for times of numbered frames
//! [color]
//! files = "color/*.jpg"        # one * in the last part
//! [depth]
//! files = "depth/*.png"        # 16-bit grey PNG of color's size
//! unit_metres = 0.001
//! [camera]                     # pixels; the centre of the top-left pixel is (0, 0)
//! fx = 525.0
//! fy = 525.0
//! cx = 319.5
//! cy = 239.5
//! [poses]                      # optional
//! files = "pose/*.txt"         # 4x4 or 3x4 each; or `file`, a line for each color picture in order;
//! axes = "opencv"              # or `tum`, lines of "seconds tx ty tz qx qy qz qw"
//! inverse = false              # true: camera_from_world
//! ```
//!
//! Axes of the camera are `opencv` (x right, y down, z forward) or `opengl` (x right, y up, z back). Numbered
//! color and depth are paired by number, and timed ones within 0.02 s.

use super::error::DatasetError;
use super::frame::{Intrinsics, RgbdFrame, counted_nanos};
use super::layer::Layer;
use super::recording::{self, Entry, MaybePose, Recording};
use super::source::Dataset;
use super::timed::{self, Timed, TimedPoses};
use super::{files, name, pose, text};
use nalgebra::Isometry3;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// The file that describes a folder.
const DESCRIPTION: &str = "recording.toml";

/// A folder described by `recording.toml`.
#[derive(Debug)]
pub struct Folder {
    recording: Recording,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Description {
    #[serde(default)]
    names: Names,
    frames_per_second: Option<f64>,
    color: Pictures,
    depth: DepthPictures,
    camera: Camera,
    poses: Option<Poses>,
}

/// What `*` stands for.
#[derive(Clone, Copy, Default, Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
enum Names {
    #[default]
    Numbers,
    Seconds,
    Nanoseconds,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Pictures {
    files: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DepthPictures {
    files: String,
    unit_metres: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Camera {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Poses {
    files: Option<String>,
    file: Option<PathBuf>,
    tum: Option<PathBuf>,
    #[serde(default)]
    axes: pose::Axes,
    #[serde(default)]
    inverse: bool,
}

impl Folder {
    /// Reads the description, finds the files and reads poses.
    ///
    /// # Errors
    /// [`DatasetError`] if the description is missing or wrong, or no frame is there.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let path = folder.join(DESCRIPTION);
        let wrong = |reason: String| DatasetError::content(&path, reason);
        let described: Description = toml::from_str(&files::text(&path)?)
            .map_err(|error| wrong(error.to_string().replace('\n', " ").trim().to_owned()))?;
        let unit = described.depth.unit_metres;
        if !(unit.is_finite() && unit > 0.0) {
            return Err(wrong(format!("depth.unit_metres: expected more than 0, found {unit}")));
        }
        let colors = described.names.list(folder, &described.color.files, &path)?;
        let depths = described.names.list(folder, &described.depth.files, &path)?;
        let poses = Placed::new(folder, described.poses.as_ref(), &path)?;
        let pairs = match described.names {
            Names::Numbers => same(&colors, &depths),
            Names::Seconds | Names::Nanoseconds => timed::pair(&colors, &depths),
        };
        let entry = |&(at, depth): &(usize, usize)| {
            let Timed { nanos: number, value: color } = &colors[at];
            let (sequence, nanos) = match described.names {
                Names::Numbers => (*number, described.time(*number)),
                Names::Seconds | Names::Nanoseconds => (at as u64, *number),
            };
            let world_from_camera = poses.of(at, nanos, color, &described.color.files);
            let (color, depth) = (color.clone(), depths[depth].value.clone());
            Entry { sequence, nanos, color, depth, world_from_camera }
        };
        let frames: Vec<Entry> = pairs.iter().map(entry).collect();
        let unpaired = (0..colors.len()).filter(|at| pairs.iter().all(|(paired, _)| paired != at));
        let reason = "expected depth with the same number or time, found none";
        let skipped: Vec<String> = unpaired
            .map(|at| DatasetError::content(&colors[at].value, reason).to_string())
            .collect();
        if frames.is_empty() {
            let expected = "expected color and depth that belong together, found none";
            return Err(DatasetError::no_frames(&path, expected, &skipped));
        }
        let files::Size { width, height } = recording::size(&frames)?;
        let Camera { fx, fy, cx, cy } = described.camera;
        let intrinsics = Intrinsics { width, height, fx, fy, cx, cy };
        let (name, depth_unit_metres, notes) = (name::of(folder), unit, Vec::new());
        let cameras = intrinsics.into();
        let recording = Recording { name, cameras, depth_unit_metres, frames, skipped, notes };
        Ok(Self { recording })
    }
}

impl Description {
    fn time(&self, number: u64) -> u64 {
        match self.frames_per_second {
            Some(rate) if rate > 0.0 => (number as f64 * 1e9 / rate) as u64,
            _ => counted_nanos(number),
        }
    }
}

impl Names {
    /// Files of a pattern such as `color/*.jpg`, by number or time.
    fn list(
        self,
        folder: &Path,
        pattern: &str,
        path: &Path,
    ) -> Result<Vec<Timed<PathBuf>>, DatasetError> {
        let (inside, before, after) = split(pattern).ok_or_else(|| {
            DatasetError::content(path, format!("expected one * in the name {pattern:?}"))
        })?;
        let inside = folder.join(inside);
        let failed = |source| DatasetError::File { path: inside.clone(), source };
        let mut list = Vec::new();
        for entry in std::fs::read_dir(&inside).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let Some(star) = star(&name, before, after) else { continue };
            let number = match self {
                Self::Numbers | Self::Nanoseconds => star.parse().ok(),
                Self::Seconds => text::nanos(star).ok(),
            };
            list.extend(number.map(|nanos| Timed { nanos, value: entry.path() }));
        }
        list.sort_by(|a, b| (a.nanos, &a.value).cmp(&(b.nanos, &b.value)));
        Ok(list)
    }
}

/// Folder of a pattern, and what stands before and after its `*`.
fn split(pattern: &str) -> Option<(&str, &str, &str)> {
    let (inside, name) = pattern.rsplit_once('/').unwrap_or(("", pattern));
    let (before, after) = name.split_once('*')?;
    (!after.contains('*') && !inside.contains('*')).then_some((inside, before, after))
}

/// What `*` stands for in a name; upper case is the same.
fn star<'a>(name: &'a str, before: &str, after: &str) -> Option<&'a str> {
    let end = name.len().checked_sub(after.len()).filter(|end| *end >= before.len())?;
    let same =
        |part: Option<&str>, pattern: &str| part.is_some_and(|p| p.eq_ignore_ascii_case(pattern));
    let fits = same(name.get(..before.len()), before) && same(name.get(end..), after);
    fits.then(|| name.get(before.len()..end)).flatten()
}

/// Pairs of indices with one number; both lists are sorted.
fn same(first: &[Timed<PathBuf>], second: &[Timed<PathBuf>]) -> Vec<(usize, usize)> {
    let find = |number: u64| second.binary_search_by_key(&number, |other| other.nanos).ok();
    first.iter().enumerate().filter_map(|(at, one)| Some((at, find(one.nanos)?))).collect()
}

/// Where poses come from.
enum Source {
    None,
    /// A pattern of files.
    Files(String),
    /// One line for each color picture.
    Lines(Vec<MaybePose>),
    Timed(TimedPoses),
}

/// The poses of a description.
struct Placed {
    folder: PathBuf,
    description: PathBuf,
    source: Source,
    axes: pose::Axes,
    inverse: bool,
}

impl Placed {
    fn new(folder: &Path, poses: Option<&Poses>, description: &Path) -> Result<Self, DatasetError> {
        let source = match poses {
            None => Source::None,
            Some(Poses { files: Some(pattern), file: None, tum: None, .. }) => {
                Source::Files(pattern.clone())
            }
            Some(Poses { files: None, file: Some(file), tum: None, .. }) => {
                Source::Lines(pose::lines(&folder.join(file))?)
            }
            Some(Poses { files: None, file: None, tum: Some(file), .. }) => {
                Source::Timed(TimedPoses::read(folder.join(file))?)
            }
            Some(_) => {
                let reason = "poses: expected one of files, file and tum";
                return Err(DatasetError::content(description, reason));
            }
        };
        let (axes, inverse) =
            poses.map_or((pose::Axes::default(), false), |poses| (poses.axes, poses.inverse));
        Ok(Self { folder: folder.into(), description: description.into(), source, axes, inverse })
    }

    /// The pose of the color picture at a place of the list.
    fn of(&self, at: usize, nanos: u64, color: &Path, pattern: &str) -> MaybePose {
        let written = match &self.source {
            Source::None => {
                let reason = "it has no [poses]";
                return Err(DatasetError::content(&self.description, reason).to_string());
            }
            Source::Files(poses) => self.of_file(color, pattern, poses)?,
            Source::Lines(lines) => lines.get(at).cloned().unwrap_or_else(|| {
                let reason =
                    format!("expected a pose for picture {at}, found {} lines", lines.len());
                Err(DatasetError::content(&self.description, reason).to_string())
            })?,
            Source::Timed(poses) => poses.at(nanos, color)?,
        };
        let world_from_written: Isometry3<f64> =
            if self.inverse { written.inverse() } else { written };
        Ok(self.axes.to_opencv(&world_from_written))
    }

    /// The pose in the file where `*` is what it is in the picture's name.
    fn of_file(&self, color: &Path, pattern: &str, poses: &str) -> MaybePose {
        let name =
            color.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let star = split(pattern).and_then(|(_, before, after)| star(&name, before, after));
        let path = self.folder.join(poses.replacen('*', star.unwrap_or_default(), 1));
        let text = files::text(&path).map_err(|error| error.whole())?;
        pose::from_rows(&text).map_err(|reason| DatasetError::content(&path, reason).to_string())
    }
}

impl Layer for Folder {
    fn below(&self) -> &dyn Dataset {
        &self.recording
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        self.recording.frame(index)
    }
}
