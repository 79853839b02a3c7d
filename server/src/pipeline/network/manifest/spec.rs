//! Contents of a checked manifest.

use super::error::ManifestError;
use serde::Deserialize;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Component, Path};

/// Channels of a generic code, the same for every bundle.
pub const GENERIC_SIZE: usize = 32;

/// How an image is turned into the input `[1, 3, height, width]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageSpec {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// How an image of another aspect ratio is fitted.
    pub fit: Fit,
    /// Order of the color channels.
    pub channel_order: ChannelOrder,
    /// Subtracted from each channel, in their order, on the scale 0..255.
    pub mean: [f32; 3],
    /// Each channel is divided by this after the subtraction.
    pub std: [f32; 3],
    /// Whether images are shrunk with an antialiasing filter. False suits networks that were
    /// trained on plain bilinear samples.
    #[serde(default = "antialias_by_default")]
    pub antialias: bool,
}

fn antialias_by_default() -> bool {
    true
}

/// How an image of another aspect ratio is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fit {
    /// Width and height are scaled independently.
    Squash,
    /// The aspect ratio is kept. The image is at the top left; the rest is filled with the mean.
    Pad,
}

/// Order of an image's channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ChannelOrder {
    /// Red first.
    Rgb,
    /// Blue first.
    Bgr,
}

/// Parameters of the relevancy (paper §5; from LERF).
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RelevancySpec {
    /// Factor on cosines before the softmax.
    pub temperature: f32,
    /// Subtracted from the softmax's logit, so that features that match a text have 0.5 or more.
    #[serde(default)]
    pub bias: f32,
    /// Relevancy above which a pixel or a Gaussian counts, 0..1.
    pub threshold: f32,
    /// Canonical negative texts.
    pub negatives: Vec<String>,
    /// Score at which the confidence is one half, 0..1; absent: `threshold`.
    pub present_threshold: Option<f32>,
    /// Slope of the confidence around that score; absent: a default that was not fitted.
    pub confidence_steepness: Option<f32>,
}

/// One ONNX file and those of its tensors that are used, in order.
#[derive(Clone, Debug)]
pub(crate) struct GraphSpec {
    pub file: String,
    pub inputs: Vec<String>,
    pub outputs: Vec<String>,
}

/// Graphs from an image to generic codes.
#[derive(Clone, Debug)]
pub(crate) enum VisionSpec {
    /// One graph: image -> codes. The optional compressor (features -> codes) is for labels that
    /// come with a frame.
    EndToEnd { graph: GraphSpec, compressor: Option<GraphSpec> },
    /// Three graphs: image -> coarse features and skips -> dense features -> codes.
    Staged { encoder: GraphSpec, srd: GraphSpec, compressor: GraphSpec },
}

/// The text tower: text -> embedding.
#[derive(Clone, Debug)]
pub(crate) struct TextSpec {
    pub graph: GraphSpec,
    pub tokenizer: String,
    pub max_tokens: usize,
}

/// A checked manifest.
#[derive(Clone, Debug)]
pub(crate) struct Manifest {
    pub name: String,
    pub version: String,
    pub licence: String,
    pub feature_size: usize,
    pub image: ImageSpec,
    pub vision: VisionSpec,
    /// Rows and columns of the grid of codes.
    pub grid: [usize; 2],
    /// Codes -> features.
    pub decoder: GraphSpec,
    pub text: TextSpec,
    pub relevancy: RelevancySpec,
    /// SHA-256 of each file, hexadecimal.
    pub sha256: BTreeMap<String, String>,
    /// SHA-256 of the manifest itself.
    pub digest: String,
}

impl Manifest {
    /// The bytes of one of the bundle's files, after a check of its SHA-256.
    pub(crate) fn bytes(&self, folder: &Path, file: &str) -> Result<Vec<u8>, ManifestError> {
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
