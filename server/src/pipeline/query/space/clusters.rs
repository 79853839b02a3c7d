//! Clusters of Gaussians: DBSCAN (Ester et al. 1996) over balls.
//!
//! The distance of two Gaussians is the gap between their balls. It follows their sizes: a thing
//! seen from afar has few large Gaussians, a thing seen from near many small ones. A core point has
//! at least three neighbours within eps, itself included. Connected core points are one cluster.
//! Other points join the cluster of their nearest core point, or are noise. Clusters with too few
//! members are noise, too.

use super::neighbours::Neighbours;
use rayon::prelude::*;
use rustc_hash::FxHashMap as HashMap;

/// Parameters of the clustering.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClusterLimits {
    /// Gap below which two balls are neighbours (eps), metres.
    pub eps_metres: f32,
    /// Members of the smallest cluster.
    pub min_members: usize,
}

/// Indices of the members of each cluster with at least `min_members`, in the order of their first
/// members. `is_core` marks the core points.
pub(super) fn clusters(near: &Neighbours, is_core: &[bool], min_members: usize) -> Vec<Vec<usize>> {
    let mut components = near.core_components(is_core);
    let nearest_core = |at: usize| {
        if is_core[at] {
            return Some(at);
        }
        let gap = |other: &usize| near.gap(at, *other);
        near.of(at).filter(|&other| is_core[other]).min_by(|a, b| gap(a).total_cmp(&gap(b)))
    };
    let cores: Vec<Option<usize>> = (0..is_core.len()).into_par_iter().map(nearest_core).collect();
    let mut cluster_of_component: HashMap<usize, usize> = HashMap::default();
    let mut clusters: Vec<Vec<usize>> = Vec::new();
    for (at, core) in cores.into_iter().enumerate() {
        let Some(core) = core else { continue };
        let cluster =
            *cluster_of_component.entry(components.representative(core)).or_insert_with(|| {
                clusters.push(Vec::new());
                clusters.len() - 1
            });
        clusters[cluster].push(at);
    }
    clusters.retain(|members| members.len() >= min_members);
    clusters
}
