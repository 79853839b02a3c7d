//! Loads and checks a bundle.

use super::availability::{self, ProviderError};
use super::error::NetworkError;
use super::find::{self, FindError};
use super::manifest::{self, GENERIC_SIZE, GraphSpec, Manifest, ManifestError, VisionSpec};
use super::networks::{TextNetworks, TextTower, VisionNetworks, VisionStages};
use super::provider::Provider;
use super::runtime::{Network, Runtime};
use super::tensor::{ElementType, Tensor, TensorSpec};
use std::path::Path;
use tokenizers::Tokenizer;

/// Text that each bundle must be able to embed.
const PROBE_TEXT: &str = "object";

/// Which bundle is loaded, and how its networks run.
#[derive(Clone, Copy, Debug)]
pub struct BundleOptions<'a> {
    /// Folder of the bundle. A relative path is also looked up beside the executable and in the
    /// folders above it.
    pub models: &'a Path,
    /// ONNX Runtime's shared library; `None`: `ORT_DYLIB_PATH`, or else the one of `make deps`.
    pub runtime: Option<&'a Path>,
    /// Execution providers, preferred ones first.
    pub providers: &'a [Provider],
    /// Threads of one network; 0: one for each core.
    pub threads: usize,
}

/// Why a bundle cannot be loaded.
#[derive(Debug, thiserror::Error)]
pub enum BundleError {
    /// The runtime's library or the bundle's folder was not found.
    #[error(transparent)]
    Find(#[from] FindError),
    /// The manifest or a file is invalid.
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    /// ONNX Runtime refused a file, or its tensors are not the manifest's.
    #[error("bundle file {file:?}: {source}")]
    Graph {
        /// Name of the ONNX file.
        file: String,
        /// The cause.
        source: NetworkError,
    },
    /// ONNX Runtime's library was found but cannot be used.
    #[error("cannot use ONNX Runtime")]
    Runtime(#[source] NetworkError),
    /// The execution providers cannot be used.
    #[error(transparent)]
    Provider(#[from] ProviderError),
    /// The tokenizer's file cannot be parsed.
    #[error("bundle file {file:?}: not a tokenizer: {reason}")]
    Tokenizer {
        /// Name of the file.
        file: String,
        /// The parser's message.
        reason: String,
    },
}

/// A loaded and checked bundle.
pub struct Bundle {
    name: String,
    digest: String,
    vision: VisionNetworks,
    text: TextNetworks,
}

impl Bundle {
    /// Finds ONNX Runtime and the bundle's folder, and loads and checks all networks.
    ///
    /// # Errors
    /// [`BundleError`] names the file and the tensor, with the expected and the found value.
    pub fn load<'a>(options: impl Into<BundleOptions<'a>>) -> Result<Self, BundleError> {
        let BundleOptions { models, runtime, providers, threads } = options.into();
        let folder = find::bundle(models)?;
        let library = find::runtime(runtime)?;
        let runtime = Runtime::open(&library).map_err(BundleError::Runtime)?;
        let manifest = manifest::read(&folder)?;
        let providers = availability::choose(&runtime, providers)?;
        let loader = Loader { folder: &folder, manifest: &manifest, runtime, providers, threads };
        let (name, digest) = (manifest.name.clone(), manifest.digest.clone());
        let bundle = Self { name, digest, vision: loader.vision()?, text: loader.text()? };
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
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// SHA-256 of its manifest, which has those of its files.
    pub(crate) fn digest(&self) -> &str {
        &self.digest
    }

    /// The networks of the language thread and those of the query thread.
    pub fn split(self) -> (VisionNetworks, TextNetworks) {
        (self.vision, self.text)
    }
}

/// Turns a manifest's entries into networks.
struct Loader<'a> {
    folder: &'a Path,
    manifest: &'a Manifest,
    runtime: Runtime,
    /// Execution providers, preferred ones first.
    providers: Vec<Provider>,
    /// Threads of one network; 0: one for each core.
    threads: usize,
}

impl Loader<'_> {
    fn vision(&self) -> Result<VisionNetworks, BundleError> {
        let manifest = self.manifest;
        let image = manifest.image.clone();
        let [rows, columns] = manifest.grid;
        let picture = [1, 3, image.height, image.width];
        let features = [1, manifest.feature_size, rows, columns];
        let codes = [1, GENERIC_SIZE, rows, columns];
        // Run one image through all graphs: sizes that they leave open are checked now, and not at
        // the first keyframe.
        let probe = [Tensor::floats(&picture, vec![0.0; 3 * image.height * image.width])];
        let stages = match &manifest.vision {
            VisionSpec::EndToEnd { graph, compressor } => {
                let (picture, codes) = ([TensorSpec::floats(picture)], [TensorSpec::floats(codes)]);
                let features = [TensorSpec::floats(features)];
                let mut network = self.network(graph, &self.providers, &picture, &codes)?;
                run(graph, &mut network, &probe)?;
                let compressor = compressor.as_ref();
                let load = |spec| self.network(spec, &self.providers, &features, &codes);
                VisionStages::EndToEnd { network, compressor: compressor.map(load).transpose()? }
            }
            VisionSpec::Staged { encoder, srd, compressor } => {
                let load = |spec: &GraphSpec, inputs: &[TensorSpec], outputs: &[TensorSpec]| {
                    self.network(spec, &self.providers, inputs, outputs)
                };
                let any = |count| vec![TensorSpec::any(); count];
                let picture = [TensorSpec::floats(picture)];
                let mut encode = load(encoder, &picture, &any(encoder.outputs.len()))?;
                let features = [TensorSpec::floats(features)];
                let mut upsample = load(srd, &any(srd.inputs.len()), &features)?;
                let mut compress = load(compressor, &features, &[TensorSpec::floats(codes)])?;
                let coarse = run(encoder, &mut encode, &probe)?;
                let dense = run(srd, &mut upsample, &coarse)?;
                run(compressor, &mut compress, &dense)?;
                VisionStages::Staged { encoder: encode, srd: upsample, compressor: compress }
            }
        };
        Ok(VisionNetworks { image, stages, grid: manifest.grid })
    }

    fn text(&self) -> Result<TextNetworks, BundleError> {
        let manifest = self.manifest;
        let size = manifest.feature_size;
        let tokenizer = self.tokenizer()?;
        let graph = &manifest.text.graph;
        // TensorRT would compile these again for each length of a text and each number of codes.
        let mut providers = self.providers.clone();
        providers.retain(|&provider| provider != Provider::TensorRt);
        let network = self.network(
            graph,
            &providers,
            &vec![TensorSpec::new(ElementType::Int64, &[Some(1), None]); graph.inputs.len()],
            &[TensorSpec::floats([1, size])],
        )?;
        let decoder = &manifest.decoder;
        let mut decompressor = self.network(
            decoder,
            &providers,
            &[TensorSpec::new(ElementType::Float32, &[None, Some(GENERIC_SIZE)])],
            &[TensorSpec::new(ElementType::Float32, &[None, Some(size)])],
        )?;
        let mut one = vec![0.0; GENERIC_SIZE];
        one[0] = 1.0;
        run(decoder, &mut decompressor, &[Tensor::floats(&[1, GENERIC_SIZE], one)])?;
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
        inputs: &[TensorSpec],
        outputs: &[TensorSpec],
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
