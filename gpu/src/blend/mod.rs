//! Blending a tile's list into pixels, and back: image = sum of alpha T feature (Kerbl et al. 2023,
//! section 6 and appendix C).
//!
//! One kernel for both heads; rows of the feature (1 for rgb and depth, `channels / 4` for
//! language) reach WGSL as a constant. A workgroup is a tile of 16x16 pixels, a thread owns eight
//! pixels. The backward pass leaves one record per hit in the hit's own slot: no atomics, the same
//! bits each time.

use crate::buffer::Buffer;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::kernel::{Kernel, Recorder};
use crate::layout::{LANES, PassArguments, PixelState, Row, TILE};
use crate::shader::{self, Access, Constant, GRID, Shader};
use crate::tiles::{Hits, Ranks};

pub mod oracle;

/// Bytes of workgroup memory that the backward batch may fill; WebGPU guarantees 16 KiB.
const BATCH_BYTES: u32 = 12 << 10;

/// Strips of four pixels per thread.
const STRIPS: u32 = 2;

/// The blend of one head.
pub struct Blend {
    forward: Kernel,
    weights: Kernel,
    backward: Kernel,
}

/// What the blend of one view reads.
#[derive(Clone, Copy)]
pub struct Lists<'a> {
    /// The camera.
    pub arguments: &'a PassArguments,
    /// Projected Gaussians.
    pub ranks: &'a Ranks,
    /// The lists of all tiles.
    pub hits: &'a Hits,
    /// First and end of each tile's list.
    pub ranges: &'a Buffer<[u32; 2]>,
}

impl Lists<'_> {
    fn tiles(&self) -> u32 {
        self.arguments.tiles[0] * self.arguments.tiles[1]
    }
}

/// Rows of a hit's record: two of geometry, then the feature's.
pub const fn record_rows(rows: usize) -> usize {
    2 + rows
}

/// This kernel's shaders for features of `rows` rows; with `depth`, the fourth channel is z.
pub fn shaders(rows: u32, depth: bool) -> [Shader; 3] {
    use Access::{Read, Write};
    let batch = (BATCH_BYTES / ((2 + rows) * LANES * size_of::<Row>() as u32)).max(1);
    let constants = vec![
        ("STRIPS", Constant::U32(STRIPS)),
        ("ROWS", Constant::U32(rows)),
        ("CHANNELS", Constant::U32(4 * rows)),
        ("DEPTH", Constant::Bool(depth)),
        ("BATCH", Constant::U32(batch)),
    ];
    let feature = include_str!("../shared/feature.wgsl");
    let shader = |label, text, parts: &[&'static str], bindings| Shader {
        label,
        entry: "main",
        parts: [GRID, shader::TILE].iter().chain(parts).copied().chain([text]).collect(),
        constants: constants.clone(),
        bindings,
    };
    [
        shader(
            if depth { "blend_colour" } else { "blend_language" },
            include_str!("forward.wgsl"),
            &[feature],
            vec![Read, Read, Read, Read, Write, Write],
        ),
        shader(
            if depth { "weights_colour" } else { "weights_language" },
            include_str!("weights.wgsl"),
            &[],
            vec![Read, Read, Read, Read, Write],
        ),
        shader(
            if depth { "blend_back_colour" } else { "blend_back_language" },
            include_str!("backward.wgsl"),
            &[feature],
            vec![Read, Read, Read, Read, Read, Read, Read, Write],
        ),
    ]
}

impl Blend {
    /// Compiles the kernels of a head.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu, rows: usize, depth: bool) -> Result<Self, GpuError> {
        const { assert!(TILE * TILE == LANES * STRIPS * 4, "threads cover a tile") };
        let [forward, weights, backward] = shaders(rows as u32, depth);
        Ok(Self {
            forward: Kernel::new(gpu, &forward)?,
            weights: Kernel::new(gpu, &weights)?,
            backward: Kernel::new(gpu, &backward)?,
        })
    }

    /// Fills `image` (height x width x rows) and `pixels` (height x width).
    pub fn forward(
        &self,
        recorder: &mut Recorder<'_>,
        lists: Lists<'_>,
        features: &Buffer<Row>,
        (image, pixels): (&Buffer<Row>, &Buffer<PixelState>),
    ) {
        let buffers: [&wgpu::Buffer; 6] = [
            lists.ranges,
            &lists.hits.gaussian_from_sorted,
            &lists.ranks.splats,
            features,
            image,
            pixels,
        ];
        recorder.dispatch(&self.forward, lists.arguments, &buffers, lists.tiles());
    }

    /// Largest weight of each Gaussian in a finished forward pass, as float bits; `weights` is zero
    /// before.
    pub fn weights(
        &self,
        recorder: &mut Recorder<'_>,
        lists: Lists<'_>,
        pixels: &Buffer<PixelState>,
        weights: &Buffer<u32>,
    ) {
        let buffers: [&wgpu::Buffer; 5] =
            [lists.ranges, &lists.hits.gaussian_from_sorted, &lists.ranks.splats, pixels, weights];
        recorder.dispatch(&self.weights, lists.arguments, &buffers, lists.tiles());
    }

    /// `features` has `rows` rows per Gaussian. Turns dL/dimage into one record per hit
    /// ([`record_rows`] rows, at the hit's slot).
    pub fn backward(
        &self,
        recorder: &mut Recorder<'_>,
        lists: Lists<'_>,
        features: &Buffer<Row>,
        (pixels, gradients): (&Buffer<PixelState>, &Buffer<Row>),
        records: &Buffer<Row>,
    ) {
        let buffers: [&wgpu::Buffer; 8] = [
            lists.ranges,
            &lists.hits.gaussian_from_sorted,
            &lists.hits.sort.values[0],
            &lists.ranks.splats,
            features,
            pixels,
            gradients,
            records,
        ];
        recorder.dispatch(&self.backward, lists.arguments, &buffers, lists.tiles());
    }
}
