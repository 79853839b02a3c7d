//! Parameters that both heads share, for the paper's ablation (section 4.3, table of disentangled
//! modes). A tied parameter has one value, and the gradients of both heads are added.

use crate::device::{Buffer, Gpu, GpuError};
use crate::pass::order::Ranks;
use crate::pass::project::GradientBuffers;
use crate::shader::layout::{Row, TieArguments};
use crate::shader::{Access, GRID, Kernel, Recorder, Shader};

/// Which parameters the two heads share; none in the paper's full method. The heads must be equal
/// in them before the first step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ties {
    /// Quaternions.
    pub rotation: bool,
    /// Log scales.
    pub scale: bool,
    /// Opacity logits.
    pub opacity: bool,
}

/// The kernels.
pub struct TieKernels {
    merge: Kernel,
    copy: Kernel,
}

/// This kernel's shaders.
pub fn shaders() -> [Shader; 2] {
    use Access::{Read, Write};
    let shader = |label, text, bindings| Shader {
        label,
        entry: "main",
        parts: vec![GRID, text],
        constants: Vec::new(),
        bindings,
    };
    [
        shader("ties_merge", include_str!("merge.wgsl"), vec![Read, Read, Write, Write]),
        shader("ties_copy", include_str!("copy.wgsl"), vec![Read, Read, Read, Write]),
    ]
}

impl Ties {
    /// True if the heads share nothing but the mean.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// 1 for the tied components of the two rows of a head's geometry, 0 for the others.
    pub fn rows(&self) -> [Row; 2] {
        let one = |tied| f32::from(u8::from(tied));
        let (r, s, o) = (one(self.rotation), one(self.scale), one(self.opacity));
        [[r; 4], [s, s, s, o]]
    }

    /// The uniform of both kernels for a map of `count` Gaussians.
    pub fn arguments(&self, count: usize) -> TieArguments {
        let [even, odd] = self.rows();
        TieArguments { even, odd, count: count as u32, ..TieArguments::default() }
    }
}

impl TieKernels {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [merge, copy] = shaders();
        Ok(Self { merge: Kernel::new(gpu, &merge)?, copy: Kernel::new(gpu, &copy)? })
    }

    /// Adds the language head's gradients of tied parameters to the color head's.
    pub fn merge(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &TieArguments,
        color: &GradientBuffers,
        language: &GradientBuffers,
        ranks: &Ranks,
    ) {
        let buffers: [&wgpu::Buffer; 4] =
            [&language.sums, &language.geometry, &color.sums, &color.geometry];
        ranks.run(recorder, &self.merge, arguments, &buffers);
    }

    /// Copies tied parameters from the color head to the language head, for the Gaussians that the
    /// step moved.
    pub fn copy(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &TieArguments,
        ranks: &Ranks,
        corrections: &Buffer<[f32; 2]>,
        color: &Buffer<Row>,
        language: &Buffer<Row>,
    ) {
        let buffers: [&wgpu::Buffer; 4] =
            [&ranks.gaussian_from_visible, corrections, color, language];
        ranks.run(recorder, &self.copy, arguments, &buffers);
    }
}
