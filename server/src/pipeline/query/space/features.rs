//! Decoded features of a whole map, and its segments.
//!
//! The features of the most recent snapshot are cached if they fit into the configured memory. A
//! larger map is decoded in batches at every question.

use super::gaussian::RelevantGaussian;
use super::segments::Segments;
use crate::pipeline::backdrop::can_have_language;
use crate::pipeline::network::NetworkError;
use crate::pipeline::query::feature_decoder::FeatureDecoder;
use crate::pipeline::query::relevancy::{Prompts, to_bf16};
use crate::pipeline::snapshot::MapSnapshot;
use half::bf16;
use lexsplat_gpu::HostGaussians;
use std::cell::OnceCell;
use std::sync::{Arc, Weak};

/// Features of one snapshot.
pub(crate) struct SpaceFeatures {
    gaussians: Weak<HostGaussians>,
    /// Number of Gaussians that can have language.
    can_have: usize,
    /// Indices of the Gaussians with language, in order.
    rows: Vec<u32>,
    /// `[rows, D]`, unit length; `None`: too large for the cache.
    cached: Option<Vec<bf16>>,
    /// The segments, once they were asked for.
    segments: OnceCell<Segments>,
}

/// The features of the most recent snapshot.
pub(crate) struct SpaceFeatureCache {
    limit_bytes: usize,
    last: Option<SpaceFeatures>,
}

impl SpaceFeatureCache {
    /// Caches features of at most `limit_mib` MiB.
    pub(crate) fn new(limit_mib: usize) -> Self {
        Self { limit_bytes: limit_mib << 20, last: None }
    }

    /// The features of a snapshot; they are decoded now if they are not cached and fit.
    pub(crate) fn features(
        &mut self,
        decoder: &mut FeatureDecoder,
        snapshot: &MapSnapshot,
    ) -> Result<&SpaceFeatures, NetworkError> {
        let gaussians = Arc::downgrade(&snapshot.gaussians);
        let is_current = |last: &SpaceFeatures| last.gaussians.ptr_eq(&gaussians);
        let features = match self.last.take().filter(is_current) {
            Some(features) => features,
            None => SpaceFeatures::new(decoder, snapshot, self.limit_bytes)?,
        };
        Ok(self.last.insert(features))
    }
}

impl SpaceFeatures {
    fn new(
        decoder: &mut FeatureDecoder,
        snapshot: &MapSnapshot,
        limit_bytes: usize,
    ) -> Result<Self, NetworkError> {
        let rows = rows_with_language(snapshot);
        let count = rows.len() * decoder.feature_size();
        let mut cached = None;
        if count * size_of::<bf16>() <= limit_bytes {
            let mut features = Vec::with_capacity(count);
            let codes = codes(snapshot, &rows);
            decoder.decode(&*snapshot.online, &codes, |batch| features.extend(to_bf16(batch)))?;
            cached = Some(features);
        }
        let gaussians = Arc::downgrade(&snapshot.gaussians);
        let logits = snapshot.gaussians.language.opacity_logits.iter();
        let can_have = logits.filter(|logit| can_have_language(**logit)).count();
        Ok(Self { gaussians, can_have, rows, cached, segments: OnceCell::new() })
    }

    /// Indices of the Gaussians with language, in order.
    pub(super) fn rows(&self) -> &[u32] {
        &self.rows
    }

    /// The segments of the snapshot of these features; `opaque` are its Gaussians that can belong to
    /// objects.
    pub(super) fn segments(
        &self,
        snapshot: &MapSnapshot,
        opaque: &[RelevantGaussian],
    ) -> &Segments {
        self.segments.get_or_init(|| Segments::new(&snapshot.gaussians, opaque))
    }

    /// Share of the Gaussians with language, of those that can have it.
    pub(super) fn coverage(&self) -> f32 {
        self.rows.len() as f32 / self.can_have.max(1) as f32
    }

    /// Relevancies `[rows, texts]`; `snapshot` is the one of these features.
    pub(super) fn relevancies(
        &self,
        decoder: &mut FeatureDecoder,
        snapshot: &MapSnapshot,
        prompts: &Prompts,
    ) -> Result<Vec<f32>, NetworkError> {
        if let Some(features) = &self.cached {
            return Ok(prompts.relevancies(features));
        }
        let mut relevancies = Vec::with_capacity(self.rows.len() * prompts.texts());
        decoder.decode(&*snapshot.online, &codes(snapshot, &self.rows), |batch| {
            // The same rounding as in the cache: both ways give the same relevancies.
            relevancies.extend(prompts.relevancies(&to_bf16(batch).collect::<Vec<_>>()));
        })?;
        Ok(relevancies)
    }
}

/// Indices of the Gaussians that have language, in order.
fn rows_with_language(snapshot: &MapSnapshot) -> Vec<u32> {
    let head = &snapshot.gaussians.language;
    let codes = head.features.chunks_exact(snapshot.online.code_size());
    let has_language = |(code, logit): (&[f32], &f32)| {
        can_have_language(*logit) && code.iter().any(|&value| value != 0.0)
    };
    let heads = codes.zip(&head.opacity_logits).enumerate();
    heads.filter(|(_, head)| has_language(*head)).map(|(at, _)| at as u32).collect()
}

/// The codes of some Gaussians, `[rows, code_size]`.
fn codes(snapshot: &MapSnapshot, rows: &[u32]) -> Vec<f32> {
    let size = snapshot.online.code_size();
    let codes = &snapshot.gaussians.language.features;
    rows.iter().flat_map(|&row| &codes[row as usize * size..][..size]).copied().collect()
}
