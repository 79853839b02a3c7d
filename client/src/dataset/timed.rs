//! Lists of things with times, paired with one another.

use super::error::DatasetError;
use super::recording::MaybePose;
use super::{files, pose, text};
use nalgebra::Isometry3;
use std::path::{Path, PathBuf};

const DEPTH_WITHIN_NANOS: u64 = 20_000_000;
const POSE_WITHIN_NANOS: u64 = 80_000_000;

/// A thing with its time.
pub(super) struct Timed<T> {
    pub nanos: u64,
    pub value: T,
}

/// A list whose lines start with a timestamp, by time. The first line may be a header.
pub(super) fn list<T>(
    path: &Path,
    parse: impl Fn(usize, &str) -> Result<T, String>,
) -> Result<Vec<Timed<T>>, DatasetError> {
    let content = files::text(path)?;
    let mut list = Vec::new();
    for (at, (number, line)) in text::lines(&content).enumerate() {
        if at == 0 && !line.contains(|c: char| c.is_ascii_digit()) {
            continue;
        }
        let (stamp, rest) = text::first_word(line);
        let entry =
            text::nanos(stamp).and_then(|nanos| Ok(Timed { nanos, value: parse(number, rest)? }));
        list.push(entry.map_err(|reason| DatasetError::at_line(path, number, reason))?);
    }
    list.sort_by_key(|entry| entry.nanos);
    Ok(list)
}

/// Poses with times, in a file that may be missing.
pub(super) struct TimedPoses {
    path: PathBuf,
    /// By time; `None` without a file.
    list: Option<Vec<Timed<MaybePose>>>,
}

impl TimedPoses {
    /// Reads `timestamp tx ty tz qx qy qz qw` per line.
    ///
    /// # Errors
    /// [`DatasetError`] if a line has no time.
    pub fn read(path: PathBuf) -> Result<Self, DatasetError> {
        if !path.is_file() {
            return Ok(Self { path, list: None });
        }
        let list = list(&path, |line, rest| {
            let pose = text::numbers(rest).and_then(|numbers| pose::from_tum(&numbers));
            Ok(pose.map_err(|reason| DatasetError::at_line(&path, line, reason).to_string()))
        })?;
        Ok(Self { list: Some(list), path })
    }

    /// The nearest pose, at most 0.08 s away, or the reason why `picture` has none.
    pub fn at(&self, nanos: u64, picture: &Path) -> Result<Isometry3<f64>, String> {
        let Some(list) = &self.list else {
            let reason = "there is no such file";
            return Err(DatasetError::content(&self.path, reason).to_string());
        };
        let after = list.partition_point(|pose| pose.nanos < nanos);
        let around = &list[after.saturating_sub(1)..list.len().min(after + 1)];
        let nearest = around.iter().min_by_key(|pose| pose.nanos.abs_diff(nanos));
        match nearest {
            Some(pose) if pose.nanos.abs_diff(nanos) <= POSE_WITHIN_NANOS => pose.value.clone(),
            _ => {
                let reason = "expected a pose at most 0.08 s away, found none";
                Err(DatasetError::content(picture, reason).to_string())
            }
        }
    }
}

/// Pairs of indices into the two lists, at most 0.02 s apart, closest in time first served, in the order of
/// the first.
pub(super) fn pair<A, B>(first: &[Timed<A>], second: &[Timed<B>]) -> Vec<(usize, usize)> {
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
