//! Projection of Gaussians into one camera (EWA; Kerbl et al. 2023, equation 5), and back (their
//! appendix A).
//!
//! Forward: mean, rotation, scale, opacity to [`Splat`](crate::shader::layout::Splat), number of
//! hits and the tiles they are. Backward, for the ranks of a view: first the records of a rank's
//! hits are summed in order, then the sums are taken through conic, covariance, Jacobian and
//! rotation. The color head moves the mean and the camera; the language head does not (paper §4.3).

use crate::device::{Buffer, Gpu, GpuError};
use crate::map::Head;
use crate::pass::order::Ranks;
use crate::pass::projected::Projected;
use crate::pass::tiles::Hits;
use crate::shader::layout::{PassArguments, Row};
use crate::shader::{
    Access, CONIC, COVERED, Constant, EXTENT, GEOMETRY, GRID, Kernel, Recorder, SCALES, Shader,
    Tiling,
};

/// Rows of the sums of the color head, and of the language head.
const SUM_ROWS: [usize; 2] = [3, 2];
/// Rows of [`GradientBuffers::moves`].
pub const MOVE_ROWS: usize = 3;

/// The projection of one head.
pub struct Project {
    forward: Kernel,
    collect: Kernel,
    backward: Kernel,
}

/// Input of the backward pass.
#[derive(Clone, Copy)]
pub struct BackwardInputs<'a> {
    /// Means of the map, one row each.
    pub means: &'a Buffer<Row>,
    /// Geometry of the head, two rows per Gaussian.
    pub geometry: &'a Buffer<Row>,
    /// The visible Gaussians.
    pub ranks: &'a Ranks,
    /// The lists of the band.
    pub hits: &'a Hits,
    /// One record per hit of the band, from the backward blend.
    pub records: &'a Buffer<Row>,
}

/// Gradients of one head, in the order of ranks.
pub struct GradientBuffers {
    /// Sums of the records: the last value of the first row is the sum of the blending weights,
    /// zero for a Gaussian that no pixel saw.
    pub sums: Buffer<Row>,
    /// Rotation; log scale and opacity logit.
    pub geometry: Buffer<Row>,
    /// Feature.
    pub features: Buffer<Row>,
    /// Of the color head: the mean; this Gaussian's share of the gradients with respect to the
    /// translation and the rotation of the camera.
    pub moves: Buffer<Row>,
    /// Rows per rank of `sums`.
    pub sum_rows: usize,
}

/// This kernel's shaders for features of `rows` rows of the color head (`color`) or of the
/// language head.
pub fn shaders(tiling: Tiling, rows: usize, color: bool) -> [Shader; 3] {
    use Access::{Read, Write};
    let shader = |label, parts, bindings| Shader {
        label,
        entry: "main",
        parts,
        constants: [
            ("COLOR", Constant::Bool(color)),
            ("ROWS", Constant::U32(rows as u32)),
            ("RECORD", Constant::U32(2 + rows as u32)),
            ("SUMS", Constant::U32(sum_rows(color) as u32)),
        ]
        .into_iter()
        .chain(tiling.constants(1, 1))
        .collect(),
        bindings,
    };
    [
        shader(
            if color { "project_color" } else { "project_language" },
            vec![GRID, SCALES, GEOMETRY, CONIC, EXTENT, COVERED, include_str!("forward.wgsl")],
            vec![Read, Read, Read, Read, Write, Write],
        ),
        shader(
            if color { "collect_color" } else { "collect_language" },
            vec![GRID, include_str!("collect.wgsl")],
            vec![Read, Read, Read, Read, Write, Write],
        ),
        shader(
            if color { "project_back_color" } else { "project_back_language" },
            vec![GRID, SCALES, GEOMETRY, include_str!("backward.wgsl")],
            vec![Read, Read, Read, Read, Write, Write],
        ),
    ]
}

const fn sum_rows(color: bool) -> usize {
    SUM_ROWS[if color { 0 } else { 1 }]
}

impl GradientBuffers {
    /// Room for `capacity` Gaussians with features of `rows` rows.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(gpu: &Gpu, capacity: usize, rows: usize, color: bool) -> Result<Self, GpuError> {
        let sum_rows = sum_rows(color);
        let moves = if color { MOVE_ROWS * capacity } else { 1 };
        Ok(Self {
            sums: Buffer::new(gpu, "record sums", sum_rows * capacity)?,
            geometry: Buffer::new(gpu, "geometry gradients", 2 * capacity)?,
            features: Buffer::new(gpu, "feature gradients", rows * capacity)?,
            moves: Buffer::new(gpu, "mean and pose gradients", moves)?,
            sum_rows,
        })
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        [&self.sums, &self.geometry, &self.features, &self.moves].iter().map(|b| b.size()).sum()
    }
}

impl Project {
    /// Compiles the kernels of a head.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu, rows: usize, color: bool) -> Result<Self, GpuError> {
        let [forward, collect, backward] = shaders(Tiling::of(gpu.tier()), rows, color);
        Ok(Self {
            forward: Kernel::new(gpu, &forward)?,
            collect: Kernel::new(gpu, &collect)?,
            backward: Kernel::new(gpu, &backward)?,
        })
    }

    /// Fills splats and coverage of all Gaussians. Takes the first band of a view, then once each
    /// further one.
    pub fn forward(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &PassArguments,
        means: &Buffer<Row>,
        head: &Head,
        projected: &Projected,
    ) {
        let (geometry, features) = (&head.geometry.values, &head.features.values);
        let Projected { splats, coverage, left_out } = projected;
        let buffers: [&wgpu::Buffer; 6] = [means, geometry, features, left_out, splats, coverage];
        recorder.dispatch_threads(&self.forward, arguments, &buffers, arguments.count as usize);
    }

    /// Sums the records of a band per rank, on top of the sums of the bands above.
    pub fn collect(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &PassArguments,
        inputs: BackwardInputs<'_>,
        gradients: &GradientBuffers,
    ) {
        let BackwardInputs { ranks, hits, records, .. } = inputs;
        let GradientBuffers { sums, features, .. } = gradients;
        let buffers: [&wgpu::Buffer; 6] = [
            &ranks.visible,
            &ranks.rank_from_visible,
            &hits.slot_from_rank,
            records,
            sums,
            features,
        ];
        ranks.run(recorder, &self.collect, arguments, &buffers);
    }

    /// Takes the sums of all bands back to the parameters.
    pub fn backward(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &PassArguments,
        inputs: BackwardInputs<'_>,
        gradients: &GradientBuffers,
    ) {
        let BackwardInputs { means, geometry, ranks, .. } = inputs;
        let GradientBuffers { sums, moves, .. } = gradients;
        let gaussian_from_rank = &ranks.gaussian_from_visible;
        let buffers: [&wgpu::Buffer; 6] =
            [gaussian_from_rank, means, geometry, sums, moves, &gradients.geometry];
        ranks.run(recorder, &self.backward, arguments, &buffers);
    }
}
