//! What a loop closure works on.

use super::super::live_map::LiveMap;
use super::super::tracker::Tracker;
use lexsplat_gpu::Trainer;
use nalgebra::Isometry3;

/// A map that is corrected when loops are closed.
pub(in super::super) struct MapParts<'a> {
    pub live: &'a mut LiveMap,
    pub trainer: &'a mut Trainer,
    pub tracker: &'a mut Tracker,
}

/// Poses of all nodes; the last may be a keyframe that is not in the store yet.
pub(super) fn poses(live: &LiveMap, newest: &Isometry3<f64>) -> Vec<Isometry3<f64>> {
    let pose = |sequence| live.keyframes.frame(sequence).map(|frame| frame.world_from_camera);
    live.graph.sequences().map(|sequence| pose(sequence).unwrap_or(*newest)).collect()
}
