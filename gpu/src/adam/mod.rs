//! Adam, fused over parameter and both moments, only for Gaussians that a pixel saw.
//!
//! ```text
//! m = b1 m + (1 - b1) g,  v = b2 v + (1 - b2) g^2
//! x -= rate m / (1 - b1^t) / (sqrt(v / (1 - b2^t)) + eps)
//! ```
//!
//! t is counted per Gaussian and head. A Gaussian that was not seen keeps value and moments. A
//! gradient that is not finite changes nothing. When a list of the step overflowed
//! nothing changes at all, so that the step can be repeated.

use crate::buffer::Buffer;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::gaussians::Parameters;
use crate::kernel::{Kernel, Recorder};
use crate::layout::{AdamArguments, ArrayArguments, HitCount, Row};
use crate::shader::{Access, GRID, Shader};

pub mod oracle;

/// Learning rates of one head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadRates {
    /// Of the quaternion.
    pub rotation: f32,
    /// Of the log scale.
    pub log_scale: f32,
    /// Of the opacity's logit.
    pub opacity: f32,
    /// Of the feature: rgb, or code.
    pub feature: f32,
}

/// Learning rates of all parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LearningRates {
    /// Of the mean, metres.
    pub mean: f32,
    /// Of the colour head.
    pub colour: HeadRates,
    /// Of the language head.
    pub language: HeadRates,
}

impl Default for LearningRates {
    /// Those of the paper's released configuration; rgb takes the rate of the DC coefficient times
    /// its factor 0.28209.
    fn default() -> Self {
        Self {
            mean: 1.6e-4 * 6.0,
            colour: HeadRates { rotation: 1e-3, log_scale: 6e-3, opacity: 0.05, feature: 7e-4 },
            language: HeadRates {
                rotation: 1e-3,
                log_scale: 1.2e-3,
                opacity: 0.05,
                feature: 2.5e-3,
            },
        }
    }
}

impl HeadRates {
    /// Rates of the two rows of a head's geometry.
    fn geometry(&self) -> [Row; 2] {
        let s = self.log_scale;
        [[self.rotation; 4], [s, s, s, self.opacity]]
    }
}

/// The kernels.
pub struct Adam {
    advance: Kernel,
    update: Kernel,
}

/// What one head's update reads: seen weights, steps, and the lists that must not have overflowed.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    /// Record sums (see [`crate::project::HeadGradients`]).
    pub sums: &'a Buffer<Row>,
    /// Steps of each Gaussian; advanced.
    pub steps: &'a Buffer<u32>,
    /// Filled with the bias corrections, 0 for a Gaussian that is left alone.
    pub corrections: &'a Buffer<[f32; 2]>,
    /// Hit counts of the passes of the step.
    pub counts: [&'a Buffer<HitCount>; 2],
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
        shader("adam_advance", include_str!("advance.wgsl"), vec![Read, Read, Read, Write, Write]),
        shader("adam_update", include_str!("update.wgsl"), vec![Read, Read, Write, Write, Write]),
    ]
}

impl Adam {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [advance, update] = shaders();
        Ok(Self { advance: Kernel::new(gpu, &advance)?, update: Kernel::new(gpu, &update)? })
    }

    /// Counts the step for the Gaussians that were seen and prepares their bias corrections.
    pub fn advance(&self, recorder: &mut Recorder<'_>, seen: Seen<'_>, count: usize) {
        let arguments = ArrayArguments { count: count as u32, detail: 0 };
        let [first, second] = seen.counts;
        let buffers: [&wgpu::Buffer; 5] = [seen.sums, first, second, seen.steps, seen.corrections];
        recorder.dispatch_threads(&self.advance, &arguments, &buffers, count);
    }

    /// Moves the parameters of `count` Gaussians; `rates` are those of even and odd rows.
    pub fn update(
        &self,
        recorder: &mut Recorder<'_>,
        (parameters, count): (&Parameters, usize),
        [even, odd]: [Row; 2],
        gradients: &Buffer<Row>,
        corrections: &Buffer<[f32; 2]>,
    ) {
        let (rows, all) = (parameters.rows as u32, parameters.rows * count);
        let arguments = AdamArguments { even, odd, count: all as u32, rows, unused: [0; 2] };
        let Parameters { values, first, second, .. } = parameters;
        let buffers: [&wgpu::Buffer; 5] = [gradients, corrections, values, first, second];
        recorder.dispatch_threads(&self.update, &arguments, &buffers, all);
    }

    /// Moves one head.
    pub(crate) fn update_head(
        &self,
        recorder: &mut Recorder<'_>,
        (head, count): (&crate::gaussians::Head, usize),
        rates: &HeadRates,
        gradients: &crate::project::HeadGradients,
        corrections: &Buffer<[f32; 2]>,
    ) {
        let geometry = (&head.geometry, count);
        self.update(recorder, geometry, rates.geometry(), &gradients.geometry, corrections);
        let features = (&head.features, count);
        let flat = [[rates.feature; 4]; 2];
        self.update(recorder, features, flat, &gradients.features, corrections);
    }
}
