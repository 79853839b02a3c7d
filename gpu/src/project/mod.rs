//! Projection of Gaussians into one camera (EWA; Kerbl et al. 2023, equation 5), and back (their
//! appendix A).
//!
//! Forward: mean, rotation, scale, opacity to [`Splat`](crate::layout::Splat), depth key and number
//! of hits. Backward: first the records of a Gaussian's hits are summed in order, then the sums are
//! taken through conic, covariance, Jacobian and rotation. The colour head moves the mean; the
//! language head does not (paper, disentangled optimisation).

use crate::buffer::Buffer;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::kernel::{Kernel, Recorder};
use crate::layout::{ArrayArguments, PassArguments, Row};
use crate::shader::{Access, Constant, GEOMETRY, GRID, SCALES, Shader};
use crate::tiles::Ranks;

pub mod oracle;

/// The projection of one head.
pub struct Project {
    forward: Kernel,
    collect: Kernel,
    backward: Kernel,
}

/// Gradients of one head, laid out as its parameters.
pub struct HeadGradients {
    /// Sums of the records: two rows per Gaussian; the last value of the first row is the sum of
    /// the blending weights, zero for a Gaussian that no pixel saw.
    pub sums: Buffer<Row>,
    /// Rotation; log scale and opacity logit.
    pub geometry: Buffer<Row>,
    /// Feature.
    pub features: Buffer<Row>,
}

/// This kernel's shaders for the colour head (`colour`) or for the language head.
pub fn shaders(colour: bool) -> [Shader; 3] {
    use Access::{Read, Write};
    let shader = |label, parts, bindings| Shader {
        label,
        entry: "main",
        parts,
        constants: vec![("COLOUR", Constant::Bool(colour))],
        bindings,
    };
    let extent = include_str!("../shared/extent.wgsl");
    [
        shader(
            if colour { "project_colour" } else { "project_language" },
            vec![GRID, SCALES, GEOMETRY, extent, include_str!("forward.wgsl")],
            vec![Read, Read, Write, Write, Write, Write],
        ),
        shader(
            if colour { "collect_colour" } else { "collect_language" },
            vec![GRID, include_str!("collect.wgsl")],
            vec![Read, Read, Read, Read, Write, Write],
        ),
        shader(
            if colour { "project_back_colour" } else { "project_back_language" },
            vec![GRID, SCALES, GEOMETRY, include_str!("backward.wgsl")],
            vec![Read, Read, Read, Write, Write],
        ),
    ]
}

impl HeadGradients {
    /// Room for `capacity` Gaussians with features of `rows` rows.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(gpu: &Gpu, capacity: usize, rows: usize) -> Result<Self, GpuError> {
        Ok(Self {
            sums: Buffer::new(gpu, "record sums", 2 * capacity)?,
            geometry: Buffer::new(gpu, "geometry gradients", 2 * capacity)?,
            features: Buffer::new(gpu, "feature gradients", rows * capacity)?,
        })
    }
}

impl Project {
    /// Compiles the kernels of a head.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu, colour: bool) -> Result<Self, GpuError> {
        let [forward, collect, backward] = shaders(colour);
        Ok(Self {
            forward: Kernel::new(gpu, &forward)?,
            collect: Kernel::new(gpu, &collect)?,
            backward: Kernel::new(gpu, &backward)?,
        })
    }

    /// Fills splats, depth keys, identity ranks and numbers of hits.
    pub fn forward(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &PassArguments,
        (means, geometry): (&Buffer<Row>, &Buffer<Row>),
        ranks: &Ranks,
    ) {
        let sort = &ranks.sort;
        recorder.dispatch_threads(
            &self.forward,
            arguments,
            &[means, geometry, &ranks.splats, &sort.keys[0], &sort.values[0], &ranks.hits],
            arguments.count as usize,
        );
    }

    /// Sums the records of the backward blend per Gaussian, then takes them back to the parameters.
    /// `mean_gradients` is written by the colour head and left alone by the language head.
    pub fn backward(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &PassArguments,
        (means, geometry): (&Buffer<Row>, &Buffer<Row>),
        (ranks, records): (&Ranks, &Buffer<Row>),
        (mean_gradients, gradients): (&Buffer<Row>, &HeadGradients),
    ) {
        let count = arguments.count as usize;
        let rows = (gradients.features.len() / (gradients.sums.len() / 2)) as u32;
        let collect = ArrayArguments { count: arguments.count, detail: rows };
        let gaussian_from_rank = &ranks.sort.values[0];
        recorder.dispatch_threads(
            &self.collect,
            &collect,
            &[
                gaussian_from_rank,
                &ranks.slot_from_rank,
                &ranks.hits,
                records,
                &gradients.sums,
                &gradients.features,
            ],
            count,
        );
        recorder.dispatch_threads(
            &self.backward,
            arguments,
            &[means, geometry, &gradients.sums, mean_gradients, &gradients.geometry],
            count,
        );
    }
}
