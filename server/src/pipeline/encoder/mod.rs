//! From a keyframe's colors to language: the image encoder (paper §4.1) and the thread on which
//! it, the [`super::srd`] and the generic compressor run.
//!
//! In: [`Frame`]s. Out: [`LanguageMap`]s, one generic code for each cell of the bundle's grid. A frame
//! that carries labels gets the codes of their texts, and no network looks at it. The
//! thread owns the networks and never holds geometry up: its queue is bounded and a full one gives
//! the frame back.

mod config;
mod labels;
mod prepare;
mod resample;
mod thread;

pub use config::LanguageConfig;
pub use labels::Embed;
pub use thread::LanguageThread;

use super::compressor::GENERIC;
use super::compressor::generic::{CodeGrid, GenericEncoder, grid_of};
use super::frame::{Frame, Labels};
use super::network::{ImageSpec, Network, NetworkError, Tensor, VisionNetworks, VisionStages};
use super::srd::SuperResolution;
use labels::{LabelCodes, majority};
use prepare::Preparation;
use std::time::Instant;

/// A keyframe's language: generic codes on a grid over the whole image.
#[derive(Clone, Debug)]
pub struct LanguageMap {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height * width * 32]`, row-major, unit length.
    pub codes: Vec<f32>,
    /// Where the time went.
    pub timing: LanguageTiming,
}

/// Milliseconds. Where the bundle has one graph for all, its time is the encoder's.
#[derive(Clone, Copy, Debug, Default)]
pub struct LanguageTiming {
    /// Preparing the image.
    pub prepare: f32,
    /// The image encoder.
    pub encoder: f32,
    /// The super-resolution decoder.
    pub srd: f32,
    /// The generic compressor.
    pub compressor: f32,
}

/// Why a keyframe has no language.
#[derive(Debug, thiserror::Error)]
pub enum LanguageError {
    /// A network failed.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// A label's text has no embedding.
    #[error("a label's text cannot be embedded: {reason}")]
    Text {
        /// The text tower's words.
        reason: String,
    },
    /// Labels are given, and nothing makes codes of their texts.
    #[error("labels were given, but the bundle has no compressor: name one in compressor.encoder")]
    NoCompressor,
}

/// From colors, or from given labels, to generic codes.
pub struct Vision {
    image: ImageSpec,
    preparation: Preparation,
    /// `[1, 3, height, width]`, written anew for every frame.
    input: [Tensor; 1],
    labels: LabelCodes,
    label_columns: usize,
    stages: Stages,
}

/// The networks, each in its stage.
enum Stages {
    Folded { network: Network, compressor: Option<GenericEncoder> },
    Apart { encoder: Network, srd: SuperResolution, compressor: GenericEncoder },
}

impl Vision {
    /// With the bundle's networks; `embed` makes features of labels' texts.
    pub fn new(networks: VisionNetworks, embed: Embed, config: &LanguageConfig) -> Self {
        let VisionNetworks { image, stages, grid } = networks;
        let stages = match stages {
            VisionStages::Folded { network, compressor } => {
                Stages::Folded { network, compressor: compressor.map(GenericEncoder::new) }
            }
            VisionStages::Apart { encoder, srd, compressor } => Stages::Apart {
                encoder,
                srd: SuperResolution::new(srd, grid, config.srd),
                compressor: GenericEncoder::new(compressor),
            },
        };
        let shape = [1, 3, image.height, image.width];
        let input = [Tensor::floats(&shape, vec![0.0; 3 * image.height * image.width])];
        let labels = LabelCodes::new(embed, grid);
        let label_columns = config.label_columns;
        Self { image, preparation: Preparation::default(), input, labels, label_columns, stages }
    }

    /// A frame's language: given with it, or seen in it.
    ///
    /// # Errors
    /// [`LanguageError`] if a network fails.
    pub fn run(&mut self, frame: &Frame) -> Result<LanguageMap, LanguageError> {
        match &frame.labels {
            Some(labels) => self.given(frame, labels),
            None => Ok(self.seen(frame)?),
        }
    }

    /// What the labels say, at their own resolution up to the configured one.
    fn given(&mut self, frame: &Frame, labels: &Labels) -> Result<LanguageMap, LanguageError> {
        let mut clock = Stopwatch(Instant::now());
        let from = (frame.intrinsics.width as usize, frame.intrinsics.height as usize);
        let [width, height] = labels::size(from, self.label_columns);
        let ids = majority(&labels.ids, from, (width, height));
        let mut timing = LanguageTiming { prepare: clock.lap(), ..Default::default() };
        let compressor = match &mut self.stages {
            Stages::Apart { compressor, .. } => Some(compressor),
            Stages::Folded { compressor, .. } => compressor.as_mut(),
        };
        let compressor = compressor.ok_or(LanguageError::NoCompressor)?;
        let code_of = self.labels.of(compressor, labels)?;
        let codes = ids.iter().flat_map(|id| code_of[usize::from(*id)]).collect();
        timing.compressor = clock.lap();
        Ok(LanguageMap { width: width as u32, height: height as u32, codes, timing })
    }

    /// What the networks see.
    fn seen(&mut self, frame: &Frame) -> Result<LanguageMap, NetworkError> {
        let mut clock = Stopwatch(Instant::now());
        let covered = self.preparation.run(frame, &self.image, self.input[0].floats_mut());
        let mut timing = LanguageTiming { prepare: clock.lap(), ..Default::default() };
        let grid = match &mut self.stages {
            Stages::Folded { network, .. } => {
                let codes = network.run(&self.input)?;
                timing.encoder = clock.lap();
                grid_of(&codes[0])
            }
            Stages::Apart { encoder, srd, compressor } => {
                let coarse_and_skips = encoder.run(&self.input)?;
                timing.encoder = clock.lap();
                let features = srd.upsample(&coarse_and_skips)?;
                timing.srd = clock.lap();
                compressor.compress(&features)?
            }
        };
        let CodeGrid { height, width, codes } = cropped(grid, covered);
        timing.compressor = clock.lap();
        Ok(LanguageMap { width: width as u32, height: height as u32, codes, timing })
    }
}

/// The cells that see the image and not what it was padded with. `covered`: the share of the
/// network's columns and rows that the image fills, from the top left.
fn cropped(grid: CodeGrid, covered: [f32; 2]) -> CodeGrid {
    let [width, height] = kept([grid.height, grid.width], covered);
    if (width, height) == (grid.width, grid.height) {
        return grid;
    }
    let rows = grid.codes.chunks_exact(grid.width * GENERIC).take(height);
    let codes = rows.flat_map(|row| &row[..width * GENERIC]).copied().collect();
    CodeGrid { height, width, codes }
}

/// Columns and rows of a grid of `[rows, columns]` that see the image.
fn kept([rows, columns]: [usize; 2], covered: [f32; 2]) -> [usize; 2] {
    let kept = |size: usize, share: f32| ((size as f32 * share).round() as usize).clamp(1, size);
    [kept(columns, covered[0]), kept(rows, covered[1])]
}

/// Milliseconds since the last lap.
struct Stopwatch(Instant);

impl Stopwatch {
    fn lap(&mut self) -> f32 {
        let now = Instant::now();
        let lap = now.duration_since(std::mem::replace(&mut self.0, now));
        lap.as_secs_f32() * 1e3
    }
}

#[cfg(test)]
mod tests;
