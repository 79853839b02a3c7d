//! A recording: what every reader of files comes to.
//!
//! A reader opens its files, builds a [`Recording`] and reads pictures when they are asked for; these are
//! never in memory as a whole.

use super::error::DatasetError;
use super::frame::{Cameras, Color, Depth, FrameExtras, FrameRate, Intrinsics, Moment, RgbdFrame};
use super::source::Dataset;
use nalgebra::Isometry3;
use std::fmt;

/// A pose, or the reason why there is no valid one.
pub(crate) type MaybePose = Result<Isometry3<f64>, String>;

/// Reads the pictures of a recording.
pub(crate) trait Pictures: Send + Sync {
    /// Color and depth of frame `index`, which is a place in [`Recording::shots`]; errors name its number.
    fn pictures(&self, index: usize, sequence: u64) -> Result<(Color, Depth), DatasetError>;
}

/// A frame without its pictures.
#[derive(Clone, Debug)]
pub(crate) struct Shot {
    pub sequence: u64,
    pub nanos: u64,
    pub world_from_camera: MaybePose,
    pub extras: FrameExtras,
}

/// The frames of a recording.
pub(crate) struct Recording {
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

impl Recording {
    /// Counts times anew by the numbers of the frames.
    pub fn count_times(&mut self, rate: FrameRate) {
        self.shots.iter_mut().for_each(|shot| shot.nanos = rate.nanos(shot.sequence));
    }
}

impl fmt::Debug for Recording {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let frames = self.shots.len();
        f.debug_struct("Recording").field("name", &self.name).field("frames", &frames).finish()
    }
}

impl Shot {
    /// A frame about which no more is known.
    pub fn new(sequence: u64, nanos: u64, world_from_camera: MaybePose) -> Self {
        Self { sequence, nanos, world_from_camera, extras: FrameExtras::default() }
    }

    /// The frame with its pictures.
    pub fn frame(&self, (color, depth): (Color, Depth)) -> RgbdFrame {
        RgbdFrame {
            sequence: self.sequence,
            timestamp_nanos: self.nanos,
            color,
            depth,
            world_from_camera: self.pose(),
            extras: self.extras,
        }
    }

    fn pose(&self) -> Option<Isometry3<f64>> {
        self.world_from_camera.as_ref().ok().copied()
    }
}

impl Dataset for Recording {
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
        let shot = &self.shots[index];
        Ok(shot.frame(self.pictures.pictures(index, shot.sequence)?))
    }

    fn moment(&self, index: usize) -> Result<Moment, DatasetError> {
        let shot = &self.shots[index];
        Ok(Moment { timestamp_nanos: shot.nanos, world_from_camera: shot.pose() })
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
