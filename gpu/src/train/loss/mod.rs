//! Losses with their gradients, fused: one thread per pixel or per Gaussian.
//!
//! - color: `w_c mean|exp(a) rgb + b - target|` where color is valid, with the exposure (a, b) of
//!   the view, plus `w_d mean|D - D_gt|` where depth was measured. D is the blended depth, not
//!   divided by opacity, as in the paper. So where opacity is too low, the gradient raises it.
//! - language: `w_l mean|codes - target|` over all pixels and channels.
//! - scales: `w_iso mean|S_c - mean_axis(S_c)| + w_tie mean|S_f - sg(S_c)|` with sg for "no
//!   gradient". The factors are for the mean over all Gaussians and axes of the map; the sum has
//!   only the visible ones, since only they move.
//!
//! Every mean is over its own valid values. The gradient of |x| at 0 is 0.

use crate::device::{Buffer, Gpu, GpuError};
use crate::pass::order::Ranks;
use crate::shader::layout::{LossArguments, Row};
use crate::shader::{Access, GRID, Kernel, Recorder, SCALES, Shader, Tiling};
use crate::train::target::{ColorTarget, LanguageTarget};

/// Factors of the terms of the loss; a term with factor 0 is off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossWeights {
    /// Of the color's mean absolute error; colors are in [0, 1].
    pub color: f32,
    /// Of the depth's mean absolute error, metres.
    pub depth: f32,
    /// Of the codes' mean absolute error.
    pub language: f32,
    /// Of the mean distance of a color scale from the Gaussian's mean scale, metres.
    pub isotropic: f32,
    /// Of the mean distance of a language scale from the color scale, metres.
    pub tie: f32,
}

impl Default for LossWeights {
    /// Those of the paper's released configuration.
    fn default() -> Self {
        Self { color: 0.95, depth: 0.05, language: 1.0, isotropic: 10.0, tie: 10.0 }
    }
}

/// Terms of the loss of one step, each with its factor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    /// Color term.
    pub color: f32,
    /// Depth term.
    pub depth: f32,
    /// Language term.
    pub language: f32,
    /// Isotropy term.
    pub isotropic: f32,
    /// Term that ties language scales to color scales.
    pub tie: f32,
}

impl Losses {
    /// Sum of all terms.
    pub fn total(&self) -> f32 {
        self.color + self.depth + self.language + self.isotropic + self.tie
    }
}

/// Buffers of a loss on an image.
#[derive(Clone, Copy)]
pub struct LossBuffers<'a> {
    /// In: the rendered rows, height x width x rows.
    pub image: &'a Buffer<Row>,
    /// Out: dL/dimage, same shape.
    pub gradients: &'a Buffer<Row>,
    /// Out: terms of each pixel, height x width.
    pub terms: &'a Buffer<Row>,
}

/// A loss on the scales of the visible Gaussians.
#[derive(Clone, Copy)]
pub struct ScaleLoss<'a> {
    /// Factor of the mean over all Gaussians and axes.
    pub weight: f32,
    /// Number of Gaussians in the map.
    pub count: usize,
    /// The visible Gaussians.
    pub ranks: &'a Ranks,
    /// Geometry of the color head, two rows per Gaussian.
    pub color: &'a Buffer<Row>,
    /// Out: dL/dgeometry, two rows per rank; the gradient is added.
    pub gradients: &'a Buffer<Row>,
    /// Out: (term, 0, 0, 0) of each rank.
    pub terms: &'a Buffer<Row>,
}

/// The kernels.
pub struct Loss {
    tiling: Tiling,
    color: Kernel,
    language: Kernel,
    isotropic: Kernel,
    tie: Kernel,
}

/// This kernel's shaders.
pub fn shaders(tiling: Tiling) -> [Shader; 4] {
    use Access::{Read, Write};
    let shader = |label, text, bindings| Shader {
        label,
        entry: "main",
        parts: vec![GRID, SCALES, text],
        constants: tiling.constants(1, 1),
        bindings,
    };
    [
        shader("loss_color", include_str!("color.wgsl"), vec![Read, Read, Read, Write, Write]),
        shader("loss_language", include_str!("language.wgsl"), vec![Read, Read, Write, Write]),
        shader(
            "loss_isotropic",
            include_str!("isotropic.wgsl"),
            vec![Read, Read, Read, Write, Write],
        ),
        shader("loss_tie", include_str!("tie.wgsl"), vec![Read, Read, Read, Read, Write, Write]),
    ]
}

/// `weight / values`, and 0 when there is no value to average.
fn share(weight: f32, values: usize) -> f32 {
    if values == 0 { 0.0 } else { weight / values as f32 }
}

impl Loss {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let tiling = Tiling::of(gpu.tier());
        let [color, language, isotropic, tie] = shaders(tiling);
        Ok(Self {
            tiling,
            color: Kernel::new(gpu, &color)?,
            language: Kernel::new(gpu, &language)?,
            isotropic: Kernel::new(gpu, &isotropic)?,
            tie: Kernel::new(gpu, &tie)?,
        })
    }

    /// Rows of the terms of color: one for each row of pixels of each tile.
    pub fn color_terms(&self, [width, height]: [u32; 2]) -> usize {
        let [columns, rows] = self.tiling.tiles([width, height]);
        (columns * rows * self.tiling.size()[1]) as usize
    }

    /// dL/dimage into `gradients`, the terms of each row of pixels of each tile into `terms` (color,
    /// depth, dL/da, dL/db) for the exposure (a, b). Tiles that are left out count as 0, and have no
    /// gradients.
    pub fn color(
        &self,
        recorder: &mut Recorder<'_>,
        target: &ColorTarget,
        exposure: [f32; 2],
        weights: &LossWeights,
        left_out: &Buffer<u32>,
        buffers: LossBuffers<'_>,
    ) {
        let LossBuffers { image, gradients, terms } = buffers;
        let target = target.inner();
        let texels = target.texels.buffer().expect("the view was put on the device for the step");
        let size = [target.width, target.height];
        let arguments = LossArguments {
            count: texels.len() as u32,
            rows: 1,
            first: share(weights.color, 3 * target.color_pixels),
            second: share(weights.depth, target.depth_pixels),
            exposure,
            size,
            tiles: self.tiling.tiles(size),
        };
        let buffers: [&wgpu::Buffer; 5] = [image, &texels, left_out, gradients, terms];
        recorder.dispatch_threads(&self.color, &arguments, &buffers, self.color_terms(size));
    }

    /// dL/dimage into `gradients`, the term of each pixel into `terms` (language, 0, 0, 0).
    pub fn language(
        &self,
        recorder: &mut Recorder<'_>,
        target: &LanguageTarget,
        weights: &LossWeights,
        buffers: LossBuffers<'_>,
    ) {
        let LossBuffers { image, gradients, terms } = buffers;
        let target = target.inner();
        let pixels = target.width as usize * target.height as usize;
        let rows = target.rows.as_ref().expect("a step without codes is refused");
        let arguments = LossArguments {
            count: pixels as u32,
            rows: rows.len().checked_div(pixels).unwrap_or(0) as u32,
            first: share(weights.language, pixels * target.channels),
            ..LossArguments::default()
        };
        let buffers: [&wgpu::Buffer; 4] = [image, rows, gradients, terms];
        recorder.dispatch_threads(&self.language, &arguments, &buffers, pixels);
    }

    /// Adds the gradient of the isotropy term to that of the color geometry.
    pub fn isotropic(&self, recorder: &mut Recorder<'_>, loss: ScaleLoss<'_>) {
        let ScaleLoss { ranks, color, gradients, terms, .. } = loss;
        let buffers: [&wgpu::Buffer; 5] =
            [&ranks.visible, &ranks.gaussian_from_visible, color, gradients, terms];
        ranks.run(recorder, &self.isotropic, &loss.arguments(), &buffers);
    }

    /// Adds the gradient of the tie term to that of the language geometry. `language` is the
    /// geometry of the language head, two rows per Gaussian.
    pub fn tie(&self, recorder: &mut Recorder<'_>, language: &Buffer<Row>, loss: ScaleLoss<'_>) {
        let ScaleLoss { ranks, color, gradients, terms, .. } = loss;
        let buffers: [&wgpu::Buffer; 6] =
            [&ranks.visible, &ranks.gaussian_from_visible, color, language, gradients, terms];
        ranks.run(recorder, &self.tie, &loss.arguments(), &buffers);
    }
}

impl ScaleLoss<'_> {
    fn arguments(&self) -> LossArguments {
        LossArguments {
            count: self.count as u32,
            rows: 2,
            first: share(self.weight, 3 * self.count),
            ..LossArguments::default()
        }
    }
}
