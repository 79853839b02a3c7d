//! What the query thread owns, and the way of each request to its answer.

use super::answer::{Answer, RenderedImage, Segmentation, Timing};
use super::camera;
use super::choice::Finder;
use super::config::QueryConfig;
use super::error::QueryError;
use super::feature_decoder::FeatureDecoder;
use super::limits::MAX_TEXTS;
use super::question::Wanted;
use super::relevancy::{Calibration, is_present};
use super::render::{self, PaletteCache, Scene};
use super::request::{Query, RenderRequest, SegmentationRequest, checked_threshold};
use super::search::{Findings, Search};
use super::space::{self, FoundObject, SpaceFeatureCache};
use super::stopwatch::{Stopwatch, milliseconds_since};
use super::text::{TextEmbedder, wanted};
use super::view::{self, ViewFeatureCache};
use crate::pipeline::network::TextNetworks;
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::{Camera, Gpu};
use std::sync::Arc;
use std::time::Instant;

/// Default threshold of a segmentation: as near to the text as to the nearest negative.
const SEGMENTATION_THRESHOLD: f32 = 0.5;

/// Networks, renderer and caches.
pub(super) struct Worker {
    config: QueryConfig,
    /// Default threshold of a query.
    threshold: f32,
    calibration: Calibration,
    embedder: TextEmbedder,
    decoder: FeatureDecoder,
    scene: Scene,
    view_features: ViewFeatureCache,
    space_features: SpaceFeatureCache,
    palettes: PaletteCache,
}

impl Worker {
    pub(super) fn new(gpu: Gpu, networks: TextNetworks, config: QueryConfig) -> Self {
        let TextNetworks { tower, decompressor, mut relevancy, feature_size } = networks;
        relevancy.bias = config.bias.unwrap_or(relevancy.bias);
        let threshold = config.threshold.unwrap_or(relevancy.threshold);
        let midpoint = relevancy.present_threshold.unwrap_or(threshold);
        Self {
            threshold,
            calibration: Calibration::new(midpoint, relevancy.confidence_steepness),
            embedder: TextEmbedder::new(tower, relevancy, config.cached_texts),
            decoder: FeatureDecoder::new(decompressor, feature_size),
            scene: Scene::new(gpu),
            view_features: ViewFeatureCache::default(),
            space_features: SpaceFeatureCache::new(config.feature_cache_mib),
            palettes: PaletteCache::default(),
            config,
        }
    }

    /// Answers a question: text -> prompts, codes -> features, then relevancy, objects and the
    /// other outputs. `received`: when the request arrived.
    pub(super) fn answer(
        &mut self,
        snapshot: &MapSnapshot,
        query: &Query,
        received: Instant,
    ) -> Result<Answer, QueryError> {
        let threshold = checked_threshold(query.threshold, self.threshold)?;
        let mut timing = Timing::default();
        let mut stopwatch = Stopwatch::start();
        let wanted = &wanted("text", &query.text)?;
        let prompts = &self.embedder.prompts_of(wanted, &query.negatives)?;
        timing.text = stopwatch.lap();
        let (config, calibration) = (&self.config.clone(), &self.calibration.clone());
        let search = &Search { snapshot, query, prompts, threshold, config, calibration };
        let findings = match &query.view {
            Some(view) => {
                let camera = camera::of_view(snapshot, view)?;
                self.in_view(search, wanted, &camera, &mut timing, &mut stopwatch)?
            }
            None => self.in_space(search, wanted, &mut timing, &mut stopwatch)?,
        };
        timing.score = stopwatch.lap();
        timing.total = milliseconds_since(received);
        Ok(findings.into_answer(snapshot.revision, wanted.into(), threshold, timing))
    }

    /// What is meant, in the whole map.
    fn in_space(
        &mut self,
        search: &Search<'_>,
        wanted: &Wanted,
        timing: &mut Timing,
        stopwatch: &mut Stopwatch,
    ) -> Result<Findings, QueryError> {
        let features = self.space_features.features(&mut self.decoder, search.snapshot)?;
        timing.decode = stopwatch.lap();
        let (embedder, decoder) = (&mut self.embedder, &mut self.decoder);
        let mut finder = Finder { embedder, decoder, features, threshold: self.threshold };
        let (found, reason) = finder.meant(search, wanted, None)?;
        Ok(Findings { reason, ..space::findings(search, features, found) })
    }

    /// What is meant, in a view. Where objects are to be chosen, that is done in space, and pixels that do
    /// not show them are not relevant.
    fn in_view(
        &mut self,
        search: &Search<'_>,
        wanted: &Wanted,
        camera: &Camera,
        timing: &mut Timing,
        stopwatch: &mut Stopwatch,
    ) -> Result<Findings, QueryError> {
        let (snapshot, columns) = (search.snapshot, search.config.code_columns);
        let (scene, decoder) = (&mut self.scene, &mut self.decoder);
        let features =
            self.view_features.features(scene, decoder, snapshot, camera, columns, timing)?;
        stopwatch.lap();
        if wanted.is_plain() {
            return Ok(view::search(search, &features, camera, None));
        }
        let in_space = self.space_features.features(decoder, snapshot)?;
        let (embedder, threshold) = (&mut self.embedder, self.threshold);
        let mut finder = Finder { embedder, decoder, features: in_space, threshold };
        let (found, reason) = finder.meant(search, wanted, Some(camera))?;
        let rows: Vec<u32> = found.objects.iter().flat_map(FoundObject::rows).collect();
        let share = scene.share(snapshot, &camera::narrowed(camera, columns), &rows)?;
        let seen = view::search(search, &features, camera, Some(&share));
        let is_hidden = !rows.is_empty() && !is_present(seen.confidence);
        let hidden = is_hidden.then(|| "the map has it, but this view does not show it".into());
        let confidence = match &reason {
            Some(_) => found.confidence,
            None => seen.confidence,
        };
        Ok(Findings { reason: reason.or(hidden), confidence, ..seen })
    }

    /// Labels each pixel or Gaussian with the most relevant of several texts.
    pub(super) fn segment(
        &mut self,
        snapshot: &MapSnapshot,
        request: &SegmentationRequest,
        received: Instant,
    ) -> Result<Segmentation, QueryError> {
        let threshold = checked_threshold(request.threshold, SEGMENTATION_THRESHOLD)?;
        let found = request.texts.len();
        if !(1..=MAX_TEXTS).contains(&found) {
            return Err(QueryError::WrongTextCount { limit: MAX_TEXTS, found });
        }
        let mut timing = Timing::default();
        let mut stopwatch = Stopwatch::start();
        let prompts = self.embedder.prompts("texts", &request.texts, &request.negatives)?;
        timing.text = stopwatch.lap();
        let labels = match &request.view {
            Some(view) => {
                let camera = camera::of_view(snapshot, view)?;
                let features = self.view_features.features(
                    &mut self.scene,
                    &mut self.decoder,
                    snapshot,
                    &camera,
                    self.config.code_columns,
                    &mut timing,
                )?;
                stopwatch.lap();
                let side = self.config.smoothing(request.smoothing_pixels, camera.width);
                view::segment(&features, &prompts, &camera, side, threshold)
            }
            None => {
                let features = self.space_features.features(&mut self.decoder, snapshot)?;
                timing.decode = stopwatch.lap();
                space::segment(features, &mut self.decoder, snapshot, &prompts, threshold)?
            }
        };
        timing.score = stopwatch.lap();
        timing.total = milliseconds_since(received);
        Ok(labels.into_segmentation(snapshot.revision, threshold, timing))
    }

    /// Renders an image.
    pub(super) fn render(
        &mut self,
        snapshot: &MapSnapshot,
        request: &RenderRequest,
    ) -> Result<RenderedImage, QueryError> {
        render::render(&mut self.scene, &mut self.palettes, snapshot, request)
    }

    /// Relevancies, 0..1, of codes `[n, code_size]` of the snapshot to a query; 0 for codes of
    /// zeros.
    pub(super) fn relevancies(
        &mut self,
        snapshot: &MapSnapshot,
        codes: &[f32],
        query: &Query,
    ) -> Result<Vec<f32>, QueryError> {
        let texts = std::slice::from_ref(&query.text);
        let prompts = self.embedder.prompts("text", texts, &query.negatives)?;
        let mut relevancies = Vec::with_capacity(codes.len() / snapshot.online.code_size());
        self.decoder.decode(&*snapshot.online, codes, |batch| {
            relevancies.extend(prompts.relevancies(batch));
        })?;
        let rows = codes.chunks_exact(snapshot.online.code_size()).zip(&mut relevancies);
        for (code, relevancy) in rows {
            if code.iter().all(|&value| value == 0.0) {
                *relevancy = 0.0;
            }
        }
        Ok(relevancies)
    }

    /// The embedding of a text, `[D]`, unit length.
    pub(super) fn embed(&mut self, text: &str) -> Result<Arc<[f32]>, QueryError> {
        self.embedder.embed("text", text)
    }
}
