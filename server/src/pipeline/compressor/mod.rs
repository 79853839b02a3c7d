//! Two-stage compression of language features (paper §4.2, "Two-Stage Online CLIP Compression").
//!
//! The first stage (D -> 32) is pre-trained and part of the bundle; the second (32 -> 15) is
//! learned while the robot drives, behind [`OnlineStage`]. A keyframe keeps its 32-D codes as the
//! truth; every 15-D code belongs to a version of the online stage and is carried over when it
//! advances.

mod config;
mod dictionary;
pub mod generic;
mod linear;
mod mlp;

pub use config::{CompressorConfig, Stage};
pub use linear::Linear;
pub use mlp::Mlp;

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
