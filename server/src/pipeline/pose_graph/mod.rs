//! The pose graph: what is known of the poses of keyframes relative to each other.
//!
//! In: keyframes as nodes, and measured relative poses with covariances as edges. Out: how uncertain the
//! pose of one node is relative to another (`paths.rs`), and the poses that fit all edges best (`solve.rs`).
//! The poses themselves are not kept here; they belong to the keyframes. Nothing here knows images.
//!
//! A covariance belongs to a left perturbation tau = [rho metres, theta radians]: if `a_from_b` was measured,
//! the truth is Exp(tau) a_from_b, in the coordinates of a.

mod edge;
mod paths;
mod solve;

#[cfg(test)]
mod tests;

pub(super) use edge::{Edge, disagreement};

use super::pose_covariance::carried;
use nalgebra::{Isometry3, Matrix6};
use serde::{Deserialize, Serialize};

/// A keyframe in the graph.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Node {
    sequence: u64,
    /// Whether its pose is known and never changes.
    is_fixed: bool,
}

/// Keyframes, also those that were forgotten, and the edges between them.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct PoseGraph {
    /// In order of their sequence numbers.
    nodes: Vec<Node>,
    edges: Vec<Edge>,
}

impl PoseGraph {
    /// Adds a keyframe, later than all before; returns its index. The first node is always fixed.
    pub fn add_node(&mut self, sequence: u64, is_fixed: bool) -> usize {
        self.nodes.push(Node { sequence, is_fixed: is_fixed || self.nodes.is_empty() });
        self.nodes.len() - 1
    }

    pub fn add_edge(&mut self, edge: Edge) {
        debug_assert!(edge.first.max(edge.second) < self.nodes.len(), "both nodes are there");
        self.edges.push(edge);
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Index of a keyframe.
    pub fn node(&self, sequence: u64) -> Option<usize> {
        self.nodes.binary_search_by_key(&sequence, |node| node.sequence).ok()
    }

    /// The poses `world_from_node` that fit the edges best, from those that the nodes have now.
    pub fn solve(&self, poses: &[Isometry3<f64>]) -> Vec<Isometry3<f64>> {
        let are_fixed = self.nodes.iter().map(|node| node.is_fixed);
        solve::Problem::new(&self.edges, are_fixed).solve(poses)
    }

    /// The covariance of `from_from_node` for every node, in the coordinates of `from`; `None` for nodes that
    /// no path leads to. `poses`: `world_from_node` of all nodes.
    pub fn covariances_from(
        &self,
        from: usize,
        poses: &[Isometry3<f64>],
    ) -> Vec<Option<Matrix6<f64>>> {
        paths::covariances(&self.edges, from, poses)
    }

    /// How far surfaces that a node shows are misplaced relative to `from`, metres; infinite for nodes that
    /// no path leads to.
    pub fn uncertainty_from(&self, from: usize, poses: &[Isometry3<f64>]) -> Vec<f64> {
        let covariances = self.covariances_from(from, poses);
        let at_node = |(node, covariance): (usize, &Option<Matrix6<f64>>)| {
            let node_from_from = poses[node].inverse() * poses[from];
            covariance.as_ref().map_or(f64::INFINITY, |covariance| {
                edge::expected_metres(&carried(&node_from_from, covariance))
            })
        };
        covariances.iter().enumerate().map(at_node).collect()
    }

    /// Sequence numbers of all keyframes, in the order of the nodes.
    pub fn sequences(&self) -> impl Iterator<Item = u64> {
        self.nodes.iter().map(|node| node.sequence)
    }
}
