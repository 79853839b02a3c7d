//! The bundle of networks (paper §4.1): a folder with `manifest.toml` and ONNX files.
//!
//! In: the folder. Out: [`VisionNetworks`] for the language thread and [`TextNetworks`] for the
//! query thread, checked against the manifest: files by SHA-256, tensors by name, type and shape,
//! and one run of every chain. The server knows no architecture, only the manifest. This folder is
//! the only place that names `ort`.

mod find;
mod manifest;
mod provider;
mod runtime;
mod tensor;

pub use find::FindError;
pub use manifest::{ChannelOrder, Fit, ImageSpec, ManifestError, RelevancySpec};
pub use provider::{Provider, ProviderError};
pub use runtime::{Network, NetworkError};
pub use tensor::Tensor;

use super::compressor::GENERIC;
use super::encoder::LanguageConfig;
use manifest::{GraphSpec, Manifest, VisionSpec};
use runtime::Runtime;
use std::path::Path;
use tensor::{Declared, Kind};
use tokenizers::Tokenizer;

/// Text that every bundle must be able to embed.
const PROBE_TEXT: &str = "object";

/// Why there are no networks.
#[derive(Debug, thiserror::Error)]
pub enum BundleError {
    /// The runtime's library or the bundle's folder is not where it should be.
    #[error(transparent)]
    Find(#[from] FindError),
    /// The manifest or a file does not hold what it must.
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    /// A file that ONNX Runtime does not take, or tensors that are not the manifest's.
    #[error("bundle file {file:?}: {source}")]
    Graph {
        /// The ONNX file.
        file: String,
        /// What is wrong with it.
        source: NetworkError,
    },
    /// ONNX Runtime's library is there but cannot be used.
    #[error("cannot use ONNX Runtime")]
    Runtime(#[source] NetworkError),
    /// What the networks are to run on.
    #[error(transparent)]
    Provider(#[from] ProviderError),
    /// The tokenizer's file.
    #[error("bundle file {file:?}: not a tokenizer: {reason}")]
    Tokenizer {
        /// The file.
        file: String,
        /// The parser's words.
        reason: String,
    },
}

/// Networks from a keyframe's colors to its generic codes.
pub struct VisionNetworks {
    /// How colors are prepared.
    pub image: ImageSpec,
    /// What is run on them.
    pub stages: VisionStages,
    /// Rows and columns of the codes.
    pub grid: [usize; 2],
}

/// `[1, 3, height, width]` -> generic codes `[1, 32, grid height, grid width]`, unit length over 32.
pub enum VisionStages {
    /// In one graph.
    Folded {
        /// Image -> codes.
        network: Network,
        /// Features -> codes, for labels that are given, if the bundle has it.
        compressor: Option<Network>,
    },
    /// In the method's three.
    Apart {
        /// `[1, 3, height, width]` -> coarse features and skips.
        encoder: Network,
        /// Those -> features `[1, D, grid height, grid width]`.
        srd: Network,
        /// Features -> codes.
        compressor: Network,
    },
}

/// Words -> embeddings.
pub struct TextTower {
    tokenizer: Tokenizer,
    /// Tokens -> embedding `[1, D]`, unit length.
    network: Network,
}

/// Networks from words and codes to features that can be compared.
pub struct TextNetworks {
    /// Words -> embeddings.
    pub tower: TextTower,
    /// Generic codes `[n, 32]` -> features `[n, D]`, unit length.
    pub decompressor: Network,
    /// How features are compared.
    pub relevancy: RelevancySpec,
    /// D.
    pub feature_size: usize,
}

/// A loaded and checked bundle.
pub struct Bundle {
    name: String,
    vision: VisionNetworks,
    text: TextNetworks,
}

impl Bundle {
    /// Finds ONNX Runtime and the bundle's folder, loads and checks everything in it.
    ///
    /// # Errors
    /// [`BundleError`] names the file, the tensor, and what was expected and found.
    pub fn load(config: &LanguageConfig) -> Result<Self, BundleError> {
        let folder = find::bundle(&config.models)?;
        let library = find::runtime(config.runtime.as_deref())?;
        let runtime = Runtime::open(&library).map_err(BundleError::Runtime)?;
        let manifest = Manifest::read(&folder)?;
        let providers = provider::choose(&runtime, &config.providers)?;
        let threads = config.threads;
        let loader = Loader { folder: &folder, manifest: &manifest, runtime, providers, threads };
        let bundle =
            Self { name: manifest.name.clone(), vision: loader.vision()?, text: loader.text()? };
        tracing::info!(
            bundle = bundle.name,
            version = manifest.version,
            licence = manifest.licence,
            folder = %folder.display(),
            "networks loaded"
        );
        Ok(bundle)
    }

    /// The bundle's name, from its manifest.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What the language thread owns, and what the query thread owns.
    pub fn split(self) -> (VisionNetworks, TextNetworks) {
        (self.vision, self.text)
    }
}

/// Turns a manifest's entries into networks.
struct Loader<'a> {
    folder: &'a Path,
    manifest: &'a Manifest,
    runtime: Runtime,
    /// On what networks run, best first.
    providers: Vec<Provider>,
    /// Of one network; 0: one for each core.
    threads: usize,
}

impl Loader<'_> {
    fn vision(&self) -> Result<VisionNetworks, BundleError> {
        let manifest = self.manifest;
        let image = manifest.image.clone();
        let [rows, columns] = manifest.grid;
        let picture = [1, 3, image.height, image.width];
        let features = [1, manifest.feature_size, rows, columns];
        let codes = [1, GENERIC, rows, columns];
        // One image through everything: what the graphs leave open shows here and not at a keyframe.
        let probe = [Tensor::floats(&picture, vec![0.0; 3 * image.height * image.width])];
        let stages = match &manifest.vision {
            VisionSpec::Folded { graph, compressor } => {
                let (picture, codes) = ([Declared::floats(picture)], [Declared::floats(codes)]);
                let features = [Declared::floats(features)];
                let mut network = self.network(graph, &self.providers, &picture, &codes)?;
                run(graph, &mut network, &probe)?;
                let compressor = compressor.as_ref();
                let load = |spec| self.network(spec, &self.providers, &features, &codes);
                VisionStages::Folded { network, compressor: compressor.map(load).transpose()? }
            }
            VisionSpec::Stages { encoder, srd, compressor } => {
                let load = |spec: &GraphSpec, inputs: &[Declared], outputs: &[Declared]| {
                    self.network(spec, &self.providers, inputs, outputs)
                };
                let any = |count| vec![Declared::any(); count];
                let picture = [Declared::floats(picture)];
                let mut encode = load(encoder, &picture, &any(encoder.outputs.len()))?;
                let features = [Declared::floats(features)];
                let mut upsample = load(srd, &any(srd.inputs.len()), &features)?;
                let mut compress = load(compressor, &features, &[Declared::floats(codes)])?;
                let coarse = run(encoder, &mut encode, &probe)?;
                let dense = run(srd, &mut upsample, &coarse)?;
                run(compressor, &mut compress, &dense)?;
                VisionStages::Apart { encoder: encode, srd: upsample, compressor: compress }
            }
        };
        Ok(VisionNetworks { image, stages, grid: manifest.grid })
    }

    fn text(&self) -> Result<TextNetworks, BundleError> {
        let manifest = self.manifest;
        let size = manifest.feature_size;
        let tokenizer = self.tokenizer()?;
        let graph = &manifest.text.graph;
        // TensorRT would compile these again for every length of a text and every number of codes.
        let mut providers = self.providers.clone();
        providers.retain(|&provider| provider != Provider::TensorRt);
        let network = self.network(
            graph,
            &providers,
            &vec![Declared::new(Kind::Int64, &[Some(1), None]); graph.inputs.len()],
            &[Declared::floats([1, size])],
        )?;
        let decoder = &manifest.decoder;
        let mut decompressor = self.network(
            decoder,
            &providers,
            &[Declared::new(Kind::Float32, &[None, Some(GENERIC)])],
            &[Declared::new(Kind::Float32, &[None, Some(size)])],
        )?;
        let mut one = vec![0.0; GENERIC];
        one[0] = 1.0;
        run(decoder, &mut decompressor, &[Tensor::floats(&[1, GENERIC], one)])?;
        let mut tower = TextTower { tokenizer, network };
        tower
            .embed(PROBE_TEXT)
            .map_err(|source| BundleError::Graph { file: graph.file.clone(), source })?;
        let relevancy = manifest.relevancy.clone();
        Ok(TextNetworks { tower, decompressor, relevancy, feature_size: size })
    }

    fn network(
        &self,
        spec: &GraphSpec,
        providers: &[Provider],
        inputs: &[Declared],
        outputs: &[Declared],
    ) -> Result<Network, BundleError> {
        let bytes = self.manifest.bytes(self.folder, &spec.file)?;
        let inputs = spec.inputs.iter().cloned().zip(inputs.iter().cloned()).collect();
        let outputs = spec.outputs.iter().cloned().zip(outputs.iter().cloned()).collect();
        self.runtime
            .builder(providers, self.threads)
            .and_then(|builder| Network::load(builder, &bytes, inputs, outputs))
            .map_err(|source| BundleError::Graph { file: spec.file.clone(), source })
    }

    fn tokenizer(&self) -> Result<Tokenizer, BundleError> {
        let file = &self.manifest.text.tokenizer;
        let wrong = |reason: tokenizers::Error| BundleError::Tokenizer {
            file: file.clone(),
            reason: reason.to_string(),
        };
        let mut tokenizer =
            Tokenizer::from_bytes(self.manifest.bytes(self.folder, file)?).map_err(wrong)?;
        let max_length = self.manifest.text.max_tokens;
        let truncation = tokenizers::TruncationParams { max_length, ..Default::default() };
        tokenizer.with_truncation(Some(truncation)).map_err(wrong)?;
        tokenizer.with_padding(None);
        Ok(tokenizer)
    }
}

fn run(
    spec: &GraphSpec,
    network: &mut Network,
    inputs: &[Tensor],
) -> Result<Vec<Tensor>, BundleError> {
    network.run(inputs).map_err(|source| BundleError::Graph { file: spec.file.clone(), source })
}

impl TextTower {
    /// A text's embedding `[D]`, unit length. Text beyond the bundle's `max_tokens` is not read.
    ///
    /// # Errors
    /// [`NetworkError`] if the tokenizer or the tower fails.
    pub fn embed(&mut self, text: &str) -> Result<Vec<f32>, NetworkError> {
        let encoding = self
            .tokenizer
            .encode(text, true)
            .map_err(|reason| NetworkError::Tokenizer { reason: reason.to_string() })?;
        let tokens = encoding.len();
        // A graph with a fixed context takes padded tokens, masked out.
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

#[cfg(test)]
mod tests;
