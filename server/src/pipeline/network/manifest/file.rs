//! The keys of `manifest.toml`, and the checks that turn them into a [`Manifest`].
//!
//! The graphs from an image to codes are either one (`[vision]`) or three (`[encoder]`, `[srd]` and
//! `compressor.encoder`). A manifest must have exactly one of these two forms.

use super::error::ManifestError;
use super::spec::{
    GENERIC_SIZE, GraphSpec, ImageSpec, Manifest, RelevancySpec, TextSpec, VisionSpec,
};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Names of token inputs that a text tower may have.
const TOKEN_INPUTS: [&str; 3] = ["input_ids", "attention_mask", "token_type_ids"];
/// The two permitted forms, for error messages.
const VISION: &str = "[vision], or [encoder], [srd] and compressor.encoder";

/// The whole file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ManifestFile {
    name: String,
    version: String,
    licence: String,
    feature_size: usize,
    code_size: usize,
    image: ImageSpec,
    vision: Option<VisionSection>,
    encoder: Option<EncoderSection>,
    srd: Option<SrdSection>,
    compressor: CompressorSection,
    text: TextSection,
    relevancy: RelevancySpec,
    sha256: BTreeMap<String, String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct VisionSection {
    file: String,
    input: String,
    output: String,
    grid: [usize; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EncoderSection {
    file: String,
    input: String,
    outputs: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SrdSection {
    file: String,
    inputs: Vec<String>,
    output: String,
    grid: [usize; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CompressorSection {
    encoder: Option<GraphSection>,
    decoder: GraphSection,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GraphSection {
    file: String,
    input: String,
    output: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TextSection {
    file: String,
    tokenizer: String,
    inputs: Vec<String>,
    output: String,
    max_tokens: usize,
}

impl From<GraphSection> for GraphSpec {
    fn from(section: GraphSection) -> Self {
        let GraphSection { file, input, output } = section;
        Self { file, inputs: vec![input], outputs: vec![output] }
    }
}

impl ManifestFile {
    /// The manifest, if its values are permitted and consistent.
    pub(super) fn checked(self, digest: String) -> Result<Manifest, ManifestError> {
        self.check_values()?;
        let (vision, grid) = vision(self.vision, self.encoder, self.srd, self.compressor.encoder)?;
        let TextSection { file, tokenizer, inputs, output, max_tokens } = self.text;
        let graph = GraphSpec { file, inputs, outputs: vec![output] };
        Ok(Manifest {
            name: self.name,
            version: self.version,
            licence: self.licence,
            feature_size: self.feature_size,
            image: self.image,
            vision,
            grid,
            decoder: self.compressor.decoder.into(),
            text: TextSpec { graph, tokenizer, max_tokens },
            relevancy: self.relevancy,
            sha256: self.sha256,
            digest,
        })
    }

    fn check_values(&self) -> Result<(), ManifestError> {
        let image = &self.image;
        let relevancy = &self.relevancy;
        let fraction = |value: f32| (0.0..=1.0).contains(&value);
        require(self.code_size == GENERIC_SIZE, "code_size", "32", self.code_size)?;
        require(self.feature_size > 0, "feature_size", "more than 0", self.feature_size)?;
        require(image.width > 0, "image.width", "more than 0", image.width)?;
        require(image.height > 0, "image.height", "more than 0", image.height)?;
        let finite = image.mean.iter().all(|value| value.is_finite());
        require(finite, "image.mean", "finite numbers", format!("{:?}", image.mean))?;
        let positive = image.std.iter().all(|&value| value.is_finite() && value > 0.0);
        require(positive, "image.std", "numbers above 0", format!("{:?}", image.std))?;
        for input in &self.text.inputs {
            let known = TOKEN_INPUTS.contains(&input.as_str());
            require(known, "text.inputs", format!("some of {TOKEN_INPUTS:?}"), input)?;
        }
        let has_tokens = self.text.inputs.iter().any(|input| input == TOKEN_INPUTS[0]);
        require(has_tokens, "text.inputs", TOKEN_INPUTS[0], "none")?;
        // Each text has a start token and an end token.
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
        require(fraction(present), "relevancy.present_threshold", "0 to 1", present)?;
        let steepness = relevancy.confidence_steepness.unwrap_or(1.0);
        require(
            steepness.is_finite() && steepness > 0.0,
            "relevancy.confidence_steepness",
            "more than 0",
            steepness,
        )
    }
}

/// The graphs from an image to codes, and rows and columns of the codes.
fn vision(
    end_to_end: Option<VisionSection>,
    encoder: Option<EncoderSection>,
    srd: Option<SrdSection>,
    compressor: Option<GraphSection>,
) -> Result<(VisionSpec, [usize; 2]), ManifestError> {
    let wrong = |key, found: &str| ManifestError::Value {
        key,
        expected: VISION.into(),
        found: found.into(),
    };
    let (spec, grid, key) = match (end_to_end, encoder, srd, compressor) {
        (Some(section), None, None, compressor) => {
            let VisionSection { file, input, output, grid } = section;
            let graph = GraphSpec { file, inputs: vec![input], outputs: vec![output] };
            let compressor = compressor.map(GraphSpec::from);
            (VisionSpec::EndToEnd { graph, compressor }, grid, "vision.grid")
        }
        (None, Some(encoder), Some(srd), Some(compressor)) => {
            let (fed, wanted) = (encoder.outputs.len(), srd.inputs.len());
            require(
                fed == wanted && fed > 0,
                "srd.inputs",
                format!("as many as encoder.outputs: {fed}, at least 1"),
                wanted,
            )?;
            let EncoderSection { file, input, outputs } = encoder;
            let encoder = GraphSpec { file, inputs: vec![input], outputs };
            let SrdSection { file, inputs, output, grid } = srd;
            let srd = GraphSpec { file, inputs, outputs: vec![output] };
            let stages = VisionSpec::Staged { encoder, srd, compressor: compressor.into() };
            (stages, grid, "srd.grid")
        }
        (Some(_), ..) => return Err(wrong("vision", "both")),
        (None, None, ..) => return Err(wrong("encoder", "none")),
        (None, _, None, _) => return Err(wrong("srd", "none")),
        (None, _, _, None) => return Err(wrong("compressor.encoder", "none")),
    };
    let [rows, columns] = grid;
    require(rows > 0 && columns > 0, key, "rows and columns above 0", rows.min(columns))?;
    Ok((spec, grid))
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
