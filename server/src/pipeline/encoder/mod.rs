//! From a keyframe's colours to language: the image encoder (paper §4.1) and the thread on which
//! it, the [`super::srd`] and the generic compressor run.
//!
//! In: [`Frame`]s. Out: [`LanguageMap`]s, one generic code for each cell of the bundle's grid. The
//! thread owns the networks and never holds geometry up: its queue is bounded and a full one gives
//! the frame back.

mod prepare;
mod resample;
mod thread;

pub use thread::LanguageThread;

use super::compressor::GENERIC;
use super::compressor::generic::{CodeGrid, GenericEncoder, grid_of};
use super::frame::Frame;
use super::network::{
    ImageSpec, Network, NetworkError, Provider, Tensor, VisionNetworks, VisionStages,
};
use super::srd::SuperResolution;
use prepare::Preparation;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::time::Instant;

/// Which networks, and how they run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LanguageConfig {
    /// The bundle's folder; a relative one is also looked for beside the executable and above it.
    pub models: PathBuf,
    /// ONNX Runtime's shared library; `None`: `ORT_DYLIB_PATH`, else what `make deps` got.
    pub runtime: Option<PathBuf>,
    /// On what networks run, best first; without `cpu` at the end, one of them must work.
    pub providers: Vec<Provider>,
    /// Threads of one network; 0: one for each core.
    pub threads: usize,
    /// Keyframes that wait for the networks; when full they are given back.
    pub queue: usize,
}

impl Default for LanguageConfig {
    fn default() -> Self {
        Self {
            models: "models/tiny".into(),
            runtime: None,
            providers: vec![Provider::Cpu],
            threads: 0,
            queue: 4,
        }
    }
}

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

/// From colours to generic codes.
pub struct Vision {
    image: ImageSpec,
    preparation: Preparation,
    /// `[1, 3, height, width]`, written anew for every frame.
    input: [Tensor; 1],
    stages: Stages,
}

/// The networks, each in its stage.
#[expect(
    clippy::large_enum_variant,
    reason = "a process has one of it, which moves once at the start"
)]
enum Stages {
    Folded(Network),
    Apart { encoder: Network, srd: SuperResolution, compressor: GenericEncoder },
}

impl Vision {
    /// With the bundle's networks.
    pub fn new(networks: VisionNetworks) -> Self {
        let VisionNetworks { image, stages, .. } = networks;
        let stages = match stages {
            VisionStages::Folded(network) => Stages::Folded(network),
            VisionStages::Apart { encoder, srd, compressor } => Stages::Apart {
                encoder,
                srd: SuperResolution::new(srd),
                compressor: GenericEncoder::new(compressor),
            },
        };
        let shape = [1, 3, image.height, image.width];
        let input = [Tensor::floats(&shape, vec![0.0; 3 * image.height * image.width])];
        Self { image, preparation: Preparation::default(), input, stages }
    }

    /// A frame's language.
    ///
    /// # Errors
    /// [`NetworkError`] if a network fails.
    pub fn run(&mut self, frame: &Frame) -> Result<LanguageMap, NetworkError> {
        let mut clock = Stopwatch(Instant::now());
        let covered = self.preparation.run(frame, &self.image, self.input[0].floats_mut());
        let mut timing = LanguageTiming { prepare: clock.lap(), ..Default::default() };
        let grid = match &mut self.stages {
            Stages::Folded(network) => {
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
    let kept = |size: usize, share: f32| ((size as f32 * share).round() as usize).clamp(1, size);
    let (width, height) = (kept(grid.width, covered[0]), kept(grid.height, covered[1]));
    if (width, height) == (grid.width, grid.height) {
        return grid;
    }
    let rows = grid.codes.chunks_exact(grid.width * GENERIC).take(height);
    let codes = rows.flat_map(|row| &row[..width * GENERIC]).copied().collect();
    CodeGrid { height, width, codes }
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
