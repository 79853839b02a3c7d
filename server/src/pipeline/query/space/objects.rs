//! Objects: clusters of relevant Gaussians with a score and a box.
//!
//! Clustering runs twice. The score of the best first cluster sets the relevancy that core points
//! of the second run must have. Otherwise separate things on a slightly relevant surface (chairs on
//! a carpet) would be one object.
//!
//! Clusters that are patches of larger things are dropped: most of the segments that they lie in
//! is not relevant.

use super::boxes;
use super::clusters::{ClusterLimits, clusters};
use super::gaussian::RelevantGaussian;
use super::neighbours::Neighbours;
use crate::pipeline::query::answer::Object;

/// Least score of core points, as a share of [`ObjectLimits::score`]. A smaller share would join
/// the chairs with the carpet, a larger one would split the seat of a chair from its back.
const CORE_SHARE: f32 = 0.5;

/// Least share of an object's segments that is relevant. A smaller share would report the corner of
/// a bed that resembles a nightstand, a larger one would drop nightstands with an irrelevant side.
const WHOLE_SHARE: f32 = 0.6;

/// Which clusters are reported beside the best one: small or doubtful ones are mostly parts of
/// similar things.
#[derive(Clone, Copy, Debug)]
pub(super) struct ObjectLimits {
    /// Relevancy that all Gaussians exceed.
    pub threshold: f32,
    /// Least score, as a share of the way from the threshold to the best object's score. The way is
    /// measured in logits, which grow as cosines do, while relevancies saturate near 1.
    pub score: f32,
    /// Least number of members, as a share of the largest cluster's.
    pub size: f32,
}

impl ObjectLimits {
    /// The relevancy at this share of the way from the threshold to `best`, in logits.
    fn relevancy_at(self, share: f32, best: f32) -> f32 {
        let threshold = logit(self.threshold);
        1.0 / (1.0 + (-threshold - share * (logit(best) - threshold)).exp())
    }

    /// The objects that are within the limits.
    fn select(self, mut objects: Vec<ClusteredObject>) -> Vec<ClusteredObject> {
        let min_score = self.relevancy_at(self.score, best_score(&objects));
        let largest = objects.iter().map(|one| one.object.points).max().unwrap_or(0);
        objects.retain(|ClusteredObject { object, .. }| {
            object.score >= min_score && object.points as f32 >= self.size * largest as f32
        });
        objects
    }
}

/// An object with the indices of its members.
pub(super) struct ClusteredObject {
    pub object: Object,
    pub members: Vec<usize>,
}

/// The objects, best first. `shares` are the shares of the Gaussians' segments that are relevant.
pub(super) fn find_objects(
    relevant: &[RelevantGaussian],
    shares: &[f32],
    clustering: ClusterLimits,
    limits: ObjectLimits,
) -> Vec<ClusteredObject> {
    let near = Neighbours::new(relevant, clustering.eps_metres);
    let mut is_core = near.core_points();
    let first = scored(relevant, clusters(&near, &is_core, clustering.min_members));
    let min_core = limits.relevancy_at(CORE_SHARE * limits.score, best_score(&first));
    for (is_core, gaussian) in is_core.iter_mut().zip(relevant) {
        *is_core &= gaussian.point.score >= min_core;
    }
    let second = scored(relevant, clusters(&near, &is_core, clustering.min_members));
    whole(limits.select(second), relevant, shares)
}

/// The objects that are no patches of larger things, and the one that is it least in any case.
fn whole(
    mut objects: Vec<ClusteredObject>,
    relevant: &[RelevantGaussian],
    shares: &[f32],
) -> Vec<ClusteredObject> {
    let share = |one: &ClusteredObject| {
        let weight: f32 = one.members.iter().map(|&at| relevant[at].opacity).sum();
        let sum: f32 = one.members.iter().map(|&at| shares[at] * relevant[at].opacity).sum();
        sum / weight.max(1e-6)
    };
    let least = objects.iter().map(share).fold(0.0, f32::max).min(WHOLE_SHARE);
    objects.retain(|one| share(one) >= least);
    objects
}

/// Clusters as objects, best first.
fn scored(relevant: &[RelevantGaussian], clusters: Vec<Vec<usize>>) -> Vec<ClusteredObject> {
    let gaussians = |members: &[usize]| members.iter().map(|&at| relevant[at]).collect::<Vec<_>>();
    let mut objects: Vec<ClusteredObject> = clusters
        .into_iter()
        .map(|members| ClusteredObject { object: object(&gaussians(&members)), members })
        .collect();
    objects.sort_by(|ClusteredObject { object: a, .. }, ClusteredObject { object: b, .. }| {
        b.score.total_cmp(&a.score).then(b.points.cmp(&a.points))
    });
    objects
}

fn object(members: &[RelevantGaussian]) -> Object {
    let positions: Vec<_> = members.iter().map(|member| member.point.position).collect();
    let fitted = boxes::fit(&positions);
    Object {
        score: score(members),
        confidence: 0.0,
        center: fitted.center,
        size: fitted.size,
        rotation: fitted.world_from_box,
        aabb_min: fitted.aabb_min,
        aabb_max: fitted.aabb_max,
        points: members.len(),
        distance: None,
    }
}

/// Mean relevancy of the most relevant quarter, weighted by opacity. The edge of an object is less
/// relevant and does not count.
fn score(members: &[RelevantGaussian]) -> f32 {
    let mut sorted = members.to_vec();
    sorted.sort_by(|a, b| b.point.score.total_cmp(&a.point.score));
    let best = &sorted[..members.len().div_ceil(4)];
    let weight: f32 = best.iter().map(|member| member.opacity).sum();
    best.iter().map(|member| member.point.score * member.opacity).sum::<f32>() / weight.max(1e-6)
}

/// Score of the best object.
fn best_score(objects: &[ClusteredObject]) -> f32 {
    objects.first().map_or(0.0, |best| best.object.score)
}

fn logit(probability: f32) -> f32 {
    let probability = probability.clamp(1e-6, 1.0 - 1e-6);
    (probability / (1.0 - probability)).ln()
}
