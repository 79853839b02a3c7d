//! Status of a map, and the counters that it is read from.

use super::super::frame::TrackingState;
use super::super::input_warning::InputWarning;
use super::super::up::MapUp;
use std::sync::atomic::{AtomicBool, AtomicU64};

/// How far a map is refined at the size of its camera's pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Refinement {
    /// It never is.
    #[default]
    Off,
    /// Frames come first, and the steps that they earned; with the clock `per_frame` also as long as nobody
    /// waits for it.
    Waiting,
    /// It is being refined.
    Refining,
    /// The map does not improve any more, or had all the sweeps that it may have.
    Converged,
}

impl Refinement {
    /// The name on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Waiting => "waiting",
            Self::Refining => "refining",
            Self::Converged => "converged",
        }
    }

    /// Whether nothing is left to refine.
    pub(super) fn is_done(self) -> bool {
        matches!(self, Self::Off | Self::Converged)
    }
}

/// Status of a map.
#[derive(Clone, Debug)]
pub struct MapStatus {
    /// The map's name.
    pub name: String,
    /// Revision of the map that readers can have now.
    pub revision: u64,
    /// Frames that passed the checks.
    pub frames_received: u64,
    /// Frames that were given or found a pose.
    pub frames_tracked: u64,
    /// Frames whose pose was not found.
    pub frames_lost: u64,
    /// Frames that were accepted and never mapped, because the map had failed.
    pub frames_dropped: u64,
    /// Frames that did not pass the checks.
    pub frames_refused: u64,
    /// Keyframes.
    pub keyframes: u64,
    /// Gaussians.
    pub gaussians: u64,
    /// Device memory of the Gaussians, bytes.
    pub gpu_bytes: u64,
    /// Memory of the keyframes' images and codes on host and device, bytes.
    pub keyframe_bytes: u64,
    /// Whether the newest frame has a pose.
    pub tracking_state: TrackingState,
    /// Version of the online compressor.
    pub olae_version: u64,
    /// Frames that wait in the queue.
    pub queue_depth: usize,
    /// Frames that fit into the queue.
    pub queue_capacity: usize,
    /// Whether no frame waits and no work is left.
    pub settled: bool,
    /// How far the map is refined.
    pub refinement: Refinement,
    /// Why the map takes no more frames, if so.
    pub failure: Option<String>,
    /// What is wrong with the recording that the map was rebuilt from, if anything.
    pub recording_damage: Option<String>,
    /// What is probably wrong with the frames that were sent, one entry for each kind.
    pub input_warnings: Vec<InputWarning>,
    /// The direction up; `None` while the map is empty.
    pub up: Option<MapUp>,
}

impl MapStatus {
    /// The status of a map that is not in the engine.
    pub(crate) fn absent(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            revision: 0,
            frames_received: 0,
            frames_tracked: 0,
            frames_lost: 0,
            frames_dropped: 0,
            frames_refused: 0,
            keyframes: 0,
            gaussians: 0,
            gpu_bytes: 0,
            keyframe_bytes: 0,
            tracking_state: TrackingState::Empty,
            olae_version: 0,
            queue_depth: 0,
            queue_capacity: 0,
            settled: false,
            refinement: Refinement::Off,
            failure: None,
            recording_damage: None,
            input_warnings: Vec::new(),
            up: None,
        }
    }
}

/// Counters that the map's thread writes and [`MapStatus`] reads.
#[derive(Default)]
pub(in super::super) struct Counters {
    pub revision: AtomicU64,
    pub received: AtomicU64,
    pub tracked: AtomicU64,
    pub lost: AtomicU64,
    pub dropped: AtomicU64,
    pub refused: AtomicU64,
    pub keyframes: AtomicU64,
    pub gaussians: AtomicU64,
    pub gpu_bytes: AtomicU64,
    pub keyframe_bytes: AtomicU64,
    pub olae_version: AtomicU64,
    /// Frames that were accepted and are not mapped yet.
    pub unsettled: AtomicU64,
    /// Whether work is left on mapped frames.
    pub working: AtomicBool,
}
