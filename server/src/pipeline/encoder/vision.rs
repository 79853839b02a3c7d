//! The networks from a frame to its language.

use super::config::LanguageConfig;
use super::error::LanguageError;
use super::labels::{self, Embed, LabelCodes, majority};
use super::language_map::{LanguageMap, LanguageTiming};
use super::prepare::Preparation;
use crate::pipeline::compressor::GENERIC_SIZE;
use crate::pipeline::compressor::generic::{CodeGrid, GenericEncoder};
use crate::pipeline::frame::{Frame, Labels};
use crate::pipeline::network::{
    ImageSpec, Network, NetworkError, Tensor, VisionNetworks, VisionStages,
};
use crate::pipeline::srd::SuperResolution;
use std::time::Instant;

/// Encodes frames: from colors, or from the labels that come with a frame, to generic codes.
pub struct Vision {
    image: ImageSpec,
    preparation: Preparation,
    /// `[1, 3, height, width]`, overwritten for each frame.
    input: [Tensor; 1],
    labels: LabelCodes,
    label_columns: usize,
    stages: Stages,
}

/// The networks.
enum Stages {
    EndToEnd { network: Network, compressor: Option<GenericEncoder> },
    Staged { encoder: Network, srd: SuperResolution, compressor: GenericEncoder },
}

impl Vision {
    /// Wraps the bundle's networks; `embed` embeds the texts of labels.
    pub fn new(networks: VisionNetworks, embed: Embed, config: &LanguageConfig) -> Self {
        let VisionNetworks { image, stages, grid } = networks;
        let stages = match stages {
            VisionStages::EndToEnd { network, compressor } => {
                Stages::EndToEnd { network, compressor: compressor.map(GenericEncoder::new) }
            }
            VisionStages::Staged { encoder, srd, compressor } => Stages::Staged {
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

    /// The language of a frame, from its labels if it has any, or else from its image.
    ///
    /// # Errors
    /// [`LanguageError`] if a network fails.
    pub fn run(&mut self, frame: &Frame) -> Result<LanguageMap, LanguageError> {
        match &frame.labels {
            Some(labels) => self.encode_labels(frame, labels),
            None => Ok(self.encode_image(frame)?),
        }
    }

    /// Codes of the labels' texts, at the resolution of the labels, up to the configured one.
    fn encode_labels(
        &mut self,
        frame: &Frame,
        labels: &Labels,
    ) -> Result<LanguageMap, LanguageError> {
        let mut clock = Stopwatch(Instant::now());
        let from = (frame.intrinsics.width as usize, frame.intrinsics.height as usize);
        let [width, height] = labels::size(from, self.label_columns);
        let ids = majority(&labels.ids, from, (width, height));
        let mut timing = LanguageTiming { prepare: clock.lap(), ..Default::default() };
        let compressor = match &mut self.stages {
            Stages::Staged { compressor, .. } => Some(compressor),
            Stages::EndToEnd { compressor, .. } => compressor.as_mut(),
        };
        let compressor = compressor.ok_or(LanguageError::NoCompressor)?;
        let code_of_label = self.labels.codes(compressor, labels)?;
        let codes = ids.iter().flat_map(|id| code_of_label[usize::from(*id)]).collect();
        timing.compressor = clock.lap();
        Ok(LanguageMap { width: width as u32, height: height as u32, codes, timing })
    }

    /// Codes of the image.
    fn encode_image(&mut self, frame: &Frame) -> Result<LanguageMap, NetworkError> {
        let mut clock = Stopwatch(Instant::now());
        let covered = self.preparation.run(frame, &self.image, self.input[0].floats_mut());
        let mut timing = LanguageTiming { prepare: clock.lap(), ..Default::default() };
        let grid = match &mut self.stages {
            Stages::EndToEnd { network, .. } => {
                let codes = network.run(&self.input)?;
                timing.encoder = clock.lap();
                CodeGrid::from_planes(&codes[0])
            }
            Stages::Staged { encoder, srd, compressor } => {
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

/// The grid without the cells of the padding. `covered` is the share of the network's columns and
/// rows that the image fills, from the top left.
pub(super) fn cropped(grid: CodeGrid, covered: [f32; 2]) -> CodeGrid {
    let [width, height] = kept([grid.height, grid.width], covered);
    if (width, height) == (grid.width, grid.height) {
        return grid;
    }
    let rows = grid.codes.chunks_exact(grid.width * GENERIC_SIZE).take(height);
    let codes = rows.flat_map(|row| &row[..width * GENERIC_SIZE]).copied().collect();
    CodeGrid { height, width, codes }
}

/// Columns and rows of a grid of `[rows, columns]` that belong to the image.
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
