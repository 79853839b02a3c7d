//! Recognises places that the camera comes back to.
//!
//! In: a new keyframe, its features, and the keyframes that it is not connected with. Out: measured
//! relative poses that are beyond doubt. Rooms may look alike, so pictures alone do not decide. A pose must
//! also agree with the path that was walked: within twice its uncertainty, or a small share of its length,
//! because the errors of a path may add up more than the graph expects. And a second keyframe must confirm
//! it: another old one at once, or one of the next new ones.

use super::super::keyframes::Keyframe;
use super::super::live_map::LiveMap;
use super::super::pose_covariance::inverted;
use super::super::pose_graph::{Edge, disagreement};
use super::super::tracker::Comparison;
use super::config::ClosureConfig;
use super::parts::{MapParts, poses};
use lexsplat_gpu::GpuError;
use nalgebra::{Isometry3, Matrix6, Vector6};
use serde::{Deserialize, Serialize};

/// The path's covariance may be this many times what the graph expects.
const PATH_FACTOR: f64 = 4.0;
/// The path may also have this share of its length, and of all turns, as an error (standard deviation).
const PATH_SHARE: f64 = 0.01;
/// Largest squared distance in units of the covariance; a right pose has more in 1 of 1000 cases.
const MOST_DISAGREEMENT: f64 = 22.5;
/// Two corrections are the same if they place a camera within this, metres
const SAME_METRES: f64 = 0.03;
/// and radians.
const SAME_RADIANS: f64 = 0.02;
/// A correction waits this many keyframes for another one.
const PATIENCE: usize = 5;
/// From this uncertainty on, metres, the predicted view says nothing.
const FAR_OFF_METRES: f64 = 0.3;
/// Up to this uncertainty, metres, an alignment may start from the predicted pose.
const NEAR_METRES: f64 = 0.1;
/// After this many recognised keyframes no others are compared.
const ENOUGH: usize = 2;
/// A keyframe is also compared without shared features if the new one sees at least this share of it.
const IN_VIEW: f64 = 0.6;

/// An old keyframe that the new one was recognised beside.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(in super::super) struct Recognised {
    /// From the old keyframe to the new one.
    pub edge: Edge,
    /// `moved_from_world`, which brings the new keyframe to where the old one says that it is.
    correction: Isometry3<f64>,
}

/// Remembers a place that nothing has confirmed yet.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(in super::super) struct Detection {
    waiting: Option<Recognised>,
}

impl Detection {
    /// The map was moved at the newest keyframe.
    pub fn moved(&mut self, moved_from_world: &Isometry3<f64>) {
        if let Some(waiting) = &mut self.waiting {
            waiting.correction *= moved_from_world.inverse();
        }
    }

    /// Compares a new keyframe with those that it is not connected with. Returns edges that confirm each
    /// other; none if there are fewer than two.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn look(
        &mut self,
        map: &mut MapParts<'_>,
        keyframe: &Keyframe,
        node: usize,
        config: &ClosureConfig,
    ) -> Result<Vec<Recognised>, GpuError> {
        self.waiting.take_if(|waiting| waiting.edge.second + PATIENCE < node);
        let pose = keyframe.frame.world_from_camera;
        let poses = poses(map.live, &pose);
        let covariances = map.live.graph.covariances_from(node, &poses);
        let uncertain = map.live.graph.uncertainty_from(node, &poses);
        let mut found: Vec<Recognised> = Vec::new();
        for (first, old) in candidates(map.live, keyframe, &uncertain, config) {
            let old_from_camera = old.frame.world_from_camera.inverse() * pose;
            let is_near = uncertain[first] <= NEAR_METRES
                && old.overlap(&keyframe.tracking.camera, &pose) >= IN_VIEW;
            let expected = is_near.then_some(old_from_camera);
            let measured = map.tracker.recognise(&keyframe.features, old, expected)?;
            let Some((measured, path)) = measured.zip(covariances[first]) else { continue };
            let path = path * PATH_FACTOR + share_of_path(&poses[first..]);
            if !agrees_with_path(&pose, old, &measured, &path) {
                tracing::info!(
                    sequence = keyframe.frame.sequence,
                    with = old.frame.sequence,
                    "a place looks like another one that is elsewhere"
                );
                continue;
            }
            found.push(recognised(&pose, old, &measured, [first, node]));
            if found.len() == ENOUGH {
                break;
            }
        }
        Ok(self.confirmed(found, &pose))
    }

    /// The edges that confirm each other, or the one that waits.
    fn confirmed(&mut self, found: Vec<Recognised>, pose: &Isometry3<f64>) -> Vec<Recognised> {
        let all: Vec<Recognised> = found.iter().cloned().chain(self.waiting.take()).collect();
        let agreeing = |one: &Recognised| -> Vec<Recognised> {
            all.iter().filter(|other| is_same(one, other, pose)).cloned().collect()
        };
        let best = found.iter().map(agreeing).max_by_key(Vec::len).unwrap_or_default();
        if best.len() >= 2 {
            return best;
        }
        self.waiting = all.into_iter().next();
        Vec::new()
    }
}

/// Keyframes, with their nodes, that may show what the new one shows: those that share most features, and
/// those that the new one sees most of. `uncertain`: of each node relative to the new one, metres.
fn candidates<'a>(
    live: &'a LiveMap,
    keyframe: &Keyframe,
    uncertain: &[f64],
    config: &ClosureConfig,
) -> Vec<(usize, &'a Keyframe)> {
    let pose = &keyframe.frame.world_from_camera;
    let overlap = |old: &Keyframe| old.overlap(&keyframe.tracking.camera, pose);
    let uncertain = |old: &Keyframe| {
        let node = live.graph.node(old.frame.sequence);
        node.map_or(f64::INFINITY, |node| uncertain[node])
    };
    let is_candidate = |old: &Keyframe| {
        let uncertain = uncertain(old);
        uncertain > config.connected_metres
            && (uncertain > FAR_OFF_METRES || overlap(old) >= config.overlap)
    };
    let mut found = live.keyframes.most_alike(&keyframe.features, config.candidates, is_candidate);
    let in_view = live.keyframes.iter().filter(|old| is_candidate(old));
    let in_view = in_view.filter(|old| uncertain(old) <= NEAR_METRES && overlap(old) >= IN_VIEW);
    // The oldest one has drifted least.
    let oldest = in_view
        .take(1)
        .filter(|old| !found.iter().any(|other| other.frame.sequence == old.frame.sequence));
    let oldest: Vec<&Keyframe> = oldest.collect();
    found.extend(oldest);
    let with_node = |old: &'a Keyframe| Some((live.graph.node(old.frame.sequence)?, old));
    found.into_iter().filter_map(with_node).collect()
}

fn recognised(
    pose: &Isometry3<f64>,
    old: &Keyframe,
    measured: &Comparison,
    [first, second]: [usize; 2],
) -> Recognised {
    let Comparison { keyframe_from_camera, covariance } = *measured;
    let first_from_second = keyframe_from_camera;
    let there = old.frame.world_from_camera * first_from_second;
    Recognised {
        edge: Edge { first, second, first_from_second, covariance, is_closure: true },
        correction: there * pose.inverse(),
    }
}

/// Covariance of an error that is a share of the way along these poses.
fn share_of_path(poses: &[Isometry3<f64>]) -> Matrix6<f64> {
    let motions = poses.windows(2).map(|two| two[0].inverse() * two[1]);
    let (metres, radians) = motions.fold((0.0, 0.0), |(metres, radians), motion| {
        (metres + motion.translation.vector.norm(), radians + motion.rotation.angle())
    });
    let sigma = |i: usize| PATH_SHARE * if i < 3 { metres } else { radians };
    Matrix6::from_diagonal(&Vector6::from_fn(|i, _| sigma(i).powi(2)))
}

/// Whether a measured pose is where the path may have led to. `path`: covariance of the old keyframe relative
/// to the new one.
fn agrees_with_path(
    pose: &Isometry3<f64>,
    old: &Keyframe,
    measured: &Comparison,
    path: &Matrix6<f64>,
) -> bool {
    let expected = pose.inverse() * old.frame.world_from_camera;
    let Comparison { keyframe_from_camera, covariance } = measured;
    let covariance = path + inverted(keyframe_from_camera, covariance);
    let off = disagreement(&expected, &keyframe_from_camera.inverse(), &covariance);
    tracing::debug!(with = old.frame.sequence, off, "compared with the path");
    off <= MOST_DISAGREEMENT
}

/// Whether two corrections place a camera equally.
fn is_same(one: &Recognised, other: &Recognised, pose: &Isometry3<f64>) -> bool {
    let motion = (one.correction * pose).inverse() * (other.correction * pose);
    motion.translation.vector.norm() <= SAME_METRES && motion.rotation.angle() <= SAME_RADIANS
}
