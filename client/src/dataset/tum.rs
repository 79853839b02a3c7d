//! TUM RGB-D layout: `rgb.txt` and `depth.txt` (`timestamp file` per line), `groundtruth.txt`
//! (`timestamp tx ty tz qx qy qz qw`, `world_from_camera`), depth in units of 1/5000 m. Pictures
//! are paired with depth at most 0.02 s away, each used once, and with the nearest pose at most
//! 0.08 s away. Intrinsics: `camera.txt` or `calibration.txt` (`fx fy cx cy`); for pictures of 640x480
//! without a file, by the word `fr1`, `fr2` or `fr3` (`freiburg1`, …) in the folder's name, else the
//! driver's default, both of which [`Dataset::notes`] says. Behind `fx fy cx cy` may be the coefficients of
//! a Brown-Conrady distortion, `k1 k2 p1 p2 k3`. A frame's number is its picture's place in
//! `rgb.txt`, from 0.
//!
//! Without `rgb.txt`, a list of pairs is read (ICL-NUIM's `associations.txt`: `timestamp file timestamp
//! file` per line, the file with `depth` in its name is depth), and without `groundtruth.txt` a
//! `*.gt.freiburg`.

use super::error::DatasetError;
use super::files::{self, Size};
use super::frame::{Camera, Cameras, Distortion, Intrinsics};
use super::layer::Layer;
use super::picture_files::{FrameFiles, PictureFiles};
use super::recording::{Recording, Shot};
use super::root::Root;
use super::source::Dataset;
use super::timed::{self, Timed, TimedPoses};
use super::{name, text};
use std::path::{Path, PathBuf};

const DEPTH_UNIT_METRES: f64 = 1.0 / 5000.0;
/// The benchmark's pictures.
const BENCHMARK_SIZE: Size = Size { width: 640, height: 480 };
/// fx, fy, cx, cy of the driver.
const DEFAULT: [f64; 4] = [525.0, 525.0, 319.5, 239.5];
/// fx, fy, cx, cy of the three cameras of the benchmark.
const CALIBRATED: [([&str; 2], [f64; 4]); 3] = [
    (["fr1", "freiburg1"], [517.3, 516.5, 318.6, 255.3]),
    (["fr2", "freiburg2"], [520.9, 521.0, 325.1, 249.7]),
    (["fr3", "freiburg3"], [535.4, 539.2, 320.1, 247.6]),
];
/// Lists of pairs.
const PAIRS: [&str; 3] = ["associations.txt", "associated.txt", "associate.txt"];
const CAMERA_FILES: [&str; 2] = ["camera.txt", "calibration.txt"];

/// A folder in TUM layout.
#[derive(Debug)]
pub struct Tum {
    recording: Recording,
}

impl Tum {
    /// Finds the files, pairs them and reads camera and poses.
    ///
    /// # Errors
    /// [`DatasetError`] if a list or the camera is missing or damaged, or no frame is there.
    pub fn open(root: impl Into<Root>) -> Result<Self, DatasetError> {
        let root = root.into();
        let folder = root.folder();
        let [colors, depths] = lists(&root)?;
        let poses = TimedPoses::read(trajectory(folder))?;
        let pairs = timed::pair(&colors, &depths);
        let entry = |&(at, depth): &(usize, usize)| {
            let Timed { nanos, value: color } = &colors[at];
            let (color, depth) = (color.clone(), depths[depth].value.clone());
            let (sequence, world_from_camera) = (at as u64, poses.at(*nanos, &color));
            let shot = Shot::new(sequence, *nanos, world_from_camera);
            (shot, FrameFiles::new(color, depth))
        };
        let (shots, files): (Vec<Shot>, _) = pairs.iter().map(entry).unzip();
        if shots.is_empty() {
            let reason = "expected pictures with depth at most 0.02 s away, found none";
            return Err(DatasetError::content(folder, reason));
        }
        let unpaired = (0..colors.len()).filter(|at| pairs.iter().all(|(paired, _)| paired != at));
        let skipped = unpaired.map(|at| {
            let reason = "expected depth at most 0.02 s away, found none";
            DatasetError::content(&colors[at].value, reason).to_string()
        });
        let (skipped, mut notes) = (skipped.collect(), Vec::new());
        let pictures = PictureFiles::plain(files);
        let color = camera(folder, pictures.size()?, &mut notes)?;
        let cameras = Cameras { color: color.clone(), ..color.intrinsics.into() };
        let recording = Recording {
            name: name::of(folder),
            cameras,
            depth_unit_metres: DEPTH_UNIT_METRES,
            shots,
            pictures: Box::new(pictures),
            skipped,
            notes,
        };
        Ok(Self { recording })
    }
}

/// Pictures, by time.
type Pictures = Vec<Timed<PathBuf>>;

/// Color and depth.
fn lists(root: &Root) -> Result<[Pictures; 2], DatasetError> {
    let folder = root.folder();
    let pairs = PAIRS.map(|name| folder.join(name)).into_iter().find(|path| path.is_file());
    let Some(path) = pairs.filter(|_| !folder.join("rgb.txt").is_file()) else {
        return Ok([file_list(root, "rgb.txt")?, file_list(root, "depth.txt")?]);
    };
    let (mut colors, mut depths) = (Vec::new(), Vec::new());
    for Timed { nanos, value: (first, other_nanos, second) } in
        timed::list(&path, |_, rest| pair_of(root, rest))?
    {
        for (nanos, (is_depth, value)) in [(nanos, first), (other_nanos, second)] {
            let list = if is_depth { &mut depths } else { &mut colors };
            list.push(Timed { nanos, value });
        }
    }
    colors.sort_by_key(|color| color.nanos);
    depths.sort_by_key(|depth| depth.nanos);
    Ok([colors, depths])
}

/// A file, and whether it has depth.
type PairedFile = (bool, PathBuf);

/// `file timestamp file`.
fn pair_of(root: &Root, rest: &str) -> Result<(PairedFile, u64, PairedFile), String> {
    let file = |name: &str| Ok::<_, String>((name.contains("depth"), root.listed(name)?));
    match text::words(rest).collect::<Vec<_>>()[..] {
        [first, stamp, second] => Ok((file(first)?, text::nanos(stamp)?, file(second)?)),
        _ => Err("expected timestamp, file, timestamp, file".into()),
    }
}

/// The file of poses.
fn trajectory(folder: &Path) -> PathBuf {
    let usual = folder.join("groundtruth.txt");
    if usual.is_file() {
        return usual;
    }
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let is_other = |path: &PathBuf| path.to_string_lossy().ends_with(".gt.freiburg");
    entries.map(|entry| entry.path()).filter(is_other).min().unwrap_or(usual)
}

/// `timestamp file` per line, by time.
fn file_list(root: &Root, name: &str) -> Result<Pictures, DatasetError> {
    timed::list(&root.folder().join(name), |_, rest| match rest.trim_matches('"') {
        "" => Err("expected a timestamp and a file, found no file".into()),
        file => root.listed(file),
    })
}

/// The camera of a file, of the benchmark, or the driver's. The last two only for pictures of their size.
fn camera(folder: &Path, size: Size, notes: &mut Vec<String>) -> Result<Camera, DatasetError> {
    let given = CAMERA_FILES.map(|file| folder.join(file));
    let ([fx, fy, cx, cy], distortion) = match given.iter().find(|path| path.is_file()) {
        Some(path) => camera_file(path, notes)?,
        None if size == BENCHMARK_SIZE => (assumed(folder, notes), Distortion::None),
        None => {
            let reason = format!(
                "expected camera.txt (fx fy cx cy, pixels), since pictures of {size} pixels are not the                  benchmark's"
            );
            return Err(DatasetError::content(folder, reason));
        }
    };
    let intrinsics = Intrinsics { width: size.width, height: size.height, fx, fy, cx, cy };
    Ok(Camera { intrinsics, distortion })
}

/// `fx fy cx cy`, which coefficients of a Brown-Conrady distortion may follow: k1 k2 p1 p2 k3.
fn camera_file(
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<([f64; 4], Distortion), DatasetError> {
    let content = files::text(path)?;
    let (number, line) = text::lines(&content)
        .next()
        .ok_or_else(|| DatasetError::content(path, "expected fx fy cx cy"))?;
    let words: Vec<&str> = text::words(line).collect();
    let (camera, more) = words.split_at(words.len().min(4));
    let coefficients: Result<Vec<f64>, _> = more.iter().map(|word| word.parse()).collect();
    let distortion = coefficients
        .map_err(|_| "expected numbers".to_owned())
        .and_then(|numbers| Distortion::named("brown_conrady", &numbers));
    let distortion = distortion.unwrap_or_else(|reason| {
        notes.push(format!(
            "{}: {} behind fx fy cx cy is not used as a distortion: {reason}",
            path.display(),
            more.join(" ")
        ));
        Distortion::None
    });
    let camera = text::numbers(&camera.join(" "));
    Ok((camera.map_err(|reason| DatasetError::at_line(path, number, reason))?, distortion))
}

/// The camera that the folder's name says, as given or behind a link, or else the driver's.
fn assumed(folder: &Path, notes: &mut Vec<String>) -> [f64; 4] {
    let behind = folder.canonicalize().ok();
    let paths = [Some(folder), behind.as_deref()].into_iter().flatten();
    let name = paths.filter_map(name::last_part).collect::<Vec<_>>().join(" ").to_lowercase();
    let words: Vec<&str> = name.split(|c: char| !c.is_alphanumeric()).collect();
    let known = CALIBRATED.iter().find(|(names, _)| names.iter().any(|name| words.contains(name)));
    let (whose, camera) = match known {
        Some(([_, name], camera)) => (format!("the benchmark's {name}"), *camera),
        None => ("a Kinect as its driver describes it".into(), DEFAULT),
    };
    let [fx, fy, cx, cy] = camera;
    notes.push(format!(
        "{} has no camera.txt: taken to be {whose}, fx fy cx cy = {fx} {fy} {cx} {cy}",
        folder.display()
    ));
    camera
}

impl Layer for Tum {
    fn below(&self) -> &dyn Dataset {
        &self.recording
    }
}
