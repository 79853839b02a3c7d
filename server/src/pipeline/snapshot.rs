//! An immutable copy of a map for readers. Queries, renders and exports never touch the live map.

use super::compressor::OnlineStage;
use super::evidence::{Evidence, Sightings};
use super::frame::{Intrinsics, TrackedFrame};
use super::up::MapUp;
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
    /// Every tracked frame, in order.
    pub trajectory: Arc<Vec<TrackedFrame>>,
    /// The keyframes, in order.
    pub keyframes: Arc<Vec<KeyframeInfo>>,
    /// What the keyframes say of the Gaussians' language.
    pub evidence: Arc<Evidence>,
    /// The direction up; `None` while the map is empty.
    pub up: Option<MapUp>,
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
    /// What the keyframes say of each Gaussian's language; computed when it is first asked for.
    pub(crate) fn sightings(&self) -> &[Sightings] {
        self.evidence.sightings(&self.gaussians, &*self.online)
    }

    /// A tracked frame, by sequence.
    pub fn tracked(&self, sequence: u64) -> Option<&TrackedFrame> {
        let at = self.trajectory.binary_search_by_key(&sequence, |frame| frame.sequence).ok()?;
        Some(&self.trajectory[at])
    }

    /// The camera that took a frame: that of the keyframe nearest in number, since several cameras may feed
    /// a map one after the other. `None` while the map is empty.
    pub fn camera(&self, sequence: u64) -> Option<Intrinsics> {
        let after = self.keyframes.partition_point(|info| info.frame.sequence < sequence);
        let around = &self.keyframes[after.saturating_sub(1)..self.keyframes.len().min(after + 1)];
        let nearest = around.iter().min_by_key(|info| info.frame.sequence.abs_diff(sequence));
        nearest.map(|info| info.intrinsics)
    }
}
