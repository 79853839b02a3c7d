//! Searches and segmentations of the whole map.

use super::clusters::ClusterLimits;
use super::features::SpaceFeatures;
use super::filter;
use super::found::FoundObject;
use super::gaussian::{RelevantGaussian, opaque_centre};
use super::objects::{ClusteredObject, ObjectLimits, find_objects};
use super::surface;
use crate::pipeline::network::NetworkError;
use crate::pipeline::query::answer::{LabelledPoint, Object};
use crate::pipeline::query::feature_decoder::FeatureDecoder;
use crate::pipeline::query::labels::{Labels, best_label, shares};
use crate::pipeline::query::relevancy::Prompts;
use crate::pipeline::query::search::{Findings, Search};
use crate::pipeline::snapshot::MapSnapshot;

/// What was found of a kind of thing.
pub(crate) struct Found {
    /// Best first.
    pub objects: Vec<FoundObject>,
    /// Confidence that the map has such a thing, 0..1.
    pub confidence: f32,
}

/// The objects of the kind that the search's prompts name.
pub(crate) fn find(
    search: &Search<'_>,
    features: &SpaceFeatures,
    decoder: &mut FeatureDecoder,
) -> Result<Found, NetworkError> {
    let Search { snapshot, threshold, config, .. } = *search;
    let mut relevant = opaque_gaussians(search, features, decoder)?;
    let confidence = confidence_of(search, &relevant);
    let segments = features.segments(snapshot, &relevant);
    relevant.retain(|gaussian| gaussian.point.score > threshold);
    let shares = segments.relevant_shares(&relevant);
    let clusters =
        ClusterLimits { eps_metres: config.cluster_metres, min_members: config.cluster_points };
    let limits = ObjectLimits { threshold, score: config.object_score, size: config.object_size };
    let clustered = find_objects(&relevant, &shares, clusters, limits).into_iter();
    let objects = clustered.map(|ClusteredObject { object, members }| {
        let members: Vec<_> = members.iter().map(|&at| relevant[at]).collect();
        // By its best quarter, as its score is; no object is surer than the answer.
        let least = members.len().div_ceil(4).min(config.cluster_points);
        let places = members.iter().map(RelevantGaussian::evidenced);
        let confidence = search.calibration.confidence(places, least).min(confidence);
        FoundObject { object: Object { confidence, ..object }, members }
    });
    Ok(Found { objects: objects.collect(), confidence })
}

/// The confidence that some of the Gaussians show what was asked for.
pub(crate) fn confidence_of<'a>(
    search: &Search<'_>,
    gaussians: impl IntoIterator<Item = &'a RelevantGaussian>,
) -> f32 {
    let places = gaussians.into_iter().map(RelevantGaussian::evidenced);
    search.calibration.confidence(places, search.config.cluster_points)
}

/// Objects and points of a query.
pub(crate) fn findings(search: &Search<'_>, features: &SpaceFeatures, found: Found) -> Findings {
    let Search { snapshot, query, .. } = *search;
    let Found { objects: found, confidence } = found;
    let points = query.outputs.points.then(|| {
        let mut members: Vec<_> =
            found.iter().flat_map(|one| one.members.iter().copied()).collect();
        members.sort_unstable_by_key(|member| member.row);
        let mut points = surface::sample(&snapshot.gaussians.language, &members);
        if let Some(within) = query.filter.within {
            points.retain(|point| within.contains(&point.position));
        }
        points
    });
    let mut objects: Vec<Object> = found.into_iter().map(|one| one.object).collect();
    filter::apply(&mut objects, &query.filter);
    objects.truncate(query.max_objects);
    Findings {
        confidence,
        coverage: features.coverage(),
        points,
        objects: query.outputs.objects.then_some(objects),
        ..Findings::default()
    }
}

/// All Gaussians with language that are opaque enough, with their relevancies.
fn opaque_gaussians(
    search: &Search<'_>,
    features: &SpaceFeatures,
    decoder: &mut FeatureDecoder,
) -> Result<Vec<RelevantGaussian>, NetworkError> {
    let relevancies = features.relevancies(decoder, search.snapshot, search.prompts)?;
    // A thing of several kinds is as relevant as of the best one.
    let best = |texts: &[f32]| texts.iter().copied().fold(0.0, f32::max);
    let best = relevancies.chunks_exact(search.prompts.texts()).map(best);
    let scored = features.rows().iter().zip(best);
    let snapshot = search.snapshot;
    Ok(scored.filter_map(|(&row, score)| RelevantGaussian::new(snapshot, row, score)).collect())
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
