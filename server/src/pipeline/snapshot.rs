//! An immutable view of a map for readers: queries, renders and exports never touch live state.

use super::compressor::OnlineStage;
use super::frame::Intrinsics;
use lexsplat_gpu::HostGaussians;
use nalgebra::Isometry3;
use std::sync::Arc;

/// A map as it was at one revision. Cheap to share, never changed.
#[derive(Clone)]
pub struct MapSnapshot {
    /// The map's name.
    pub map: String,
    /// Increases with every snapshot.
    pub revision: u64,
    /// All Gaussians; language codes are of `online`'s version. A code of all zeros is "no language yet".
    pub gaussians: Arc<HostGaussians>,
    /// The online compressor's state (32 -> 15) that the codes belong to.
    pub online: Arc<dyn OnlineStage>,
    /// The camera of the stream; `None` while the map is empty.
    pub intrinsics: Option<Intrinsics>,
    /// Every tracked frame, in order.
    pub trajectory: Arc<Vec<TrackedFrame>>,
    /// The keyframes, in order.
    pub keyframes: Arc<Vec<KeyframeInfo>>,
}

/// A tracked frame's place on the trajectory.
#[derive(Clone, Copy, Debug)]
pub struct TrackedFrame {
    /// The frame's sequence.
    pub sequence: u64,
    /// When it was taken.
    pub timestamp_nanos: u64,
    /// Where the camera was.
    pub world_from_camera: Isometry3<f64>,
    /// (a, b): the frame shows exp(a) of the map's color + b.
    pub exposure: [f32; 2],
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
