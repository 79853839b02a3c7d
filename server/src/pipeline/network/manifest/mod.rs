//! `manifest.toml`: what a bundle holds and how it is to be used.
//!
//! In: the bundle's folder. Out: a [`Manifest`] whose values make sense together, and the bytes of
//! the files in it, checked by SHA-256. Unknown keys are refused. No graph is loaded here.

mod written;

use serde::Deserialize;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use written::Written;

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
    /// Which color is first.
    pub channel_order: ChannelOrder,
    /// Subtracted, on the scale 0..255, in the channels' order.
    pub mean: [f32; 3],
    /// Divided by, after that.
    pub std: [f32; 3],
    /// Whether a smaller image is made of averages over what it drops. Networks that were trained on
    /// plain bilinear samples want false.
    #[serde(default = "antialias_by_default")]
    pub antialias: bool,
}

fn antialias_by_default() -> bool {
    true
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
    /// How fast confidence grows with the score around that; absent: a default that is no fit.
    pub confidence_steepness: Option<f32>,
}

/// One ONNX file and the tensors that are used of it, in order.
#[derive(Clone, Debug)]
pub(super) struct GraphSpec {
    pub file: String,
    pub inputs: Vec<String>,
    pub outputs: Vec<String>,
}

/// An image to generic codes: in one graph, or in the method's three.
#[derive(Clone, Debug)]
pub(super) enum VisionSpec {
    /// Image -> codes; features -> codes, for labels that are given, if it is there.
    Folded { graph: GraphSpec, compressor: Option<GraphSpec> },
    /// Image -> coarse features and skips -> dense features -> codes.
    Stages { encoder: GraphSpec, srd: GraphSpec, compressor: GraphSpec },
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
    pub vision: VisionSpec,
    /// Rows and columns of the codes.
    pub grid: [usize; 2],
    /// Codes -> features.
    pub decoder: GraphSpec,
    pub text: TextSpec,
    pub relevancy: RelevancySpec,
    sha256: BTreeMap<String, String>,
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
        written.checked()
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
