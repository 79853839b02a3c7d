//! A question about one view: codes are rendered small, decoded, compared with the words, and the
//! relevancy is brought to the view's size (paper §5).
//!
//! Codes are rendered at about label resolution: the paper's labels are no finer, and decoding
//! costs as much as there are pixels.

use super::QueryError;
use super::config::QueryConfig;
use super::relevancy::{Comparison, Plane};
use super::rivals::Rivals;
use super::scene::Scene;
use crate::pipeline::compressor::GENERIC_SIZE;
use crate::pipeline::compressor::generic::GenericDecoder;
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::{Camera, HostGaussians, LanguageImage};
use std::sync::Arc;

/// Opacity of the language head below which a pixel shows nothing.
const LEAST_OPACITY: f32 = 0.5;
/// Length of a blended code, as a share of opacity, below which it has no direction: Gaussians
/// without language yet, or with contrary ones.
const LEAST_LENGTH: f32 = 0.2;

/// Decoded features of the pixels of a small image that have language.
pub(super) struct ViewFeatures {
    width: usize,
    height: usize,
    /// Pixels with language, in order.
    pixels: Vec<u32>,
    /// `[pixels, D]`, unit length.
    features: Vec<f32>,
}

impl ViewFeatures {
    /// The share of pixels with language.
    pub(super) fn coverage(&self) -> f32 {
        self.pixels.len() as f32 / (self.width * self.height) as f32
    }

    /// Relevancy of every pixel at the view's size, not smoothed; 0 where no language is.
    pub(super) fn relevancy(&self, comparison: &Comparison, camera: &Camera) -> Plane {
        self.spread(comparison.relevancies(&self.features).into_iter(), camera)
    }

    /// The same for several texts, in order.
    pub(super) fn relevancies(&self, rivals: &Rivals, camera: &Camera) -> Vec<Plane> {
        let scores = rivals.relevancies(&self.features);
        (0..rivals.len())
            .map(|text| {
                self.spread(scores.iter().skip(text).step_by(rivals.len()).copied(), camera)
            })
            .collect()
    }

    /// Scores of the pixels with language as an image at the view's size.
    fn spread(&self, scores: impl Iterator<Item = f32>, camera: &Camera) -> Plane {
        let mut values = vec![0.0; self.width * self.height];
        for (&pixel, score) in self.pixels.iter().zip(scores) {
            values[pixel as usize] = score;
        }
        Plane { width: self.width, height: self.height, values }
            .resized(camera.width as usize, camera.height as usize)
    }
}

/// The view that was asked about last: the next question is often about it too.
#[derive(Default)]
pub(super) struct ViewCache {
    last: Option<(Arc<HostGaussians>, Camera, Arc<ViewFeatures>)>,
}

impl ViewCache {
    /// The features of this view, if it is the last one.
    pub(super) fn get(&self, snapshot: &MapSnapshot, camera: &Camera) -> Option<Arc<ViewFeatures>> {
        let (gaussians, last, features) = self.last.as_ref()?;
        let same = Arc::ptr_eq(gaussians, &snapshot.gaussians) && last == camera;
        same.then(|| features.clone())
    }

    /// Keeps the features of this view.
    pub(super) fn put(
        &mut self,
        snapshot: &MapSnapshot,
        camera: &Camera,
        features: Arc<ViewFeatures>,
    ) {
        self.last = Some((snapshot.gaussians.clone(), camera.clone(), features));
    }
}

/// Codes of the view at decoding resolution.
pub(super) fn render(
    scene: &mut Scene,
    snapshot: &MapSnapshot,
    camera: &Camera,
    config: &QueryConfig,
) -> Result<LanguageImage, QueryError> {
    let width = camera.width.min(config.code_columns);
    let height = (camera.height as f32 * width as f32 / camera.width as f32).round().max(1.0);
    Ok(scene.language(snapshot, &camera.resized(width, height as u32))?)
}

/// 15 -> 32 -> D for every pixel that has language.
pub(super) fn decode(
    decoder: &mut GenericDecoder,
    snapshot: &MapSnapshot,
    image: &LanguageImage,
    size: usize,
) -> Result<ViewFeatures, QueryError> {
    let channels = snapshot.online.code_size();
    let (mut pixels, mut codes) = (Vec::new(), Vec::new());
    for (at, (code, &opacity)) in image.codes.chunks_exact(channels).zip(&image.opacity).enumerate()
    {
        let length = code.iter().map(|value| value * value).sum::<f32>().sqrt();
        if opacity > LEAST_OPACITY && length > LEAST_LENGTH * opacity {
            pixels.push(at as u32);
            codes.extend_from_slice(code);
        }
    }
    let generic = snapshot.online.decode(&codes);
    let mut features = Vec::with_capacity(generic.len() / GENERIC_SIZE * size);
    decoder.decompress(&generic, |batch| features.extend_from_slice(batch))?;
    let (width, height) = (image.width as usize, image.height as usize);
    Ok(ViewFeatures { width, height, pixels, features })
}
