//! Searches and segmentations of one view.

use super::components;
use super::features::ViewFeatures;
use crate::pipeline::query::answer::{Heatmap, LabelImage};
use crate::pipeline::query::labels::{Labels, pixel_labels, shares};
use crate::pipeline::query::relevancy::{Evidenced, Prompts, RelevancyMap};
use crate::pipeline::query::search::{Findings, Search};
use lexsplat_gpu::Camera;

/// Heat map, uncertainty, mask, boxes and peak of a query, and its confidence. `share`: the part of each pixel
/// that shows what is meant, at the size of the features; `None`: all of it is meant.
pub(crate) fn search(
    search: &Search<'_>,
    features: &ViewFeatures,
    camera: &Camera,
    share: Option<&[f32]>,
) -> Findings {
    let Search { query, threshold, .. } = *search;
    let side = search.config.smoothing(query.smoothing_pixels, camera.width);
    let relevancy = features.best_relevancy(search.prompts, camera, share).smoothed(side);
    let least = components::min_pixels(&relevancy);
    let outputs = query.outputs;
    let places: Vec<Evidenced> = relevancy
        .values
        .iter()
        .zip(features.spreads(camera))
        .map(|(&relevancy, spread)| Evidenced { relevancy, spread })
        .collect();
    let uncertainty = |place: &Evidenced| search.calibration.uncertainty(*place, threshold);
    let image = |values| Heatmap { width: camera.width, height: camera.height, values };
    Findings {
        confidence: search.calibration.confidence(places.iter().copied(), least),
        coverage: features.coverage(),
        mask: outputs.mask.then(|| components::mask(&relevancy, threshold)),
        boxes: outputs.boxes.then(|| components::boxes(&relevancy, threshold)),
        peak: components::peak(&relevancy),
        uncertainty: outputs.uncertainty.then(|| image(places.iter().map(uncertainty).collect())),
        heatmap: outputs.heatmap.then(|| image(relevancy.values)),
        ..Findings::default()
    }
}

/// The label of each pixel: the most relevant text above the threshold. `side` is that of the mean
/// filter, pixels.
pub(crate) fn segment(
    features: &ViewFeatures,
    prompts: &Prompts,
    camera: &Camera,
    side: usize,
    threshold: f32,
) -> Labels {
    let maps = features.relevancies(prompts, camera);
    let maps: Vec<RelevancyMap> = maps.into_iter().map(|map| map.smoothed(side)).collect();
    let labels = pixel_labels(&maps, threshold);
    Labels {
        coverage: features.coverage(),
        shares: shares(labels.iter().copied(), prompts.texts()),
        image: Some(LabelImage { width: camera.width, height: camera.height, labels }),
        points: None,
    }
}
