//! The online stage's interface.

/// The online stage: generic codes (32 channels) to online codes (15) and back, learned from the
/// keyframes observed so far.
///
/// Codes are row-major `[n, channels]`. Implementations are deterministic: the same observations in
/// the same order give the same state.
pub trait OnlineStage: Send + Sync {
    /// Channels of an online code (15 in the paper).
    fn code_size(&self) -> usize;
    /// Version of the code space. It increases when earlier codes can no longer be decoded.
    fn version(&self) -> u64;
    /// Learns from a keyframe's generic codes `[n, 32]`; true if the version increased.
    fn observe(&mut self, generic: &[f32]) -> bool;
    /// `[n, 32]` -> `[n, code_size]`.
    fn encode(&self, generic: &[f32]) -> Vec<f32>;
    /// `[n, code_size]` -> `[n, 32]`, unit length. Only the direction of a code matters.
    fn decode(&self, codes: &[f32]) -> Vec<f32>;
    /// Converts codes `[n, code_size]` of the earlier state `old` to codes of this state.
    fn carried(&self, old: &dyn OnlineStage, codes: &[f32]) -> Vec<f32> {
        self.encode(&old.decode(codes))
    }
    /// The current state as bytes, for `restored`.
    fn save(&self) -> Vec<u8>;
    /// A copy of the current state.
    fn boxed_clone(&self) -> Box<dyn OnlineStage>;
}

/// Converts codes `[n, code_size]` of state `old` to codes of state `new` in place, with
/// [`OnlineStage::carried`]. Codes of zeros mean "no language" and stay zeros.
pub fn carry_over(old: &dyn OnlineStage, new: &dyn OnlineStage, codes: &mut [f32]) {
    let size = old.code_size();
    let carried = new.carried(old, codes);
    for (code, carried) in codes.chunks_exact_mut(size).zip(carried.chunks_exact(size)) {
        if code.iter().any(|&value| value != 0.0) {
            code.copy_from_slice(carried);
        }
    }
}
