//! Closes loops: when the camera comes back to a place, the drift since the first visit is removed.
//!
//! In: each new keyframe, before it is mapped. It becomes a node of the pose graph, with edges to the
//! keyframes that it was tracked with (`odometry.rs`). Older keyframes that the newest motion is not
//! connected with are recognised and compared (`detect.rs`). Out: corrected poses of all keyframes, and
//! Gaussians that moved with them (`apply.rs`).
//!
//! A keyframe is connected if the graph knows its place relative to the newest keyframe well. The tracker
//! aligns frames with connected keyframes only; otherwise a pose would lie between two places that drifted
//! apart.

mod apply;
mod config;
mod detect;
mod odometry;
mod parts;
#[cfg(test)]
mod tests;

pub use config::ClosureConfig;
pub(super) use detect::Detection;
pub(super) use parts::MapParts;

use super::keyframes::Keyframe;
use super::live_map::LiveMap;
use super::pose_graph::Edge;
use detect::Recognised;
use lexsplat_gpu::GpuError;
use nalgebra::Isometry3;
use parts::poses;

/// A closure that disagrees by more than this after all poses were adapted is wrong: squared, in units of its
/// covariance.
const MOST_DISAGREEMENT: f64 = 4.0 * 22.5;

/// Looks for loops and closes them.
pub(super) struct Closure {
    config: ClosureConfig,
    detection: Detection,
}

impl Closure {
    pub fn new(config: &ClosureConfig) -> Self {
        Self { config: config.clone(), detection: Detection::default() }
    }

    /// A place that waits for another one to confirm it.
    pub fn save(&self) -> Detection {
        self.detection.clone()
    }

    /// Puts back what was saved.
    pub fn restore(&mut self, saved: Detection) {
        self.detection = saved;
    }

    /// Forgets what it waits for: the map was emptied.
    pub fn begin_anew(&mut self) {
        self.detection = Detection::default();
    }

    /// Makes a keyframe, which is not in the store yet, a part of the graph. If it closes a loop that moves
    /// the map, the keyframe has its corrected pose afterwards. Returns whether the map was moved.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn join(
        &mut self,
        map: &mut MapParts<'_>,
        keyframe: &mut Keyframe,
    ) -> Result<bool, GpuError> {
        if !self.config.enabled {
            return Ok(false);
        }
        let edges = odometry::edges(map, keyframe)?;
        let node = map.live.graph.add_node(keyframe.frame.sequence, !keyframe.is_estimated);
        map.live.gaussians.set_owner(node as u32)?;
        edges.into_iter().for_each(|edge| map.live.graph.add_edge(edge));
        let closed = keyframe.is_estimated && self.close(map, keyframe, node)?;
        self.connect(map.live, node, &keyframe.frame.world_from_camera);
        Ok(closed)
    }

    /// Closes a loop with the new keyframe if there is one. Returns whether the map was moved.
    fn close(
        &mut self,
        map: &mut MapParts<'_>,
        keyframe: &mut Keyframe,
        node: usize,
    ) -> Result<bool, GpuError> {
        let found = self.detection.look(map, keyframe, node, &self.config)?;
        if found.is_empty() {
            return Ok(false);
        }
        let before = poses(map.live, &keyframe.frame.world_from_camera);
        let mut graph = map.live.graph.clone();
        found.iter().for_each(|Recognised { edge, .. }| graph.add_edge(edge.clone()));
        let after = graph.solve(&before);
        let is_wrong = |edge: &Edge| edge.disagreement(&after) > MOST_DISAGREEMENT;
        if found.iter().any(|found| is_wrong(&found.edge)) {
            tracing::info!(sequence = keyframe.frame.sequence, "a loop does not fit the path");
            return Ok(false);
        }
        map.live.graph = graph;
        let moved = after[node] * before[node].inverse();
        let metres = moved_metres(&before[node], &after[node]);
        let radians = before[node].rotation.angle_to(&after[node].rotation);
        let sequence = keyframe.frame.sequence;
        let with = map.live.graph.sequences().nth(found[0].edge.first);
        if !apply::is_worth_it(&before, &after, self.config.correction_metres) {
            tracing::debug!(sequence, with, metres, radians, "a loop agrees with the map");
            return Ok(false);
        }
        tracing::info!(sequence, with, metres, radians, "closed a loop");
        apply::apply(map, keyframe, &before, &after)?;
        self.detection.moved(&moved);
        Ok(true)
    }

    /// Tells the tracker which keyframes are connected with a node.
    fn connect(&self, live: &mut LiveMap, node: usize, newest: &Isometry3<f64>) {
        let poses = poses(live, newest);
        let uncertain = live.graph.uncertainty_from(node, &poses);
        for at in 0..live.keyframes.len() {
            let keyframe = live.keyframes.at_mut(at);
            let node = live.graph.node(keyframe.frame.sequence);
            keyframe.is_connected =
                node.is_none_or(|node| uncertain[node] <= self.config.connected_metres);
        }
    }

    /// The camera was found again beside this keyframe: from now on it moves on from there.
    pub fn found_beside(&mut self, live: &mut LiveMap, sequence: u64) {
        if let Some(node) = live.graph.node(sequence).filter(|_| self.config.enabled) {
            self.connect(live, node, &Isometry3::identity());
        }
    }
}

fn moved_metres(before: &Isometry3<f64>, after: &Isometry3<f64>) -> f64 {
    (after.translation.vector - before.translation.vector).norm()
}
