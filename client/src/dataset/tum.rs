//! TUM RGB-D layout: `rgb.txt` and `depth.txt` (`timestamp file` per line), `groundtruth.txt`
//! (`timestamp tx ty tz qx qy qz qw`, `world_from_camera`), depth in units of 1/5000 m. Pictures
//! are paired with depth at most 0.02 s away, each used once, and with the nearest pose at most
//! 0.08 s away. Intrinsics: `camera.txt` or `calibration.txt` (`fx fy cx cy`), else by `fr1`, `fr2`
//! or `fr3` (`freiburg1`, …) in the folder's name, else the driver's default. A frame's number is
//! its picture's place in `rgb.txt`, from 0.

use super::error::DatasetError;
use super::files::Size;
use super::frame::{Intrinsics, RgbdFrame};
use super::source::Dataset;
use super::{files, pose};
use nalgebra::Isometry3;
use std::path::{Path, PathBuf};

const DEPTH_UNIT_METRES: f64 = 1.0 / 5000.0;
const DEPTH_WITHIN_NANOS: u64 = 20_000_000;
const POSE_WITHIN_NANOS: u64 = 80_000_000;
/// fx, fy, cx, cy of the driver.
const DEFAULT: [f64; 4] = [525.0, 525.0, 319.5, 239.5];
/// fx, fy, cx, cy of the three cameras of the benchmark.
const CALIBRATED: [(&str, [f64; 4]); 3] = [
    ("1", [517.3, 516.5, 318.6, 255.3]),
    ("2", [520.9, 521.0, 325.1, 249.7]),
    ("3", [535.4, 539.2, 320.1, 247.6]),
];

/// A folder in TUM layout.
#[derive(Debug)]
pub struct Tum {
    name: String,
    intrinsics: Intrinsics,
    frames: Vec<Entry>,
    skipped: Vec<String>,
}

#[derive(Debug)]
struct Entry {
    sequence: u64,
    nanos: u64,
    color: PathBuf,
    depth: PathBuf,
    world_from_camera: Option<Isometry3<f64>>,
}

/// A pose, or the reason why a line has no valid one.
type MaybePose = Result<Isometry3<f64>, String>;

/// A line of a list with its time.
struct Timed<T> {
    nanos: u64,
    value: T,
}

impl Tum {
    /// Finds the files, pairs them and reads camera and poses.
    ///
    /// # Errors
    /// [`DatasetError`] if a file is missing or damaged.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let colors = file_list(folder, "rgb.txt")?;
        let depths = file_list(folder, "depth.txt")?;
        let trajectory = folder.join("groundtruth.txt");
        let poses = if trajectory.is_file() { Some(poses(&trajectory)?) } else { None };
        let (mut frames, mut skipped) = (Vec::new(), Vec::new());
        for (at, depth) in pair(&colors, &depths) {
            let Timed { nanos, value: color } = &colors[at];
            let world_from_camera = match poses.as_deref().map(|poses| pose_at(poses, *nanos)) {
                None => None,
                Some(Ok(pose)) => Some(pose),
                Some(Err(reason)) => {
                    skipped.push(DatasetError::content(color, reason).to_string());
                    continue;
                }
            };
            let (color, depth) = (color.clone(), depths[depth].value.clone());
            let sequence = at as u64;
            frames.push(Entry { sequence, nanos: *nanos, color, depth, world_from_camera });
        }
        let Some(first) = frames.first() else {
            let reason = "expected pictures with depth at most 0.02 s and a pose at most 0.08 s \
                          away, found none";
            return Err(DatasetError::content(folder, reason));
        };
        let size = files::size(&first.color)?;
        files::check_size(&first.depth, size)?;
        let name = files::name_of(folder);
        let intrinsics = intrinsics(folder, &name, size)?;
        Ok(Self { name, intrinsics, frames, skipped })
    }
}

/// `timestamp file` per line, by time.
fn file_list(folder: &Path, name: &str) -> Result<Vec<Timed<PathBuf>>, DatasetError> {
    timed(&folder.join(name), |rest| match rest {
        "" => Err("expected a timestamp and a file, found no file".into()),
        file => Ok(folder.join(file)),
    })
}

fn poses(path: &Path) -> Result<Vec<Timed<MaybePose>>, DatasetError> {
    timed(path, |rest| Ok(pose::from_tum(&files::numbers(rest)?)))
}

/// A list whose lines start with a timestamp, by time.
fn timed<T>(
    path: &Path,
    parse: impl Fn(&str) -> Result<T, String>,
) -> Result<Vec<Timed<T>>, DatasetError> {
    let text = files::text(path)?;
    let mut list = Vec::new();
    for (number, line) in files::lines(&text) {
        let (stamp, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let nanos = nanos(stamp).ok_or_else(|| format!("expected seconds, found {stamp:?}"));
        let entry = nanos.and_then(|nanos| Ok(Timed { nanos, value: parse(rest.trim())? }));
        list.push(entry.map_err(|reason| DatasetError::at_line(path, number, reason))?);
    }
    list.sort_by_key(|entry| entry.nanos);
    Ok(list)
}

/// Nanoseconds of decimal seconds, exactly: an `f64` cannot hold microseconds since 1970.
fn nanos(seconds: &str) -> Option<u64> {
    let (whole, fraction) = seconds.split_once('.').unwrap_or((seconds, ""));
    let digits = fraction.get(..fraction.len().min(9))?;
    if !fraction.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let fraction: u64 = format!("{digits:0<9}").parse().ok()?;
    whole.parse::<u64>().ok()?.checked_mul(1_000_000_000)?.checked_add(fraction)
}

/// Pairs of indices into the two lists, closest in time first served, in the order of the first.
fn pair<A, B>(first: &[Timed<A>], second: &[Timed<B>]) -> Vec<(usize, usize)> {
    let mut close = Vec::new();
    for (i, a) in first.iter().enumerate() {
        let from = second.partition_point(|b| b.nanos + DEPTH_WITHIN_NANOS < a.nanos);
        let near = second.iter().enumerate().skip(from);
        let near = near.map(|(j, b)| (a.nanos.abs_diff(b.nanos), i, j));
        close.extend(near.take_while(|(apart, ..)| *apart <= DEPTH_WITHIN_NANOS));
    }
    close.sort_unstable();
    let (mut used_first, mut used_second) = (vec![false; first.len()], vec![false; second.len()]);
    let mut pairs = Vec::new();
    for (_, i, j) in close {
        if !used_first[i] && !used_second[j] {
            (used_first[i], used_second[j]) = (true, true);
            pairs.push((i, j));
        }
    }
    pairs.sort_unstable();
    pairs
}

/// The nearest pose in time, or the reason why there is none.
fn pose_at(poses: &[Timed<MaybePose>], nanos: u64) -> Result<Isometry3<f64>, String> {
    let after = poses.partition_point(|pose| pose.nanos < nanos);
    let around = &poses[after.saturating_sub(1)..poses.len().min(after + 1)];
    let nearest = around.iter().min_by_key(|pose| pose.nanos.abs_diff(nanos));
    match nearest {
        Some(pose) if pose.nanos.abs_diff(nanos) <= POSE_WITHIN_NANOS => pose.value.clone(),
        _ => Err("expected a pose at most 0.08 s away, found none".into()),
    }
}

fn intrinsics(folder: &Path, name: &str, size: Size) -> Result<Intrinsics, DatasetError> {
    let given = ["camera.txt", "calibration.txt"].map(|file| folder.join(file));
    let [fx, fy, cx, cy] = match given.iter().find(|path| path.is_file()) {
        Some(path) => {
            let text = files::text(path)?;
            let (number, line) = files::lines(&text)
                .next()
                .ok_or_else(|| DatasetError::content(path, "expected fx fy cx cy"))?;
            let words: Vec<&str> = line.split_whitespace().take(4).collect();
            files::numbers(&words.join(" "))
                .map_err(|reason| DatasetError::at_line(path, number, reason))?
        }
        None => CALIBRATED
            .iter()
            .find(|(n, _)| ["fr", "freiburg"].iter().any(|b| name.contains(&format!("{b}{n}"))))
            .map_or(DEFAULT, |(_, camera)| *camera),
    };
    Ok(Intrinsics { width: size.width, height: size.height, fx, fy, cx, cy })
}

impl Dataset for Tum {
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
        DEPTH_UNIT_METRES
    }

    fn sequence(&self, index: usize) -> u64 {
        self.frames[index].sequence
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        let entry = &self.frames[index];
        Ok(RgbdFrame {
            sequence: entry.sequence,
            timestamp_nanos: entry.nanos,
            color: files::color(&entry.color)?,
            depth: files::depth(&entry.depth)?,
            world_from_camera: entry.world_from_camera,
        })
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }
}
