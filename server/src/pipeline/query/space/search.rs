//! Searches and segmentations of the whole map.

use super::clusters::ClusterLimits;
use super::features::SpaceFeatures;
use super::filter;
use super::gaussian::{RelevantGaussian, opaque_centre};
use super::objects::{ObjectLimits, find_objects};
use super::surface;
use crate::pipeline::network::NetworkError;
use crate::pipeline::query::answer::LabelledPoint;
use crate::pipeline::query::feature_decoder::FeatureDecoder;
use crate::pipeline::query::labels::{Labels, best_label, shares};
use crate::pipeline::query::relevancy::Prompts;
use crate::pipeline::query::search::{Findings, Search};
use crate::pipeline::snapshot::MapSnapshot;

/// Objects and points of a query, and its confidence.
pub(crate) fn search(
    search: &Search<'_>,
    features: &SpaceFeatures,
    decoder: &mut FeatureDecoder,
) -> Result<Findings, NetworkError> {
    let Search { snapshot, query, threshold, config, .. } = *search;
    let mut relevant = opaque_gaussians(search, features, decoder)?;
    let scores = relevant.iter().map(|gaussian| gaussian.point.score);
    let confidence = search.calibration.confidence(scores, config.cluster_points);
    let segments = features.segments(snapshot, &relevant);
    relevant.retain(|gaussian| gaussian.point.score > threshold);
    let shares = segments.relevant_shares(&relevant);
    let clusters =
        ClusterLimits { eps_metres: config.cluster_metres, min_members: config.cluster_points };
    let limits = ObjectLimits { threshold, score: config.object_score, size: config.object_size };
    let (mut objects, members) = find_objects(&relevant, &shares, clusters, limits);
    filter::apply(&mut objects, &query.filter);
    let points = query.outputs.points.then(|| {
        let members: Vec<_> = members.iter().map(|&at| relevant[at]).collect();
        let mut points = surface::sample(&snapshot.gaussians.language, &members);
        if let Some(within) = query.filter.within {
            points.retain(|point| within.contains(&point.position));
        }
        points
    });
    objects.truncate(query.max_objects);
    Ok(Findings {
        confidence,
        coverage: features.coverage(),
        points,
        objects: query.outputs.objects.then_some(objects),
        ..Findings::default()
    })
}

/// All Gaussians with language that are opaque enough, with their relevancies.
fn opaque_gaussians(
    search: &Search<'_>,
    features: &SpaceFeatures,
    decoder: &mut FeatureDecoder,
) -> Result<Vec<RelevantGaussian>, NetworkError> {
    let relevancies = features.relevancies(decoder, search.snapshot, search.prompts)?;
    let scored = features.rows().iter().zip(relevancies);
    let gaussians = &search.snapshot.gaussians;
    Ok(scored.filter_map(|(&row, score)| RelevantGaussian::new(gaussians, row, score)).collect())
}

/// The label of each Gaussian that has language and is opaque enough: the most relevant text above
/// the threshold.
pub(crate) fn segment(
    features: &SpaceFeatures,
    decoder: &mut FeatureDecoder,
    snapshot: &MapSnapshot,
    prompts: &Prompts,
    threshold: f32,
) -> Result<Labels, NetworkError> {
    let relevancies = features.relevancies(decoder, snapshot, prompts)?;
    let scored = features.rows().iter().zip(relevancies.chunks_exact(prompts.texts()));
    let points: Vec<LabelledPoint> = scored
        .filter_map(|(&row, relevancies)| {
            let (position, _) = opaque_centre(&snapshot.gaussians, row)?;
            let (label, score) = best_label(relevancies.iter().copied(), threshold);
            Some(LabelledPoint { position, label, score })
        })
        .collect();
    Ok(Labels {
        coverage: features.coverage(),
        shares: shares(points.iter().map(|point| point.label), prompts.texts()),
        image: None,
        points: Some(points),
    })
}
