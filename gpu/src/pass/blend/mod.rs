//! Blending a tile's list into pixels, and back: image = sum of alpha T feature (Kerbl et al. 2023,
//! section 6 and appendix C).
//!
//! One kernel for both heads; rows of the feature (1 for rgb and depth, `channels / 4` for
//! language) reach WGSL as a constant. A workgroup is a tile, a lane owns pixels in one row of it
//! (see [`crate::shader::Tiling`]). Lanes load a batch of hits, one each, and exchange them. A
//! dispatch blends at most `CHUNK_ROWS` rows; longer features take several. The backward pass
//! leaves one record per hit in the hit's own slot: no atomics, the same bits each time.

use crate::device::{Buffer, Gpu, GpuError};
use crate::pass::projected::Projected;
use crate::pass::tiles::Hits;
use crate::shader;
use crate::shader::layout::{PassArguments, PixelState, Row};
use crate::shader::{Access, Constant, GRID, Kernel, Recorder, Shader, Tiling};

/// Rows of a feature that a lane can keep for all its pixels.
const CHUNK_ROWS: usize = 4;

/// The blend of one head.
pub struct Blend {
    forward: Kernel,
    contribute: Kernel,
    backward: Kernel,
    chunks: u32,
}

/// Input of the blend of one band of a view.
#[derive(Clone, Copy)]
pub struct TileLists<'a> {
    /// Camera and band.
    pub arguments: &'a PassArguments,
    /// Projected Gaussians.
    pub projected: &'a Projected,
    /// The lists of the band.
    pub hits: &'a Hits,
}

impl TileLists<'_> {
    /// Tiles of the band.
    fn tiles(&self) -> u32 {
        let [first, end] = self.arguments.band;
        self.arguments.tiles[0] * (end - first)
    }

    /// Ranges, slots, Gaussians and splats.
    fn buffers(&self) -> [&wgpu::Buffer; 4] {
        let hits = self.hits;
        [&hits.ranges, hits.slot_from_sorted(), &hits.gaussian_from_sorted, &self.projected.splats]
    }
}

/// Rows of a hit's record: two of geometry, then the feature's.
pub const fn record_rows(rows: usize) -> usize {
    2 + rows
}

/// Dispatches for features of `rows` rows.
const fn chunks(rows: usize) -> usize {
    rows.div_ceil(CHUNK_ROWS)
}

/// This kernel's shaders for features of `rows` rows; with `depth`, the fourth channel is z.
pub fn shaders(tiling: Tiling, rows: usize, depth: bool) -> [Shader; 3] {
    use Access::{Read, Write};
    let chunk = rows.div_ceil(chunks(rows)) as u32;
    let shader = |label, text, (chunk, record_rows): (u32, u32), bindings| Shader {
        label,
        entry: "main",
        parts: vec![GRID, tiling.part(), shader::TILE, shader::HITS, text],
        constants: [
            ("ROWS", Constant::U32(rows as u32)),
            ("CHUNK", Constant::U32(chunk)),
            ("DEPTH", Constant::Bool(depth)),
            ("DESCENDING", Constant::Bool(record_rows > 1)),
        ]
        .into_iter()
        .chain(tiling.constants(2 + chunk, record_rows))
        .collect(),
        bindings,
    };
    [
        shader(
            if depth { "blend_color" } else { "blend_language" },
            include_str!("forward.wgsl"),
            (chunk, 0),
            vec![Read, Read, Read, Read, Read, Write, Write],
        ),
        shader(
            if depth { "contribute_color" } else { "contribute_language" },
            include_str!("contribute.wgsl"),
            (0, 1),
            vec![Read, Read, Read, Read, Read, Write],
        ),
        shader(
            if depth { "blend_back_color" } else { "blend_back_language" },
            include_str!("backward.wgsl"),
            (chunk, 2 + chunk),
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
        let [forward, contribute, backward] = shaders(Tiling::of(gpu.tier()), rows, depth);
        Ok(Self {
            forward: Kernel::new(gpu, &forward)?,
            contribute: Kernel::new(gpu, &contribute)?,
            backward: Kernel::new(gpu, &backward)?,
            chunks: chunks(rows) as u32,
        })
    }

    /// Fills the band of `image` (height x width x rows) and `pixels` (height x width).
    pub fn forward(
        &self,
        recorder: &mut Recorder<'_>,
        lists: TileLists<'_>,
        features: &Buffer<Row>,
        image: &Buffer<Row>,
        pixels: &Buffer<PixelState>,
    ) {
        let [ranges, _, gaussians, splats] = lists.buffers();
        let left_out = &lists.projected.left_out;
        let buffers: [&wgpu::Buffer; 7] =
            [ranges, gaussians, splats, features, left_out, image, pixels];
        for chunk in 0..self.chunks {
            let arguments = PassArguments { chunk, ..*lists.arguments };
            recorder.dispatch(&self.forward, &arguments, &buffers, lists.tiles());
        }
    }

    /// Leaves one row per hit in `records`, at the hit's slot: the sum of its blending weights in a
    /// finished forward pass, and the number of pixels that it reaches with more than half of the
    /// light left behind it.
    pub fn contributions(
        &self,
        recorder: &mut Recorder<'_>,
        lists: TileLists<'_>,
        pixels: &Buffer<PixelState>,
        records: &Buffer<Row>,
    ) {
        let [ranges, slots, gaussians, splats] = lists.buffers();
        let buffers: [&wgpu::Buffer; 6] = [ranges, slots, gaussians, splats, pixels, records];
        recorder.dispatch(&self.contribute, lists.arguments, &buffers, lists.tiles());
    }

    /// `features` has `rows` rows per Gaussian. Turns dL/dimage into one record per hit
    /// ([`record_rows`] rows, at the hit's slot).
    pub fn backward(
        &self,
        recorder: &mut Recorder<'_>,
        lists: TileLists<'_>,
        features: &Buffer<Row>,
        pixels: &Buffer<PixelState>,
        gradients: &Buffer<Row>,
        records: &Buffer<Row>,
    ) {
        let [ranges, slots, gaussians, splats] = lists.buffers();
        let buffers: [&wgpu::Buffer; 8] =
            [ranges, slots, gaussians, splats, features, pixels, gradients, records];
        for chunk in 0..self.chunks {
            let arguments = PassArguments { chunk, ..*lists.arguments };
            recorder.dispatch(&self.backward, &arguments, &buffers, lists.tiles());
        }
    }
}
