//! A folder of pictures that a small file describes, `recording.toml`:
//!
//! ```toml
//! names = "numbers"            # what * stands for: "numbers", "seconds" or "nanoseconds"
//! frames_per_second = 30.0     # for times of numbered frames
//! [color]
//! files = "color/*.jpg"        # one * in the last part
//! [depth]
//! files = "depth/*.png"        # 16-bit grey PNG, or .npy
//! unit_metres = 0.001
//! [camera]                     # pixels; the centre of the top-left pixel is (0, 0)
//! fx = 525.0
//! fy = 525.0
//! cx = 319.5
//! cy = 239.5
//! distortion = { model = "brown_conrady", coefficients = [0.1, -0.2, 0, 0, 0] }    # optional
//! [depth.camera]               # where depth is not registered to color: fx, fy, cx, cy, distortion and
//! same_lens = true             # color_from_depth; or this: color's lens at another size
//! [poses]                      # optional
//! files = "pose/*.txt"         # 4x4 or 3x4 each; or `file`, a line for each color picture in order;
//! axes = "opencv"              # or `tum`, lines of "seconds tx ty tz qx qy qz qw"
//! inverse = false              # true: camera_from_world
//! ```
//!
//! Axes of the camera are `opencv` (x right, y down, z forward) or `opengl` (x right, y up, z back). Numbered
//! color and depth are paired by number, and timed ones within 0.02 s.

use super::described::{DepthPictures, Description, Names, Poses};
use super::error::DatasetError;
use super::frame::FrameExtras;
use super::layer::Layer;
use super::picture_files::{FrameFiles, PictureFiles};
use super::prepare::{self, FINE_UNIT_METRES, Preparation};
use super::recording::{MaybePose, Recording, Shot};
use super::root::Root;
use super::source::Dataset;
use super::timed::{self, Timed, TimedPoses};
use super::{files, name, pose, text};
use nalgebra::Isometry3;
use std::path::{Path, PathBuf};

/// The file that describes a folder.
const DESCRIPTION: &str = "recording.toml";

/// A folder described by `recording.toml`.
#[derive(Debug)]
pub struct Folder {
    recording: Recording,
}

impl Folder {
    /// Reads the description, finds the files and reads poses.
    ///
    /// # Errors
    /// [`DatasetError`] if the description is missing or wrong, or no frame is there.
    pub fn open(root: impl Into<Root>) -> Result<Self, DatasetError> {
        let root = root.into();
        let folder = root.folder();
        let path = folder.join(DESCRIPTION);
        let wrong = |reason: String| DatasetError::content(&path, reason);
        let described: Description = toml::from_str(&files::text(&path)?)
            .map_err(|error| wrong(error.to_string().replace('\n', " ").trim().to_owned()))?;
        let (preparation, depth_unit_metres) = prepared(&described).map_err(wrong)?;
        let Found { shots, files, skipped } = Found::new(&root, &described, &path)?;
        if shots.is_empty() {
            let expected = "expected color and depth that belong together, found none";
            return Err(DatasetError::no_frames(&path, expected, &skipped));
        }
        let pictures = PictureFiles { frames: files, preparation };
        let [color, depth] = pictures.sizes()?;
        let mut cameras = described.cameras(color, depth).map_err(wrong)?;
        for value in &mut cameras.no_depth {
            *value = prepare::unit(f64::from(*value) * pictures.preparation.scale);
        }
        let recording = Recording {
            name: name::of(folder),
            cameras,
            depth_unit_metres,
            shots,
            pictures: Box::new(pictures),
            skipped,
            notes: Vec::new(),
        };
        Ok(Self { recording })
    }
}

/// What is done to the pictures, and metres per unit in which depth is sent.
fn prepared(described: &Description) -> Result<(Preparation, f64), String> {
    let DepthPictures { unit_metres: unit, confidence, least_confidence, .. } = &described.depth;
    if !(unit.is_finite() && *unit > 0.0) {
        return Err(format!("depth.unit_metres: expected more than 0, found {unit}"));
    }
    if confidence.is_some() != least_confidence.is_some() {
        return Err("depth: expected both of confidence and least_confidence".into());
    }
    let is_array = prepare::is_array(described.depth.files.as_ref());
    let sent = if is_array { FINE_UNIT_METRES } else { *unit };
    let preparation = Preparation {
        color_turn: described.color.turned,
        depth_turn: described.depth.turned,
        scale: unit / sent,
        least_confidence: least_confidence.unwrap_or_default(),
    };
    Ok((preparation, sent))
}

/// The frames whose files are there.
struct Found {
    shots: Vec<Shot>,
    files: Vec<FrameFiles>,
    skipped: Vec<String>,
}

impl Found {
    fn new(root: &Root, described: &Description, path: &Path) -> Result<Self, DatasetError> {
        let names = described.names;
        let colors = list(names, root, &described.color.files, path)?;
        let depths = list(names, root, &described.depth.files, path)?;
        let poses = Placed::new(root, described.poses.as_ref(), path)?;
        let pairs = match names {
            Names::Numbers => same(&colors, &depths),
            Names::Seconds | Names::Nanoseconds => timed::pair(&colors, &depths),
        };
        let entry = |&(at, depth): &(usize, usize)| {
            let Timed { nanos: number, value: color } = &colors[at];
            let Timed { nanos: depth_number, value: depth } = &depths[depth];
            let (sequence, nanos, depth_nanos) = match names {
                Names::Numbers => (*number, described.frames_per_second.nanos(*number), None),
                Names::Seconds | Names::Nanoseconds => {
                    let apart = depth_number != number;
                    (at as u64, *number, apart.then_some(*depth_number))
                }
            };
            let world_from_camera = poses.of(at, nanos, color, &described.color.files);
            let confidence = described.depth.confidence.as_ref();
            let confidence =
                confidence.map(|other| root.listed(&beside(depth, &described.depth.files, other)));
            let confidence = confidence.transpose();
            let confidence = confidence.map_err(|reason| DatasetError::content(path, reason))?;
            let extras = FrameExtras { depth_timestamp_nanos: depth_nanos, ..Default::default() };
            Ok((
                Shot { sequence, nanos, world_from_camera, extras },
                FrameFiles { color: color.clone(), depth: depth.clone(), confidence },
            ))
        };
        let frames = pairs.iter().map(entry).collect::<Result<Vec<_>, DatasetError>>()?;
        let (shots, files) = frames.into_iter().unzip();
        let unpaired = (0..colors.len()).filter(|at| pairs.iter().all(|(paired, _)| paired != at));
        let reason = "expected depth with the same number or time, found none";
        let told = |at: usize| DatasetError::content(&colors[at].value, reason).to_string();
        Ok(Self { shots, files, skipped: unpaired.map(told).collect() })
    }
}

/// The name in the pattern `other` of the file that belongs to one of `pattern`.
fn beside(path: &Path, pattern: &str, other: &str) -> String {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let star = split(pattern).and_then(|(_, before, after)| star(&name, before, after));
    other.replacen('*', star.unwrap_or_default(), 1)
}

/// Files of a pattern such as `color/*.jpg`, by number or time.
fn list(
    names: Names,
    root: &Root,
    pattern: &str,
    path: &Path,
) -> Result<Vec<Timed<PathBuf>>, DatasetError> {
    let (inside, before, after) = split(pattern).ok_or_else(|| {
        DatasetError::content(path, format!("expected one * in the name {pattern:?}"))
    })?;
    let inside = root.listed(inside).map_err(|reason| DatasetError::content(path, reason))?;
    let failed = |source| DatasetError::File { path: inside.clone(), source };
    let mut list = Vec::new();
    for entry in std::fs::read_dir(&inside).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let Some(star) = star(&name, before, after) else { continue };
        let number = match names {
            Names::Numbers | Names::Nanoseconds => star.parse().ok(),
            Names::Seconds => text::nanos(star).ok(),
        };
        list.extend(number.map(|nanos| Timed { nanos, value: entry.path() }));
    }
    list.sort_by(|a, b| (a.nanos, &a.value).cmp(&(b.nanos, &b.value)));
    Ok(list)
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
    root: Root,
    description: PathBuf,
    source: Source,
    axes: pose::Axes,
    inverse: bool,
}

impl Placed {
    fn new(root: &Root, poses: Option<&Poses>, description: &Path) -> Result<Self, DatasetError> {
        let listed = |file: &Path| {
            let listed = root.listed(&file.to_string_lossy());
            listed.map_err(|reason| DatasetError::content(description, reason))
        };
        let source = match poses {
            None => Source::None,
            Some(Poses { files: Some(pattern), file: None, tum: None, .. }) => {
                Source::Files(pattern.clone())
            }
            Some(Poses { files: None, file: Some(file), tum: None, .. }) => {
                Source::Lines(pose::lines(&listed(file)?)?)
            }
            Some(Poses { files: None, file: None, tum: Some(file), .. }) => {
                Source::Timed(TimedPoses::read(listed(file)?)?)
            }
            Some(_) => {
                let reason = "poses: expected one of files, file and tum";
                return Err(DatasetError::content(description, reason));
            }
        };
        let (axes, inverse) =
            poses.map_or((pose::Axes::default(), false), |poses| (poses.axes, poses.inverse));
        Ok(Self { root: root.clone(), description: description.into(), source, axes, inverse })
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
        let path = self.root.listed(&beside(color, pattern, poses))?;
        let text = files::text(&path).map_err(|error| error.whole())?;
        pose::from_rows(&text).map_err(|reason| DatasetError::content(&path, reason).to_string())
    }
}

impl Layer for Folder {
    fn below(&self) -> &dyn Dataset {
        &self.recording
    }
}
