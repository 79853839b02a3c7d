//! Frames in files: what every layout of folders comes to.

use super::error::DatasetError;
use super::files::{self, Size};
use super::frame::{Cameras, FrameExtras, Intrinsics, Moment, RgbdFrame};
use super::prepare::Preparation;
use super::source::Dataset;
use nalgebra::Isometry3;
use std::path::PathBuf;

/// Frames whose headers are read to learn the size of all: one damaged picture decides nothing.
const SAMPLES: usize = 9;

/// A pose, or the reason why there is no valid one.
pub(super) type MaybePose = Result<Isometry3<f64>, String>;

/// A frame whose pictures are in files.
#[derive(Debug)]
pub(super) struct Entry {
    pub sequence: u64,
    pub nanos: u64,
    pub color: PathBuf,
    pub depth: PathBuf,
    pub world_from_camera: MaybePose,
    /// The picture of depth's confidence.
    pub confidence: Option<PathBuf>,
    pub extras: FrameExtras,
}

/// The frames of a recording. Layouts build one each.
#[derive(Debug)]
pub(super) struct Recording {
    pub name: String,
    pub cameras: Cameras,
    pub depth_unit_metres: f64,
    pub preparation: Preparation,
    pub frames: Vec<Entry>,
    /// See [`Dataset::skipped`].
    pub skipped: Vec<String>,
    /// See [`Dataset::notes`].
    pub notes: Vec<String>,
}

/// The size of color and depth that most of a few frames have.
///
/// # Errors
/// What is wrong with the first frame, if no frame looked at has color and depth of one size.
pub(super) fn size(frames: &[Entry]) -> Result<Size, DatasetError> {
    usual(frames, Entry::size)
}

/// The sizes that color and depth of most of a few frames have, once they are turned.
///
/// # Errors
/// What is wrong with the first frame, if color or depth of no frame looked at can be read.
pub(super) fn sizes(
    frames: &[Entry],
    preparation: &Preparation,
) -> Result<[Size; 2], DatasetError> {
    Ok([
        usual(frames, |entry| preparation.color_size(&entry.color))?,
        usual(frames, |entry| preparation.depth_size(&entry.depth))?,
    ])
}

fn usual(
    frames: &[Entry],
    size: impl Fn(&Entry) -> Result<Size, DatasetError>,
) -> Result<Size, DatasetError> {
    let mut found: Vec<(Size, usize)> = Vec::new();
    let mut wrong = None;
    for entry in frames.iter().step_by(frames.len().div_ceil(SAMPLES).max(1)) {
        match size(entry) {
            Ok(size) => match found.iter_mut().find(|(other, _)| *other == size) {
                Some((_, times)) => *times += 1,
                None => found.push((size, 1)),
            },
            Err(error) => wrong = wrong.or(Some(error)),
        }
    }
    // Of sizes that are equally frequent, the first.
    match (found.iter().rev().max_by_key(|(_, times)| *times), wrong) {
        (Some((size, _)), _) => Ok(*size),
        (None, Some(error)) => Err(error),
        (None, None) => unreachable!("there is at least one frame"),
    }
}

impl Entry {
    /// A frame about which no more is known.
    pub fn new(
        sequence: u64,
        nanos: u64,
        [color, depth]: [PathBuf; 2],
        world_from_camera: MaybePose,
    ) -> Self {
        let (confidence, extras) = (None, FrameExtras::default());
        Self { sequence, nanos, color, depth, world_from_camera, confidence, extras }
    }

    fn size(&self) -> Result<Size, DatasetError> {
        let size = files::size(&self.color)?;
        files::check_size(&self.depth, size)?;
        Ok(size)
    }
}

impl Dataset for Recording {
    fn name(&self) -> &str {
        &self.name
    }

    fn len(&self) -> usize {
        self.frames.len()
    }

    fn intrinsics(&self) -> Intrinsics {
        self.cameras.color.intrinsics
    }

    fn cameras(&self) -> Cameras {
        self.cameras.clone()
    }

    fn depth_unit_metres(&self) -> f64 {
        self.depth_unit_metres
    }

    fn sequence(&self, index: usize) -> u64 {
        self.frames[index].sequence
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        let entry = &self.frames[index];
        let (sequence, confidence) = (entry.sequence, entry.confidence.as_ref());
        Ok(RgbdFrame {
            sequence,
            timestamp_nanos: entry.nanos,
            color: self.preparation.color(&entry.color, sequence)?,
            depth: self.preparation.depth(&entry.depth, confidence, sequence)?,
            world_from_camera: entry.world_from_camera.as_ref().ok().copied(),
            extras: entry.extras,
        })
    }

    fn moment(&self, index: usize) -> Result<Moment, DatasetError> {
        let Entry { nanos, world_from_camera, .. } = &self.frames[index];
        let world_from_camera = world_from_camera.as_ref().ok().copied();
        Ok(Moment { timestamp_nanos: *nanos, world_from_camera })
    }

    fn no_pose(&self, index: usize) -> Option<&str> {
        self.frames[index].world_from_camera.as_ref().err().map(String::as_str)
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }
}
