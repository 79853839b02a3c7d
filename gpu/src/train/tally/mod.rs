//! Keeps the statistics that map surgery decides by: after each training step, what the color pass
//! found out about the Gaussians that the step moved is added to theirs.

use crate::device::{Buffer, Gpu, GpuError};
use crate::pass::order::Ranks;
use crate::pass::project::{HeadGradients, SUM_ROWS};
use crate::shader::layout::{PassArguments, Row, Splat};
use crate::shader::{Access, CONIC, Constant, GRID, Kernel, Recorder, Shader};

/// The kernel.
pub struct Tally {
    kernel: Kernel,
}

/// What a step found out.
#[derive(Clone, Copy)]
pub struct Found<'a> {
    /// The color pass.
    pub arguments: &'a PassArguments,
    /// The visible Gaussians.
    pub ranks: &'a Ranks,
    /// Bias corrections of the step, 0 for a Gaussian that it left alone.
    pub corrections: &'a Buffer<[f32; 2]>,
    /// Gradients of the color head.
    pub gradients: &'a HeadGradients,
    /// Projected Gaussians.
    pub splats: &'a Buffer<Splat>,
}

/// This kernel's shader.
pub fn shaders() -> [Shader; 1] {
    use Access::{Read, Write};
    [Shader {
        label: "tally",
        entry: "main",
        parts: vec![GRID, CONIC, include_str!("tally.wgsl")],
        constants: vec![("SUMS", Constant::U32(SUM_ROWS[0] as u32))],
        bindings: vec![Read, Read, Read, Read, Write],
    }]
}

impl Tally {
    /// Compiles the kernel.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [shader] = shaders();
        Ok(Self { kernel: Kernel::new(gpu, &shader)? })
    }

    /// Adds to `statistics`, two rows per Gaussian.
    pub fn add(&self, recorder: &mut Recorder<'_>, found: Found<'_>, statistics: &Buffer<Row>) {
        let Found { arguments, ranks, corrections, gradients, splats } = found;
        let buffers: [&wgpu::Buffer; 5] =
            [&ranks.gaussian_from_visible, corrections, &gradients.sums, splats, statistics];
        ranks.run(recorder, &self.kernel, arguments, &buffers);
    }
}
