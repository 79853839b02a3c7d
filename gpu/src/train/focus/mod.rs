//! Which tiles of a view a step looks at.
//!
//! A view remembers the error of each of its tiles. A step draws tiles with a probability that grows
//! with the error, so that work goes where something is left to learn. Tiles that are not drawn are
//! left out of the lists, of blending and of the backward pass: their Gaussians do not move.

use crate::device::{Buffer, Gpu, GpuError};
use crate::shader::layout::{FocusArguments, HitCount, Row};
use crate::shader::{Access, GRID, Kernel, Recorder, Shader, Tiling};
use crate::train::target::ColorTarget;

/// How likely tiles are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Focus {
    /// Probability of a tile with the mean error of its view. It grows with the error, up to 1.
    pub mean_share: f32,
    /// Probability of a tile without error.
    pub least_share: f32,
    /// Number of the step: with another number other tiles are drawn.
    pub turn: u32,
}

/// The kernels.
pub(super) struct FocusKernels {
    total: Kernel,
    choose: Kernel,
    measure: Kernel,
    sum: Buffer<f32>,
}

/// This kernel's shaders.
pub fn shaders(tiling: Tiling) -> [Shader; 3] {
    use Access::{Read, Write};
    let shader = |label, text, bindings| Shader {
        label,
        entry: "main",
        parts: vec![GRID, text],
        constants: tiling.constants(1, 1),
        bindings,
    };
    [
        shader("focus_total", include_str!("total.wgsl"), vec![Read, Write]),
        shader("focus_choose", include_str!("choose.wgsl"), vec![Read, Read, Write]),
        shader("focus_measure", include_str!("measure.wgsl"), vec![Read, Read, Write, Write]),
    ]
}

impl FocusKernels {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [total, choose, measure] = shaders(Tiling::of(gpu.tier()));
        Ok(Self {
            total: Kernel::new(gpu, &total)?,
            choose: Kernel::new(gpu, &choose)?,
            measure: Kernel::new(gpu, &measure)?,
            sum: Buffer::new(gpu, "sum of errors", 1)?,
        })
    }

    /// Marks the tiles that the next pass leaves out, one value for each.
    pub fn choose(
        &self,
        recorder: &mut Recorder<'_>,
        target: &ColorTarget,
        focus: Focus,
        left_out: &Buffer<u32>,
    ) {
        let errors = target.errors();
        let Focus { mean_share, least_share, turn } = focus;
        let arguments =
            FocusArguments { tiles: errors.len() as u32, mean_share, least_share, turn };
        recorder.dispatch(&self.total, &arguments, &[errors, &self.sum], 1);
        let buffers: [&wgpu::Buffer; 3] = [errors, &self.sum, left_out];
        recorder.dispatch_threads(&self.choose, &arguments, &buffers, errors.len());
    }

    /// Keeps the error of each tile that was drawn, from the terms of its rows of pixels, unless a list
    /// overflowed. Afterwards no tile is left out any more.
    pub fn measure(
        &self,
        recorder: &mut Recorder<'_>,
        target: &ColorTarget,
        terms: &Buffer<Row>,
        count: &Buffer<HitCount>,
        left_out: &Buffer<u32>,
    ) {
        let errors = target.errors();
        let arguments = FocusArguments { tiles: errors.len() as u32, ..FocusArguments::default() };
        let buffers: [&wgpu::Buffer; 4] = [terms, count, left_out, errors];
        recorder.dispatch_threads(&self.measure, &arguments, &buffers, errors.len());
    }
}
