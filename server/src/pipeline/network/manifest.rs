//! `manifest.toml`: what a bundle holds and how it is to be used.
//!
//! In: the bundle's folder. Out: a [`Manifest`] whose values make sense together, and the bytes of
//! the files in it, checked by SHA-256. Unknown keys are refused. No graph is loaded here.

use super::super::compressor::GENERIC;
use serde::Deserialize;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

/// Names of token inputs that a text tower may have.
const TOKEN_INPUTS: [&str; 3] = ["input_ids", "attention_mask", "token_type_ids"];

/// A bundle that is not what it says.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// The manifest itself.
    #[error("{}: {reason}", path.display())]
    Syntax {
        /// The manifest.
        path: PathBuf,
        /// Line, key and the keys that there are.
        reason: String,
    },
    /// A value that cannot be.
    #[error("manifest.toml: {key}: expected {expected}, found {found}")]
    Value {
        /// The key.
        key: &'static str,
        /// What would do.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A file that is named but not there.
    #[error("bundle file {file:?}: cannot be read from {}: {source}", folder.display())]
    File {
        /// The file.
        file: String,
        /// The bundle.
        folder: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// A file without a checksum.
    #[error("manifest.toml: sha256: expected an entry for {file:?}, found none")]
    NoChecksum {
        /// The file.
        file: String,
    },
    /// A file that is not the one of the manifest.
    #[error("bundle file {file:?}: expected sha256 {expected}, found {found}")]
    Checksum {
        /// The file.
        file: String,
        /// The manifest's.
        expected: String,
        /// The file's.
        found: String,
    },
}

/// How an image becomes `[1, 3, height, width]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageSpec {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// What happens to another aspect ratio.
    pub fit: Fit,
    /// Which colour is first.
    pub channel_order: ChannelOrder,
    /// Subtracted, on the scale 0..255, in the channels' order.
    pub mean: [f32; 3],
    /// Divided by, after that.
    pub std: [f32; 3],
}

/// What happens to an image of another aspect ratio.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fit {
    /// Both sides are scaled on their own.
    Squash,
    /// Scaled as it is, to the top left; the rest is the mean.
    Pad,
}

/// The order of an image's channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ChannelOrder {
    /// Red first.
    Rgb,
    /// Blue first.
    Bgr,
}

/// How features are compared with words (paper §5; LERF's relevancy).
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RelevancySpec {
    /// Factor on cosines before the softmax.
    pub temperature: f32,
    /// Subtracted from the softmax's logit, so that what belongs to a word begins at 0.5.
    #[serde(default)]
    pub bias: f32,
    /// Relevancy above which something counts.
    pub threshold: f32,
    /// What everything is compared with.
    pub negatives: Vec<String>,
    /// Score above which what was asked for is there; absent: `threshold`.
    pub present_threshold: Option<f32>,
}

/// One ONNX file and the tensors that are used of it, in order.
#[derive(Clone, Debug)]
pub(super) struct GraphSpec {
    pub file: String,
    pub inputs: Vec<String>,
    pub outputs: Vec<String>,
}

/// Coarse features and skips to dense features.
#[derive(Clone, Debug)]
pub(super) struct SrdSpec {
    pub graph: GraphSpec,
    /// Rows and columns of the dense features.
    pub grid: [usize; 2],
}

/// Features to generic codes and back.
#[derive(Clone, Debug)]
pub(super) struct CompressorSpec {
    pub encoder: GraphSpec,
    pub decoder: GraphSpec,
}

/// Words to an embedding.
#[derive(Clone, Debug)]
pub(super) struct TextSpec {
    pub graph: GraphSpec,
    pub tokenizer: String,
    pub max_tokens: usize,
}

/// A manifest whose values make sense together.
#[derive(Clone, Debug)]
pub(super) struct Manifest {
    pub name: String,
    pub version: String,
    pub licence: String,
    pub feature_size: usize,
    pub image: ImageSpec,
    pub encoder: GraphSpec,
    pub srd: SrdSpec,
    pub compressor: CompressorSpec,
    pub text: TextSpec,
    pub relevancy: RelevancySpec,
    sha256: BTreeMap<String, String>,
}

/// The file as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    name: String,
    version: String,
    licence: String,
    feature_size: usize,
    code_size: usize,
    image: ImageSpec,
    encoder: WrittenEncoder,
    srd: WrittenSrd,
    compressor: WrittenCompressor,
    text: WrittenText,
    relevancy: RelevancySpec,
    sha256: BTreeMap<String, String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenEncoder {
    file: String,
    input: String,
    outputs: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenSrd {
    file: String,
    inputs: Vec<String>,
    output: String,
    grid: [usize; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenCompressor {
    encoder: WrittenGraph,
    decoder: WrittenGraph,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenGraph {
    file: String,
    input: String,
    output: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenText {
    file: String,
    tokenizer: String,
    inputs: Vec<String>,
    output: String,
    max_tokens: usize,
}

impl From<WrittenGraph> for GraphSpec {
    fn from(written: WrittenGraph) -> Self {
        let WrittenGraph { file, input, output } = written;
        Self { file, inputs: vec![input], outputs: vec![output] }
    }
}

impl From<Written> for Manifest {
    fn from(written: Written) -> Self {
        let WrittenEncoder { file, input, outputs } = written.encoder;
        let encoder = GraphSpec { file, inputs: vec![input], outputs };
        let WrittenSrd { file, inputs, output, grid } = written.srd;
        let srd = SrdSpec { graph: GraphSpec { file, inputs, outputs: vec![output] }, grid };
        let WrittenCompressor { encoder: compress, decoder } = written.compressor;
        let compressor = CompressorSpec { encoder: compress.into(), decoder: decoder.into() };
        let WrittenText { file, tokenizer, inputs, output, max_tokens } = written.text;
        let graph = GraphSpec { file, inputs, outputs: vec![output] };
        Self {
            name: written.name,
            version: written.version,
            licence: written.licence,
            feature_size: written.feature_size,
            image: written.image,
            encoder,
            srd,
            compressor,
            text: TextSpec { graph, tokenizer, max_tokens },
            relevancy: written.relevancy,
            sha256: written.sha256,
        }
    }
}

impl Manifest {
    /// Reads and checks `manifest.toml` in the bundle's folder.
    pub(super) fn read(folder: &Path) -> Result<Self, ManifestError> {
        let path = folder.join("manifest.toml");
        let text = std::fs::read_to_string(&path).map_err(|reason| ManifestError::Syntax {
            path: path.clone(),
            reason: reason.to_string(),
        })?;
        let written: Written = toml::from_str(&text)
            .map_err(|reason| ManifestError::Syntax { path, reason: reason.to_string() })?;
        written.check()?;
        Ok(written.into())
    }

    /// The bytes of one of the bundle's files: exactly those that the manifest was written for.
    pub(super) fn bytes(&self, folder: &Path, file: &str) -> Result<Vec<u8>, ManifestError> {
        let inside = Path::new(file).components().all(|part| matches!(part, Component::Normal(_)));
        if !inside {
            let expected = "a path below the bundle's folder".into();
            return Err(ManifestError::Value { key: "file", expected, found: file.into() });
        }
        let expected =
            self.sha256.get(file).ok_or_else(|| ManifestError::NoChecksum { file: file.into() })?;
        let bytes = std::fs::read(folder.join(file)).map_err(|source| ManifestError::File {
            file: file.into(),
            folder: folder.to_owned(),
            source,
        })?;
        let found: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
        if !found.eq_ignore_ascii_case(expected) {
            let expected = expected.clone();
            return Err(ManifestError::Checksum { file: file.into(), expected, found });
        }
        Ok(bytes)
    }
}

impl Written {
    fn check(&self) -> Result<(), ManifestError> {
        let image = &self.image;
        let relevancy = &self.relevancy;
        let fraction = |value: f32| (0.0..=1.0).contains(&value);
        require(self.code_size == GENERIC, "code_size", "32", self.code_size)?;
        require(self.feature_size > 0, "feature_size", "more than 0", self.feature_size)?;
        require(image.width > 0, "image.width", "more than 0", image.width)?;
        require(image.height > 0, "image.height", "more than 0", image.height)?;
        let finite = image.mean.iter().all(|value| value.is_finite());
        require(finite, "image.mean", "finite numbers", format!("{:?}", image.mean))?;
        let positive = image.std.iter().all(|&value| value.is_finite() && value > 0.0);
        require(positive, "image.std", "numbers above 0", format!("{:?}", image.std))?;
        let [rows, columns] = self.srd.grid;
        require(
            rows > 0 && columns > 0,
            "srd.grid",
            "rows and columns above 0",
            rows.min(columns),
        )?;
        let (fed, wanted) = (self.encoder.outputs.len(), self.srd.inputs.len());
        require(
            fed == wanted && fed > 0,
            "srd.inputs",
            format!("as many as encoder.outputs: {fed}, at least 1"),
            wanted,
        )?;
        for input in &self.text.inputs {
            let known = TOKEN_INPUTS.contains(&input.as_str());
            require(known, "text.inputs", format!("some of {TOKEN_INPUTS:?}"), input)?;
        }
        let has_tokens = self.text.inputs.iter().any(|input| input == TOKEN_INPUTS[0]);
        require(has_tokens, "text.inputs", TOKEN_INPUTS[0], "none")?;
        // Two of a text's tokens are its ends.
        require(self.text.max_tokens > 2, "text.max_tokens", "more than 2", self.text.max_tokens)?;
        let temperature = relevancy.temperature;
        require(
            temperature.is_finite() && temperature > 0.0,
            "relevancy.temperature",
            "more than 0",
            temperature,
        )?;
        require(relevancy.bias.is_finite(), "relevancy.bias", "a finite number", relevancy.bias)?;
        require(!relevancy.negatives.is_empty(), "relevancy.negatives", "at least 1", 0)?;
        let threshold = relevancy.threshold;
        require(fraction(threshold), "relevancy.threshold", "0 to 1", threshold)?;
        let present = relevancy.present_threshold.unwrap_or(threshold);
        require(fraction(present), "relevancy.present_threshold", "0 to 1", present)
    }
}

fn require(
    holds: bool,
    key: &'static str,
    expected: impl ToString,
    found: impl ToString,
) -> Result<(), ManifestError> {
    if holds {
        return Ok(());
    }
    Err(ManifestError::Value { key, expected: expected.to_string(), found: found.to_string() })
}
