//! Two-stage compression of language features (paper §4.2, "Two-Stage Online CLIP Compression").
//!
//! The first stage (D -> 32) is pre-trained and part of the bundle; the second (32 -> 15) is
//! learned while the robot drives, behind [`OnlineStage`]. A keyframe keeps its 32-D codes as the
//! truth; every 15-D code belongs to a version of the online stage and is carried over when it
//! advances.

mod dictionary;
pub mod generic;
mod linear;
mod mlp;

pub use linear::Linear;
pub use mlp::Mlp;

use serde::{Deserialize, Deserializer, Serialize};

/// Size of a generic code.
pub const GENERIC: usize = 32;

/// Below this length a vector has no direction and stays as it is.
const LEAST_LENGTH: f32 = 1e-6;

/// The online stage: 32 -> 15 and back, learned from the keyframes seen so far.
///
/// Codes are row-major `[n, channels]`. Implementations are deterministic: the same observations in
/// the same order give the same state.
pub trait OnlineStage: Send + Sync {
    /// Size of an online code (15 in the paper).
    fn code_size(&self) -> usize;
    /// Increases whenever codes of the version before are not readable any more.
    fn version(&self) -> u64;
    /// Learns from a keyframe's generic codes `[n, 32]`; true if the version advanced.
    fn observe(&mut self, generic: &[f32]) -> bool;
    /// `[n, 32]` -> `[n, code_size]`.
    fn encode(&self, generic: &[f32]) -> Vec<f32>;
    /// `[n, code_size]` -> `[n, 32]`, unit length; a code of any length is read by its direction.
    fn decode(&self, codes: &[f32]) -> Vec<f32>;
    /// Codes `[n, code_size]` of an earlier state of this stage as codes of this one.
    fn carried(&self, old: &dyn OnlineStage, codes: &[f32]) -> Vec<f32> {
        self.encode(&old.decode(codes))
    }
    /// A copy as it is now.
    fn boxed_clone(&self) -> Box<dyn OnlineStage>;
}

/// Which online stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Running second moments, their leading eigenvectors, and what these leave out.
    Linear,
    /// The paper's auto-encoder.
    Mlp,
}

/// How generic codes are compressed further.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CompressorConfig {
    /// Which stage.
    pub stage: Stage,
    /// Channels of an online code, 1 to 32.
    #[serde(deserialize_with = "checked_code_size")]
    pub code_size: usize,
    /// Linear: the share of what was seen that must be lost before the basis moves.
    pub tolerance: f64,
    /// MLP: Adam's step size.
    pub learning_rate: f64,
    /// MLP: steps over the first keyframes, all together.
    pub initial_steps: usize,
    /// MLP: how many keyframes are the first ones.
    pub initial_keyframes: usize,
    /// MLP: earlier keyframes that are trained on again at each later one.
    pub replayed: usize,
    /// MLP: the start of its random numbers.
    pub seed: u64,
}

impl Default for CompressorConfig {
    fn default() -> Self {
        Self {
            stage: Stage::Linear,
            code_size: 15,
            tolerance: 1e-3,
            learning_rate: 1e-3,
            initial_steps: 200,
            initial_keyframes: 1,
            replayed: 2,
            seed: 0,
        }
    }
}

fn checked_code_size<'de, D: Deserializer<'de>>(deserializer: D) -> Result<usize, D::Error> {
    let size = usize::deserialize(deserializer)?;
    if (1..=GENERIC).contains(&size) {
        return Ok(size);
    }
    Err(serde::de::Error::custom(format!("code_size: expected 1 to {GENERIC}, found {size}")))
}

/// The configured stage, before any keyframe.
pub fn online(config: &CompressorConfig) -> Box<dyn OnlineStage> {
    match config.stage {
        Stage::Linear => Box::new(Linear::new(config.code_size, config.tolerance)),
        Stage::Mlp => Box::new(Mlp::new(config)),
    }
}

/// Rewrites codes `[n, code_size]` of version `old` as codes of version `new`, in the way that
/// loses least with this stage ([`OnlineStage::carried`]). All-zero codes ("no language yet") stay
/// so.
pub fn carry_over(old: &dyn OnlineStage, new: &dyn OnlineStage, codes: &mut [f32]) {
    let size = old.code_size();
    let carried = new.carried(old, codes);
    for (code, carried) in codes.chunks_exact_mut(size).zip(carried.chunks_exact(size)) {
        if code.iter().any(|&value| value != 0.0) {
            code.copy_from_slice(carried);
        }
    }
}

/// Makes every row unit length; rows that are next to zero stay as they are, so nothing becomes
/// NaN.
pub(crate) fn normalise_rows(rows: &mut [f32], channels: usize) {
    for row in rows.chunks_exact_mut(channels) {
        let length = row.iter().map(|value| value * value).sum::<f32>().sqrt();
        if length > LEAST_LENGTH {
            let scale = 1.0 / length;
            row.iter_mut().for_each(|value| *value *= scale);
        }
    }
}

#[cfg(test)]
mod tests;
