//! A question about the whole map: every Gaussian's code is decoded and compared with the words.
//!
//! Decoded features are kept for the snapshot that was asked about last, as long as they fit into
//! the configured memory; a larger map is decoded in batches at every question.

use super::answer::{LabelledPoint, ScoredPoint};
use super::clusters::Weighted;
use super::cosines::kept;
use super::relevancy::Comparison;
use super::rivals::{Rivals, winner};
use crate::pipeline::compressor::generic::GenericDecoder;
use crate::pipeline::network::NetworkError;
use crate::pipeline::snapshot::MapSnapshot;
use half::bf16;
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
    /// The Gaussians with language, in order.
    rows: Vec<u32>,
    /// `[rows, D]`, unit length; `None`: too many to keep.
    features: Option<Vec<bf16>>,
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

/// Labels of a map.
pub(super) struct Labels {
    /// Gaussians with language and enough opacity.
    pub points: Vec<LabelledPoint>,
    /// The share of Gaussians with language.
    pub coverage: f32,
}

impl SpaceCache {
    /// Holds at most this much.
    pub(super) fn new(limit_mib: usize) -> Self {
        Self { limit_bytes: limit_mib << 20, last: None }
    }

    /// Finds the Gaussians with language and decodes their codes, if that has not been done and they
    /// fit.
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
        let rows = with_language(snapshot);
        let mut features = None;
        if rows.len() * size * size_of::<bf16>() <= self.limit_bytes {
            let mut decoded = Vec::with_capacity(rows.len() * size);
            let generic = snapshot.online.decode(&codes_of(snapshot, &rows));
            decoder.decompress(&generic, |batch| decoded.extend(kept(batch)))?;
            features = Some(decoded);
        }
        self.last = Some(Decoded { gaussians: snapshot.gaussians.clone(), rows, features });
        Ok(())
    }

    /// The Gaussians with language, and what `compare` makes of their features, in order;
    /// [`Self::prepare`] comes first.
    fn compared(
        &self,
        decoder: &mut GenericDecoder,
        snapshot: &MapSnapshot,
        compare: impl Fn(&[bf16]) -> Vec<f32>,
    ) -> Result<(&[u32], Vec<f32>), NetworkError> {
        let last = self.last.as_ref().expect("the snapshot was prepared");
        if let Some(features) = &last.features {
            return Ok((&last.rows, compare(features)));
        }
        let mut found = Vec::new();
        let generic = snapshot.online.decode(&codes_of(snapshot, &last.rows));
        decoder.decompress(&generic, |batch| {
            found.extend(compare(&kept(batch).collect::<Vec<_>>()));
        })?;
        Ok((&last.rows, found))
    }

    /// Gaussians above the threshold; [`Self::prepare`] comes first.
    pub(super) fn scores(
        &self,
        decoder: &mut GenericDecoder,
        snapshot: &MapSnapshot,
        comparison: &Comparison,
        threshold: f32,
    ) -> Result<Scores, NetworkError> {
        let compare = |features: &[bf16]| comparison.relevancies(features);
        let (rows, relevancies) = self.compared(decoder, snapshot, compare)?;
        let scales = &snapshot.gaussians.language.log_scales;
        let mut relevant: Vec<Weighted> = rows
            .iter()
            .zip(relevancies)
            .filter_map(|(&row, score)| {
                let (position, opacity) = placed(&snapshot.gaussians, row)?;
                let reach = reach(scales[row as usize]);
                Some(Weighted { row, point: ScoredPoint { position, score }, opacity, reach })
            })
            .collect();
        let all = relevant.iter().map(|weighted| weighted.point.score).collect();
        relevant.retain(|weighted| weighted.point.score > threshold);
        Ok(Scores { relevant, all, coverage: coverage(snapshot, rows) })
    }

    /// The best text of every Gaussian; [`Self::prepare`] comes first.
    pub(super) fn labels(
        &self,
        decoder: &mut GenericDecoder,
        snapshot: &MapSnapshot,
        rivals: &Rivals,
        threshold: f32,
    ) -> Result<Labels, NetworkError> {
        let compare = |features: &[bf16]| rivals.relevancies(features);
        let (rows, relevancies) = self.compared(decoder, snapshot, compare)?;
        let points = rows
            .iter()
            .zip(relevancies.chunks_exact(rivals.len()))
            .filter_map(|(&row, relevancies)| {
                let (position, _) = placed(&snapshot.gaussians, row)?;
                let (label, score) = winner(relevancies.iter().copied(), threshold);
                Some(LabelledPoint { position, label, score })
            })
            .collect();
        Ok(Labels { points, coverage: coverage(snapshot, rows) })
    }
}

/// The share of Gaussians with language.
fn coverage(snapshot: &MapSnapshot, rows: &[u32]) -> f32 {
    rows.len() as f32 / snapshot.gaussians.len().max(1) as f32
}

/// Where a Gaussian is and how opaque its language; `None` if it is no place for an object.
fn placed(gaussians: &HostGaussians, row: u32) -> Option<(Point3<f32>, f32)> {
    let position = Point3::from(gaussians.means[row as usize]);
    let opacity = sigmoid(gaussians.language.opacity_logits[row as usize]);
    let counts = opacity > LEAST_OPACITY && position.iter().all(|c| c.is_finite());
    counts.then_some((position, opacity))
}

/// Indices of the Gaussians that have language, in order.
fn with_language(snapshot: &MapSnapshot) -> Vec<u32> {
    let codes = snapshot.gaussians.language.features.chunks_exact(snapshot.online.code_size());
    let spoken = codes.enumerate().filter(|(_, code)| code.iter().any(|&value| value != 0.0));
    spoken.map(|(at, _)| at as u32).collect()
}

/// The codes of some Gaussians, `[rows, code_size]`.
fn codes_of(snapshot: &MapSnapshot, rows: &[u32]) -> Vec<f32> {
    let size = snapshot.online.code_size();
    let codes = &snapshot.gaussians.language.features;
    rows.iter().flat_map(|&row| &codes[row as usize * size..][..size]).copied().collect()
}

/// Of the ball of two standard deviations (geometric mean over the axes), metres.
fn reach([x, y, z]: [f32; 3]) -> f32 {
    (DEVIATIONS * ((x + y + z) / 3.0).exp()).min(MOST_REACH_METRES)
}

fn sigmoid(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}
