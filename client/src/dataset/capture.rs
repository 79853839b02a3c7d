//! Frames in one file: what every format of that kind comes to.
//!
//! A format opens its file, builds a [`Capture`] and reads pictures when they are asked for; the file is
//! never in memory as a whole.

use super::error::DatasetError;
use super::frame::{Cameras, Color, Depth, FrameExtras, Intrinsics, Moment, RgbdFrame};
use super::recording::MaybePose;
use super::source::Dataset;
use flate2::read::ZlibDecoder;
use std::io::Read;

/// Reads the pictures of a file's frames.
pub(super) trait Pictures: Send + Sync {
    /// Color and depth of frame `index`, which is a place in [`Capture::shots`].
    fn pictures(&self, index: usize) -> Result<(Color, Depth), DatasetError>;
}

/// A frame without its pictures.
pub(super) struct Shot {
    pub sequence: u64,
    pub nanos: u64,
    pub world_from_camera: MaybePose,
    pub extras: FrameExtras,
}

/// The frames of a file.
pub(super) struct Capture {
    pub name: String,
    pub cameras: Cameras,
    pub depth_unit_metres: f64,
    pub shots: Vec<Shot>,
    pub pictures: Box<dyn Pictures>,
    /// See [`Dataset::skipped`].
    pub skipped: Vec<String>,
    /// See [`Dataset::notes`].
    pub notes: Vec<String>,
}

impl Dataset for Capture {
    fn name(&self) -> &str {
        &self.name
    }

    fn len(&self) -> usize {
        self.shots.len()
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
        self.shots[index].sequence
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        let (color, depth) = self.pictures.pictures(index)?;
        let Shot { sequence, nanos, world_from_camera, extras } = &self.shots[index];
        Ok(RgbdFrame {
            sequence: *sequence,
            timestamp_nanos: *nanos,
            color,
            depth,
            world_from_camera: world_from_camera.as_ref().ok().copied(),
            extras: *extras,
        })
    }

    fn moment(&self, index: usize) -> Result<Moment, DatasetError> {
        let Shot { nanos, world_from_camera, .. } = &self.shots[index];
        let world_from_camera = world_from_camera.as_ref().ok().copied();
        Ok(Moment { timestamp_nanos: *nanos, world_from_camera })
    }

    fn no_pose(&self, index: usize) -> Option<&str> {
        self.shots[index].world_from_camera.as_ref().err().map(String::as_str)
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }
}

/// Reads all bytes of a source, of which there are to be `expected`; no more than that is kept in memory.
pub(super) fn exactly(source: impl Read, expected: usize) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    source
        .take(expected as u64 + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| format!("cannot be read or decompressed: {error}"))?;
    match bytes.len() == expected {
        true => Ok(bytes),
        false if bytes.len() > expected => Err(format!("expected {expected} bytes, found more")),
        false => Err(format!("expected {expected} bytes, found {}", bytes.len())),
    }
}

/// The `expected` bytes that zlib compressed.
pub(super) fn inflated(bytes: &[u8], expected: usize) -> Result<Vec<u8>, String> {
    exactly(ZlibDecoder::new(bytes), expected)
}
