//! What a tracker knows, to be kept and put back.

use super::super::downsampled_frame::DownsampledFrame;
use super::super::frame::TrackingState;
use super::candidate::PoseCandidate;
use super::judge::Judge;
use super::motion::Motion;
use super::young_map::YoungMap;
use serde::{Deserialize, Serialize};

/// See `Tracker` for the fields.
#[derive(Serialize, Deserialize)]
pub(in super::super) struct TrackerState {
    pub(super) motion: Motion,
    pub(super) exposure: [f64; 2],
    pub(super) state: TrackingState,
    pub(super) judge: Judge,
    pub(super) young: YoungMap,
    /// The last frame whose pose was estimated, at the tracker's resolution.
    pub(super) last: Option<(DownsampledFrame, PoseCandidate)>,
}
