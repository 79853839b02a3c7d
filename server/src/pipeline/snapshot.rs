//! An immutable copy of a map for readers. Queries, renders and exports never touch the live map.

use super::compressor::OnlineStage;
use super::frame::{Intrinsics, TrackedFrame};
use lexsplat_gpu::HostGaussians;
use std::sync::Arc;

/// A map at one revision. Cloning shares the data.
#[derive(Clone)]
pub struct MapSnapshot {
    /// The map's name.
    pub map: String,
    /// Increases with every snapshot.
    pub revision: u64,
    /// Sequence number of the newest frame that the map had then, tracked or lost.
    pub through: Option<u64>,
    /// All Gaussians. Their language codes belong to `online`'s version; a code of zeros means "no language
    /// yet".
    pub gaussians: Arc<HostGaussians>,
    /// The online compressor (32 to 15 dimensions) that decodes the codes.
    pub online: Arc<dyn OnlineStage>,
    /// The camera of the stream; `None` while the map is empty.
    pub intrinsics: Option<Intrinsics>,
    /// Every tracked frame, in order.
    pub trajectory: Arc<Vec<TrackedFrame>>,
    /// The keyframes, in order.
    pub keyframes: Arc<Vec<KeyframeInfo>>,
}

/// A keyframe as readers see it.
#[derive(Clone, Debug)]
pub struct KeyframeInfo {
    /// Its place on the trajectory.
    pub frame: TrackedFrame,
    /// Its camera.
    pub intrinsics: Intrinsics,
    /// `[height * width * 3]` RGB as received.
    pub rgb: Arc<[u8]>,
    /// Whether its language has been written into the map.
    pub has_language: bool,
}

impl MapSnapshot {
    /// A tracked frame, by sequence.
    pub fn tracked(&self, sequence: u64) -> Option<&TrackedFrame> {
        let at = self.trajectory.binary_search_by_key(&sequence, |frame| frame.sequence).ok()?;
        Some(&self.trajectory[at])
    }
}
