//! Adam (Kingma and Ba 2015), fused over parameter and both moments, for the Gaussians that
//! contribute to a pixel of the view.
//!
//! ```text
//! m = b1 m + (1 - b1) g,  v = b2 v + (1 - b2) g^2
//! x -= rate m / (1 - b1^t) / (sqrt(v / (1 - b2^t)) + eps)
//! ```
//!
//! t is counted per Gaussian and head. A Gaussian outside the view keeps its value and moments and
//! costs no work. A gradient that is not finite changes nothing. If a list of the step overflowed,
//! nothing changes at all, so that the step can be repeated. Standard deviations have an upper limit,
//! because steps do not shrink with the gradient: what hides a Gaussian does not stop its growth.

use crate::device::{Buffer, Gpu, GpuError};
use crate::map::{HeadKind, Parameters};
use crate::pass::order::Ranks;
use crate::shader::layout::{AdamArguments, AdvanceArguments, HitCount, Row};
use crate::shader::{Access, GRID, Kernel, Recorder, Shader};

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
    /// Of the color head.
    pub color: HeadRates,
    /// Of the language head.
    pub language: HeadRates,
    /// How much larger those of means and of the color head are for new Gaussians.
    pub youth: Youth,
    /// Largest standard deviation that a step leaves, metres. Infinite: no limit.
    pub max_scale_metres: f32,
}

/// Larger steps for new Gaussians: the rates of a Gaussian's t-th step are multiplied by
/// `1 + (first_rate - 1) exp(-(t - 1) / steps)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Youth {
    /// Factor of the first step.
    pub first_rate: f32,
    /// Steps after which the factor's distance from 1 is 1/e of that; more than 0.
    pub steps: f32,
}

impl Youth {
    /// The same rates for all Gaussians.
    pub const NONE: Self = Self { first_rate: 1.0, steps: 1.0 };
}

/// Learning rates of the rows of a parameter, and their limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowRates {
    /// Of an even row.
    pub even: Row,
    /// Of an odd row.
    pub odd: Row,
    /// The first three values of an odd row are at most this after a step.
    pub odd_at_most: f32,
}

impl RowRates {
    /// The same rate for all, without a limit.
    pub fn all(rate: f32) -> Self {
        Self { even: [rate; 4], odd: [rate; 4], odd_at_most: f32::MAX }
    }
}

impl Default for LearningRates {
    /// Those of the paper's released configuration; rgb takes the rate of the DC coefficient times
    /// its factor 0.28209.
    fn default() -> Self {
        Self {
            mean: 1.6e-4 * 6.0,
            color: HeadRates { rotation: 1e-3, log_scale: 6e-3, opacity: 0.05, feature: 7e-4 },
            language: HeadRates {
                rotation: 1e-3,
                log_scale: 1.2e-3,
                opacity: 0.05,
                feature: 2.5e-3,
            },
            youth: Youth::NONE,
            max_scale_metres: f32::INFINITY,
        }
    }
}

impl LearningRates {
    pub(crate) fn head(&self, head: HeadKind) -> &HeadRates {
        match head {
            HeadKind::Color => &self.color,
            HeadKind::Language => &self.language,
        }
    }

    /// Rates of the two rows of a head's geometry, multiplied by `share`.
    pub(crate) fn geometry(&self, head: HeadKind, share: [Row; 2]) -> RowRates {
        let HeadRates { rotation, log_scale, opacity, .. } = *self.head(head);
        let rows = [[rotation; 4], [log_scale, log_scale, log_scale, opacity]];
        let [even, odd] =
            std::array::from_fn(|row| std::array::from_fn(|i| rows[row][i] * share[row][i]));
        RowRates { even, odd, odd_at_most: self.max_scale_metres.ln().min(f32::MAX) }
    }
}

/// The kernels.
pub struct Adam {
    advance: Kernel,
    update: Kernel,
}

/// Which Gaussians a step may move: they were seen, and no list overflowed.
#[derive(Clone, Copy)]
pub struct SeenGaussians<'a> {
    /// The visible Gaussians.
    pub ranks: &'a Ranks,
    /// Record sums (see [`crate::pass::project::GradientBuffers`]) and their rows per rank.
    pub sums: (&'a Buffer<Row>, usize),
    /// Hit counts of the passes of the step.
    pub counts: [&'a Buffer<HitCount>; 2],
    /// Size of the map.
    pub count: usize,
}

/// Gradients of the parameters of one kind: the first rows of each rank.
#[derive(Clone, Copy)]
pub struct ParameterGradients<'a> {
    /// The visible Gaussians.
    pub ranks: &'a Ranks,
    /// Gradients and their rows per rank.
    pub rows: (&'a Buffer<Row>, usize),
    /// Bias corrections; 0 for a Gaussian that is left alone.
    pub corrections: &'a Buffer<[f32; 2]>,
    /// Size of the map.
    pub count: usize,
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
        shader(
            "adam_advance",
            include_str!("advance.wgsl"),
            vec![Read, Read, Read, Read, Write, Write],
        ),
        shader(
            "adam_update",
            include_str!("update.wgsl"),
            vec![Read, Read, Read, Write, Write, Write],
        ),
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

    /// Counts the step in `steps` for the Gaussians that may be moved, and prepares their bias
    /// corrections. The first moment's has the larger steps of `youth` in it.
    pub fn advance(
        &self,
        recorder: &mut Recorder<'_>,
        seen: SeenGaussians<'_>,
        youth: Youth,
        steps: &Buffer<u32>,
        corrections: &Buffer<[f32; 2]>,
    ) {
        let (sums, rows) = seen.sums;
        let arguments = AdvanceArguments {
            count: seen.count as u32,
            rows: rows as u32,
            first_rate: youth.first_rate,
            young_steps: youth.steps,
        };
        let [one, other] = seen.counts;
        let gaussians = &seen.ranks.gaussian_from_visible;
        let buffers: [&wgpu::Buffer; 6] = [gaussians, sums, one, other, steps, corrections];
        seen.ranks.run(recorder, &self.advance, &arguments, &buffers);
    }

    /// Moves the parameters.
    pub fn update(
        &self,
        recorder: &mut Recorder<'_>,
        parameters: &Parameters,
        rates: RowRates,
        gradients: ParameterGradients<'_>,
    ) {
        let (rows, stride) = gradients.rows;
        let RowRates { even, odd, odd_at_most } = rates;
        let arguments = AdamArguments {
            even,
            odd,
            count: gradients.count as u32,
            rows: parameters.rows as u32,
            stride: stride as u32,
            odd_at_most,
        };
        let Parameters { values, first, second, .. } = parameters;
        let gaussians = &gradients.ranks.gaussian_from_visible;
        let buffers: [&wgpu::Buffer; 6] =
            [gaussians, rows, gradients.corrections, values, first, second];
        gradients.ranks.run(recorder, &self.update, &arguments, &buffers);
    }
}
