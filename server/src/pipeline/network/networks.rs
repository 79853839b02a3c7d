//! The networks of a bundle, grouped by the thread that owns them.

use super::error::NetworkError;
use super::manifest::{ImageSpec, RelevancySpec};
use super::runtime::Network;
use super::tensor::Tensor;
use tokenizers::Tokenizer;

/// Networks from a keyframe's colors to its generic codes.
pub struct VisionNetworks {
    /// How images are prepared.
    pub image: ImageSpec,
    /// The networks.
    pub stages: VisionStages,
    /// Rows and columns of the grid of codes.
    pub grid: [usize; 2],
}

/// `[1, 3, height, width]` -> generic codes `[1, 32, grid height, grid width]`, unit length over
/// 32.
pub enum VisionStages {
    /// One graph.
    EndToEnd {
        /// Image -> codes.
        network: Network,
        /// Features -> codes, for labels that come with a frame; absent in some bundles.
        compressor: Option<Network>,
    },
    /// The paper's three networks.
    Staged {
        /// `[1, 3, height, width]` -> coarse features and skips.
        encoder: Network,
        /// Coarse features and skips -> features `[1, D, grid height, grid width]`.
        srd: Network,
        /// Features -> codes.
        compressor: Network,
    },
}

/// Text -> embedding.
pub struct TextTower {
    pub(super) tokenizer: Tokenizer,
    /// Tokens -> embedding `[1, D]`, unit length.
    pub(super) network: Network,
}

/// Networks from texts and from codes to comparable features.
pub struct TextNetworks {
    /// Text -> embedding.
    pub tower: TextTower,
    /// Generic codes `[n, 32]` -> features `[n, D]`, unit length.
    pub decompressor: Network,
    /// Parameters of the comparison.
    pub relevancy: RelevancySpec,
    /// D, channels of a feature.
    pub feature_size: usize,
}

impl TextTower {
    /// A text's embedding `[D]`, unit length. Tokens beyond the bundle's `max_tokens` are ignored.
    ///
    /// # Errors
    /// [`NetworkError`] if the tokenizer or the tower fails.
    pub fn embed(&mut self, text: &str) -> Result<Vec<f32>, NetworkError> {
        let encoding = self
            .tokenizer
            .encode(text, true)
            .map_err(|reason| NetworkError::Tokenizer { reason: reason.to_string() })?;
        let tokens = encoding.len();
        // A graph with a fixed context length takes padded tokens, which are masked out.
        let length = self.network.declared_input_size(0, 1).unwrap_or(tokens);
        let padded = |values: &[u32]| -> Vec<i64> {
            let padding = std::iter::repeat_n(0, length.saturating_sub(tokens));
            values.iter().take(length).map(|&value| i64::from(value)).chain(padding).collect()
        };
        let inputs: Vec<Tensor> = self
            .network
            .input_names()
            .map(|name| {
                let values = match name {
                    "attention_mask" => encoding.get_attention_mask(),
                    "token_type_ids" => encoding.get_type_ids(),
                    _ => encoding.get_ids(),
                };
                Tensor::ints(&[1, length], padded(values))
            })
            .collect();
        let outputs = self.network.run(&inputs)?;
        Ok(outputs[0].as_floats().into_owned())
    }
}
