//! How uncertain poses are relative to one node: covariances, added up along the paths with the least
//! uncertainty (Dijkstra 1959). Other paths make a pose more certain than this; so it errs on the careful
//! side.

use super::super::pose_covariance::inverted;
use super::edge::{Edge, expected_metres};
use lexsplat_gpu::align::se3::adjoint;
use nalgebra::{Isometry3, Matrix6};

/// A step from one node to the next.
struct Step {
    to: usize,
    /// Covariance of `here_from_to`, here's coordinates.
    covariance: Matrix6<f64>,
    /// Variance of surfaces, metres².
    length: f64,
}

/// The covariance of `from_from_node` for every node; see `PoseGraph::covariances_from`.
pub(super) fn covariances(
    edges: &[Edge],
    from: usize,
    poses: &[Isometry3<f64>],
) -> Vec<Option<Matrix6<f64>>> {
    let steps = steps(edges, poses.len());
    let mut found: Vec<Option<Matrix6<f64>>> = vec![None; poses.len()];
    // Length and covariance of the best path so far to nodes that are not done.
    let mut open: Vec<Option<(f64, Matrix6<f64>)>> = vec![None; poses.len()];
    open[from] = Some((0.0, Matrix6::zeros()));
    while let Some(here) = nearest(&open) {
        let (length, covariance) = open[here].take().expect("it is open");
        found[here] = Some(covariance);
        let from_from_here = adjoint(&(poses[from].inverse() * poses[here]));
        for step in steps[here].iter().filter(|step| found[step.to].is_none()) {
            let farther = length + step.length;
            if open[step.to].is_none_or(|(other, _)| farther < other) {
                let added = from_from_here * step.covariance * from_from_here.transpose();
                open[step.to] = Some((farther, covariance + added));
            }
        }
    }
    found
}

fn nearest(open: &[Option<(f64, Matrix6<f64>)>]) -> Option<usize> {
    let lengths = open.iter().enumerate();
    let lengths = lengths.filter_map(|(at, open)| open.map(|(length, _)| (length, at)));
    lengths.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, at)| at)
}

/// The steps that lead away from each node.
fn steps(edges: &[Edge], nodes: usize) -> Vec<Vec<Step>> {
    let mut steps: Vec<Vec<Step>> = (0..nodes).map(|_| Vec::new()).collect();
    for edge in edges {
        let length = expected_metres(&edge.covariance).powi(2);
        let back = inverted(&edge.first_from_second, &edge.covariance);
        steps[edge.first].push(Step { to: edge.second, covariance: edge.covariance, length });
        steps[edge.second].push(Step { to: edge.first, covariance: back, length });
    }
    steps
}
