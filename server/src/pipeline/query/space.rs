//! A question about the whole map: every Gaussian's code is decoded and compared with the words.
//!
//! Decoded features are kept for the snapshot that was asked about last, as long as they fit into
//! the configured memory; a larger map is decoded in batches at every question.

use super::answer::ScoredPoint;
use super::clusters::Weighted;
use super::relevancy::Comparison;
use crate::pipeline::compressor::generic::GenericDecoder;
use crate::pipeline::network::NetworkError;
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::HostGaussians;
use nalgebra::Point3;
use std::sync::Arc;

/// Opacity of the language head below which a Gaussian is no place for an object.
const LEAST_OPACITY: f32 = 0.3;
/// Standard deviations of a Gaussian that count as itself when objects are made.
const DEVIATIONS: f32 = 2.0;
/// However large a Gaussian is, it joins others no further than this.
const MOST_REACH_METRES: f32 = 0.2;

/// Decoded features of one snapshot.
pub(super) struct SpaceCache {
    limit_bytes: usize,
    last: Option<Decoded>,
}

struct Decoded {
    gaussians: Arc<HostGaussians>,
    /// `[n, D]` for the Gaussians with language, in order.
    features: Vec<f32>,
}

/// Relevancies of a map.
pub(super) struct Scores {
    /// Gaussians with language and enough opacity, above the threshold.
    pub relevant: Vec<Weighted>,
    /// Relevancies of all Gaussians with language and enough opacity.
    pub all: Vec<f32>,
    /// The share of Gaussians with language.
    pub coverage: f32,
}

impl SpaceCache {
    /// Holds at most this much.
    pub(super) fn new(limit_mib: usize) -> Self {
        Self { limit_bytes: limit_mib << 20, last: None }
    }

    /// Decodes the snapshot's codes if that has not been done and they fit.
    pub(super) fn prepare(
        &mut self,
        decoder: &mut GenericDecoder,
        snapshot: &MapSnapshot,
        size: usize,
    ) -> Result<(), NetworkError> {
        let is_last = |last: &Decoded| Arc::ptr_eq(&last.gaussians, &snapshot.gaussians);
        if self.last.as_ref().is_some_and(is_last) {
            return Ok(());
        }
        self.last = None;
        let codes = codes_with_language(snapshot);
        let rows = codes.len() / snapshot.online.code_size();
        if rows * size * size_of::<f32>() > self.limit_bytes {
            return Ok(());
        }
        let mut features = Vec::with_capacity(rows * size);
        let generic = snapshot.online.decode(&codes);
        decoder.decompress(&generic, |batch| features.extend_from_slice(batch))?;
        self.last = Some(Decoded { gaussians: snapshot.gaussians.clone(), features });
        Ok(())
    }

    /// Relevancy of every Gaussian with language, in order.
    fn relevancies(
        &self,
        decoder: &mut GenericDecoder,
        snapshot: &MapSnapshot,
        comparison: &Comparison,
    ) -> Result<Vec<f32>, NetworkError> {
        if let Some(decoded) = &self.last {
            return Ok(comparison.relevancies(&decoded.features));
        }
        let mut found = Vec::new();
        let generic = snapshot.online.decode(&codes_with_language(snapshot));
        decoder.decompress(&generic, |batch| found.extend(comparison.relevancies(batch)))?;
        Ok(found)
    }

    /// Gaussians above the threshold; [`Self::prepare`] comes first.
    pub(super) fn scores(
        &self,
        decoder: &mut GenericDecoder,
        snapshot: &MapSnapshot,
        comparison: &Comparison,
        threshold: f32,
    ) -> Result<Scores, NetworkError> {
        let relevancies = self.relevancies(decoder, snapshot, comparison)?;
        let gaussians = &snapshot.gaussians;
        let coverage = relevancies.len() as f32 / gaussians.means.len().max(1) as f32;
        let mut relevant: Vec<Weighted> = with_language(snapshot)
            .zip(relevancies)
            .map(|(at, score)| Weighted {
                point: ScoredPoint { position: Point3::from(gaussians.means[at]), score },
                opacity: sigmoid(gaussians.language.opacity_logits[at]),
                reach: reach(gaussians.language.log_scales[at]),
            })
            .filter(|weighted| {
                weighted.opacity > LEAST_OPACITY
                    && weighted.point.position.iter().all(|c| c.is_finite())
            })
            .collect();
        let all = relevant.iter().map(|weighted| weighted.point.score).collect();
        relevant.retain(|weighted| weighted.point.score > threshold);
        Ok(Scores { relevant, all, coverage })
    }
}

/// Indices of the Gaussians that have language, in order.
fn with_language(snapshot: &MapSnapshot) -> impl Iterator<Item = usize> {
    let codes = snapshot.gaussians.language.features.chunks_exact(snapshot.online.code_size());
    codes.enumerate().filter(|(_, code)| code.iter().any(|&value| value != 0.0)).map(|(at, _)| at)
}

/// Their codes, `[n, code_size]`.
fn codes_with_language(snapshot: &MapSnapshot) -> Vec<f32> {
    let size = snapshot.online.code_size();
    let codes = &snapshot.gaussians.language.features;
    with_language(snapshot).flat_map(|at| &codes[at * size..(at + 1) * size]).copied().collect()
}

/// Of the ball of two standard deviations (geometric mean over the axes), metres.
fn reach([x, y, z]: [f32; 3]) -> f32 {
    (DEVIATIONS * ((x + y + z) / 3.0).exp()).min(MOST_REACH_METRES)
}

fn sigmoid(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}
