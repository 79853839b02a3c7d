//! Decoded features of one view.
//!
//! Codes are rendered at about the resolution of the paper's labels: finer ones would add no
//! detail, and the cost of decoding grows with the number of pixels.

use crate::pipeline::bilinear;
use crate::pipeline::evidence::REFERENCE_SPREAD;
use crate::pipeline::network::NetworkError;
use crate::pipeline::query::answer::Timing;
use crate::pipeline::query::camera;
use crate::pipeline::query::error::QueryError;
use crate::pipeline::query::feature_decoder::FeatureDecoder;
use crate::pipeline::query::relevancy::{Prompts, RelevancyMap};
use crate::pipeline::query::render::Scene;
use crate::pipeline::query::stopwatch::Stopwatch;
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::{Camera, HostGaussians, LanguageImage};
use std::sync::{Arc, Weak};

/// Opacity of the language head below which a pixel has no language.
const MIN_OPACITY: f32 = 0.5;
/// Length of a blended code, as a share of its opacity, below which a pixel has no language: its
/// Gaussians have no codes yet, or contrary ones.
const MIN_LENGTH: f32 = 0.2;

/// Part of a pixel that shows what is meant, above which the pixel counts.
const MIN_SHARE: f32 = 0.4;

/// Features of those pixels of a low-resolution image that have language.
pub(crate) struct ViewFeatures {
    width: usize,
    height: usize,
    /// Indices of the pixels with language, in order.
    pixels: Vec<u32>,
    /// `[pixels, D]`, unit length.
    features: Vec<f32>,
    /// `[height * width]`, the spread of codes over keyframes, greater than 0.
    spreads: Vec<f32>,
}

impl ViewFeatures {
    /// Share of the pixels with language.
    pub(crate) fn coverage(&self) -> f32 {
        self.pixels.len() as f32 / (self.width * self.height) as f32
    }

    /// For each text the relevancy of each pixel at the size of the view, not smoothed; 0 where
    /// there is no language.
    pub(crate) fn relevancies(&self, prompts: &Prompts, camera: &Camera) -> Vec<RelevancyMap> {
        let relevancies = prompts.relevancies(&self.features);
        let texts = prompts.texts();
        (0..texts)
            .map(|text| self.map(relevancies.iter().skip(text).step_by(texts).copied(), camera))
            .collect()
    }

    /// The same for the best of the texts; 0 also where pixels do not show enough of what is meant.
    /// `share`: for each pixel of these features the part that it shows; `None`: all of it is meant.
    pub(crate) fn best_relevancy(
        &self,
        prompts: &Prompts,
        camera: &Camera,
        share: Option<&[f32]>,
    ) -> RelevancyMap {
        let relevancies = prompts.relevancies(&self.features);
        let best = relevancies
            .chunks_exact(prompts.texts())
            .map(|texts| texts.iter().copied().fold(0.0, f32::max));
        let is_meant = |pixel: u32| share.is_none_or(|share| share[pixel as usize] > MIN_SHARE);
        let meant = best.zip(&self.pixels);
        self.map(meant.map(|(best, pixel)| if is_meant(*pixel) { best } else { 0.0 }), camera)
    }

    /// The spread of codes over keyframes at each pixel of the view, `[height * width]`, greater than 0.
    pub(crate) fn spreads(&self, camera: &Camera) -> Vec<f32> {
        let (size, view) =
            ((self.width, self.height), (camera.width as usize, camera.height as usize));
        bilinear::resized(&self.spreads, size, view)
    }

    /// Relevancies of the pixels with language as a map of the size of the view.
    fn map(&self, relevancies: impl Iterator<Item = f32>, camera: &Camera) -> RelevancyMap {
        let mut values = vec![0.0; self.width * self.height];
        for (&pixel, relevancy) in self.pixels.iter().zip(relevancies) {
            values[pixel as usize] = relevancy;
        }
        RelevancyMap { width: self.width, height: self.height, values }
            .resized(camera.width as usize, camera.height as usize)
    }
}

/// The features of the most recent view: successive questions are often about the same one.
#[derive(Default)]
pub(crate) struct ViewFeatureCache {
    last: Option<(Weak<HostGaussians>, Camera, Arc<ViewFeatures>)>,
}

impl ViewFeatureCache {
    /// The features of a view of at most `columns` columns, rendered and decoded if they are not
    /// cached. Adds the durations to `timing`.
    pub(crate) fn features(
        &mut self,
        scene: &mut Scene,
        decoder: &mut FeatureDecoder,
        snapshot: &MapSnapshot,
        camera: &Camera,
        columns: u32,
        timing: &mut Timing,
    ) -> Result<Arc<ViewFeatures>, QueryError> {
        let gaussians = Arc::downgrade(&snapshot.gaussians);
        if let Some((of, last, features)) = &self.last
            && of.ptr_eq(&gaussians)
            && last == camera
        {
            return Ok(features.clone());
        }
        let mut stopwatch = Stopwatch::start();
        let narrowed = camera::narrowed(camera, columns);
        let image = scene.language(snapshot, &narrowed)?;
        let mut spreads = scene.spreads(snapshot, &narrowed)?;
        // Smoothing brings relevancy to places that show nothing.
        spreads.iter_mut().filter(|one| **one == 0.0).for_each(|one| *one = REFERENCE_SPREAD);
        timing.render = stopwatch.lap();
        let features = Arc::new(decode(decoder, snapshot, &image, spreads)?);
        timing.decode = stopwatch.lap();
        self.last = Some((gaussians, camera.clone(), features.clone()));
        Ok(features)
    }
}

/// Decodes the pixels that have language.
fn decode(
    decoder: &mut FeatureDecoder,
    snapshot: &MapSnapshot,
    image: &LanguageImage,
    spreads: Vec<f32>,
) -> Result<ViewFeatures, NetworkError> {
    let channels = snapshot.online.code_size();
    let (mut pixels, mut codes) = (Vec::new(), Vec::new());
    for (at, (code, &opacity)) in image.codes.chunks_exact(channels).zip(&image.opacity).enumerate()
    {
        let length = code.iter().map(|value| value * value).sum::<f32>().sqrt();
        if opacity > MIN_OPACITY && length > MIN_LENGTH * opacity {
            pixels.push(at as u32);
            codes.extend_from_slice(code);
        }
    }
    let mut features = Vec::with_capacity(pixels.len() * decoder.feature_size());
    decoder.decode(&*snapshot.online, &codes, |batch| features.extend_from_slice(batch))?;
    let (width, height) = (image.width as usize, image.height as usize);
    Ok(ViewFeatures { width, height, pixels, features, spreads })
}
