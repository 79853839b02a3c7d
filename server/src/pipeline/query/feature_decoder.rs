//! Decodes the codes of a snapshot to features: online code -> 32 -> D.

use crate::pipeline::compressor::OnlineStage;
use crate::pipeline::compressor::generic::GenericDecoder;
use crate::pipeline::network::{Network, NetworkError};

/// The decoders of both stages.
pub(super) struct FeatureDecoder {
    generic: GenericDecoder,
    feature_size: usize,
}

impl FeatureDecoder {
    /// Wraps the bundle's decompressor, whose features have `feature_size` channels.
    pub(super) fn new(decompressor: Network, feature_size: usize) -> Self {
        Self { generic: GenericDecoder::new(decompressor), feature_size }
    }

    /// D, channels of a feature.
    pub(super) fn feature_size(&self) -> usize {
        self.feature_size
    }

    /// Codes `[n, code_size]` to features `[n, D]` of unit length. `each` is called with each batch
    /// of features, in order.
    pub(super) fn decode(
        &mut self,
        online: &dyn OnlineStage,
        codes: &[f32],
        each: impl FnMut(&[f32]),
    ) -> Result<(), NetworkError> {
        self.generic.decompress(&online.decode(codes), each)
    }
}
