//! The edges of a new keyframe: its pose relative to those that it was tracked with.

use super::super::keyframes::Keyframe;
use super::super::pose_graph::Edge;
use super::parts::MapParts;
use lexsplat_gpu::GpuError;
use nalgebra::Matrix6;

/// Standard deviation, metres and radians, of a pose that no keyframe measured.
const UNMEASURED: f64 = 0.05;
/// The same of poses that were given.
const GIVEN: f64 = 1e-4;

/// The edges that lead to a keyframe whose node is added next.
pub(super) fn edges(map: &mut MapParts<'_>, keyframe: &Keyframe) -> Result<Vec<Edge>, GpuError> {
    let live = &*map.live;
    let second = live.graph.len();
    let pose = &keyframe.frame.world_from_camera;
    let camera = &keyframe.tracking.camera;
    let mut edges = Vec::new();
    if keyframe.is_estimated {
        let references = map.tracker.references_at(&live.keyframes, camera, pose);
        for (reference, measured) in map.tracker.compare(&references)? {
            let Some(first) = live.graph.node(reference.frame.sequence) else { continue };
            edges.push(Edge {
                first,
                second,
                first_from_second: measured.keyframe_from_camera,
                covariance: measured.covariance,
                is_closure: false,
            });
        }
    }
    let Some(newest) = live.keyframes.newest().filter(|_| edges.is_empty()) else {
        return Ok(edges);
    };
    let Some(first) = live.graph.node(newest.frame.sequence) else { return Ok(edges) };
    let sigma = if keyframe.is_estimated { UNMEASURED } else { GIVEN };
    Ok(vec![Edge {
        first,
        second,
        first_from_second: newest.frame.world_from_camera.inverse() * pose,
        covariance: Matrix6::identity() * sigma * sigma,
        is_closure: false,
    }])
}
