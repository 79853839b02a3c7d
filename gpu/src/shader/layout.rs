//! Constants and structs that Rust and WGSL share. The WGSL header is made from this file. A test
//! compares size, offsets and names through naga, without a device.
//!
//! Arrays of parameters are plain `vec4<f32>` rows: a mean is one row (x, y, z, 0), a head's
//! geometry two rows (rotation w x y z; log scale x y z, opacity logit), a feature `channels / 4`
//! rows rounded up and filled with zeros.

use crate::shader::layout_macros::{constants, structs};
use std::fmt::Write as _;

/// One row of parameters, of an image or of a record.
pub type Row = [f32; 4];

/// A struct of this file.
pub struct Struct {
    /// Name in Rust and in WGSL.
    pub name: &'static str,
    /// Size in bytes.
    pub size: usize,
    /// Its fields, in order.
    pub fields: &'static [Field],
}

/// A field of a struct of this file.
pub struct Field {
    /// Name in Rust and in WGSL.
    pub name: &'static str,
    /// Bytes from the start of the struct.
    pub offset: usize,
    /// Type in WGSL.
    pub wgsl: &'static str,
}

constants! {
    /// Threads per workgroup of the kernels with one thread per element.
    GROUP: u32 = 64;
    /// WebGPU's limit on the workgroups along one axis.
    GROUPS_PER_AXIS: u32 = 65_535;
    /// Elements that one thread sums or scans.
    RUN: u32 = 64;
    /// Tiles that the mask of a Gaussian has bits for.
    MASK_TILES: u32 = 32;
    /// Gaussians nearer than this, in metres, are not drawn.
    NEAR: f32 = 0.1;
    /// Lowest bits of a depth that the depth sort ignores: two parts in a million.
    DEPTH_SHIFT: u32 = 4;
    /// Gaussians farther than this, in metres, are not drawn.
    FAR: f32 = 1e6;
    /// Added to the diagonal of the projected covariance, in square pixels. Kerbl et al. 2023 use
    /// 0.3; a smaller value blurs less and gives edges as sharp as those of a camera.
    DILATION: f32 = 0.1;
    /// Largest alpha of one Gaussian at a pixel.
    MAX_ALPHA: f32 = 0.99;
    /// Gaussians with a smaller alpha at a pixel are skipped; 1/255.
    MIN_ALPHA: f32 = 0.003_921_569;
    /// A pixel is full before its transmittance falls below this.
    MIN_TRANSMITTANCE: f32 = 1e-4;
    /// The projection's Jacobian is taken within this multiple of the field of view.
    VIEW_MARGIN: f32 = 1.3;
    /// Logarithms of scales are used within ± this.
    LOG_SCALE_LIMIT: f32 = 20.0;
    /// Decay of the optimiser's first moment.
    BETA_FIRST: f32 = 0.9;
    /// Decay of the optimiser's second moment.
    BETA_SECOND: f32 = 0.999;
    /// Natural logarithm of `BETA_FIRST`.
    LOG_BETA_FIRST: f32 = -0.105_360_542;
    /// Natural logarithm of `BETA_SECOND`.
    LOG_BETA_SECOND: f32 = -0.001_000_487_5;
    /// Keeps the optimiser's division finite.
    EPSILON: f32 = 1e-15;
    /// Gradients from here on are not followed: their squares would not be finite.
    MAX_GRADIENT: f32 = 1e15;
    /// log2(e).
    BITS_PER_NAT: f32 = 1.442_695_1;
    /// Absolute values from here on count as not finite.
    HUGE: f32 = 1e30;
    /// Values per axis of a Morton code's cell.
    MORTON_CELLS: u32 = 1024;
    /// Key of what has no place: behind all Morton codes.
    MORTON_LAST: u32 = 0x4000_0000;
    /// Weight of red in an intensity (Rec. 601).
    LUMA_RED: f32 = 0.299;
    /// Weight of green.
    LUMA_GREEN: f32 = 0.587;
    /// Weight of blue.
    LUMA_BLUE: f32 = 0.114;
    /// Depths within this part of each other are one surface.
    DEPTH_AGREEMENT: f32 = 0.05;
    /// Depths on both sides of a pixel that bend by more than this part of it are at an edge.
    DEPTH_BEND: f32 = 0.01;
    /// A depth may be this many of its standard deviations off and still be of the same surface.
    GATE_SIGMAS: f32 = 3.0;
    /// A rendered pixel must be more opaque than this to have an intensity and a depth.
    MIN_OPACITY: f32 = 0.5;
    /// Stands for a normal that is not there; no normal is packed as this.
    NO_NORMAL: u32 = 0x8000_8000;
    /// Rows of a normal system: 36 of the matrix, 8 of the gradient, 8 sums.
    SYSTEM_ROWS: u32 = 14;
    /// Pixels that one thread adds to a normal system.
    SYSTEM_RUN: u32 = 64;
}

structs! {
    /// The camera and the sizes of one pass.
    PassArguments {
        /// First row of `camera_from_world`.
        camera_x: Row => "vec4<f32>",
        /// Second row.
        camera_y: Row => "vec4<f32>",
        /// Third row.
        camera_z: Row => "vec4<f32>",
        /// Focal lengths, in pixels.
        focal: [f32; 2] => "vec2<f32>",
        /// Principal point, in pixels.
        centre: [f32; 2] => "vec2<f32>",
        /// Bound on |x/z| and |y/z| in the Jacobian.
        limit: [f32; 2] => "vec2<f32>",
        /// Width and height, in pixels.
        size: [u32; 2] => "vec2<u32>",
        /// Columns and rows of tiles.
        tiles: [u32; 2] => "vec2<u32>",
        /// Number of Gaussians.
        count: u32 => "u32",
        /// Number of hits that the lists hold.
        capacity: u32 => "u32",
        /// Which part of the feature's rows is blended.
        chunk: u32 => "u32",
        /// Runs into which hits are cut where tiles are counted, not sorted.
        runs: u32 => "u32",
        /// First row of tiles of the band that is listed, and the row behind its last.
        band: [u32; 2] => "vec2<u32>",
        /// Bands of the picture.
        bands: u32 => "u32",
        /// Fills the struct to 128 bytes.
        unused: u32 => "u32",
        /// Likewise.
        spare: [u32; 2] => "vec2<u32>",
    }
    /// A Gaussian projected into one camera: alpha = 2^(level - first dx^2 - second (dy - lean
    /// dx)^2) at an offset (dx, dy) from its centre.
    Splat {
        /// Centre, in pixels; first; lean.
        place: Row => "vec4<f32>",
        /// Second; level; z in the camera, metres; by how much the power may fall before alpha is
        /// below `MIN_ALPHA`.
        form: Row => "vec4<f32>",
        /// Color and depth. Zeros for language: its features are too long to be stored here.
        feature: Row => "vec4<f32>",
        /// Half width and height of the visible ellipse, in pixels.
        extent: [f32; 2] => "vec2<f32>",
        /// Fills the struct to 64 bytes, a line of most caches.
        unused: [f32; 2] => "vec2<f32>",
    }
    /// Which tiles a Gaussian hits.
    Coverage {
        /// How many.
        hits: u32 => "u32",
        /// A bit for each tile of the rectangle that is hit, row by row; meaningless if there are
        /// more than `MASK_TILES`.
        mask: u32 => "u32",
        /// The first tile of the rectangle.
        origin: u32 => "u32",
        /// Columns of the rectangle; 0 if it has more than `MASK_TILES` tiles.
        width: u32 => "u32",
    }
    /// State of a pixel after the forward blend.
    PixelState {
        /// Light that passes all Gaussians.
        transmittance: f32 => "f32",
        /// One more than the sorted index of the last hit that was blended; 0 for none.
        last: u32 => "u32",
    }
    /// How many hits a view has, band by band.
    HitCount {
        /// Hits in the lists of the last band.
        drawn: u32 => "u32",
        /// Hits that the view would have if all bands were as full as the fullest.
        wanted: u32 => "u32",
        /// Hits of all bands that the lists had no room for.
        missing: u32 => "u32",
        /// Workgroups for one thread per hit in the lists.
        groups: [u32; 3] => "array<u32, 3>",
    }
    /// Number of visible Gaussians of a view.
    Visible {
        /// Gaussians with a hit.
        count: u32 => "u32",
        /// Workgroups for one thread more than that.
        groups: [u32; 3] => "array<u32, 3>",
    }
    /// For kernels over a flat array.
    ArrayArguments {
        /// Number of elements.
        count: u32 => "u32",
        /// Kernel's own, such as rows per element.
        detail: u32 => "u32",
    }
    /// For the sum of rows.
    ReduceArguments {
        /// Number of elements.
        count: u32 => "u32",
        /// Rows per element.
        stride: u32 => "u32",
        /// The row of an element that is summed.
        row: u32 => "u32",
        /// Index of the first sum in the output.
        slot: u32 => "u32",
    }
    /// For the sort.
    SortArguments {
        /// Number of runs.
        runs: u32 => "u32",
        /// Lowest bit of the digit.
        shift: u32 => "u32",
        /// Bits of the digit.
        bits: u32 => "u32",
        /// Fills the struct to 16 bytes.
        unused: u32 => "u32",
    }
    /// For the loss kernels.
    LossArguments {
        /// Number of pixels, or of Gaussians.
        count: u32 => "u32",
        /// Rows per pixel of the image.
        rows: u32 => "u32",
        /// Factor of the first term, divided by the number of values it averages.
        first: f32 => "f32",
        /// Factor of the second term, likewise.
        second: f32 => "f32",
        /// Exposure (a, b): the picture is compared as exp(a) picture + b.
        exposure: [f32; 2] => "vec2<f32>",
        /// Width and height of the picture, in pixels. Color only, as the next.
        size: [u32; 2] => "vec2<u32>",
        /// Columns and rows of tiles.
        tiles: [u32; 2] => "vec2<u32>",
    }
    /// For the choice of the tiles of a step.
    FocusArguments {
        /// Number of tiles.
        tiles: u32 => "u32",
        /// Probability of a tile with the mean error of its view.
        mean_share: f32 => "f32",
        /// Probability of a tile without error.
        least_share: f32 => "f32",
        /// Number of the step, for random numbers that differ from step to step.
        turn: u32 => "u32",
    }
    /// For the ties between the heads: 1 where a component is tied, 0 elsewhere.
    TieArguments {
        /// Components of the rotation.
        even: Row => "vec4<f32>",
        /// Log scales and opacity logit.
        odd: Row => "vec4<f32>",
        /// Number of Gaussians.
        count: u32 => "u32",
        /// Fills the struct to 48 bytes.
        unused: u32 => "u32",
        /// Likewise.
        spare: [u32; 2] => "vec2<u32>",
    }
    /// For the count of the optimiser's steps.
    AdvanceArguments {
        /// Number of Gaussians.
        count: u32 => "u32",
        /// Rows of the sums per visible Gaussian.
        rows: u32 => "u32",
        /// By how much the rates of a Gaussian's first step are larger than its last ones', as a
        /// factor.
        first_rate: f32 => "f32",
        /// Steps after which the difference is 1/e of that.
        young_steps: f32 => "f32",
    }
    /// For the optimiser.
    AdamArguments {
        /// Learning rates of an even row.
        even: Row => "vec4<f32>",
        /// Learning rates of an odd row.
        odd: Row => "vec4<f32>",
        /// Number of Gaussians.
        count: u32 => "u32",
        /// Rows of parameters per Gaussian.
        rows: u32 => "u32",
        /// Rows of gradients per Gaussian; those of the parameters are the first.
        stride: u32 => "u32",
        /// Upper limit of the first three values of an odd row.
        odd_at_most: f32 => "f32",
    }
    /// For pruning.
    PruneArguments {
        /// Number of Gaussians.
        count: u32 => "u32",
        /// Opacity logit below which, in both heads, a Gaussian is removed.
        min_logit: f32 => "f32",
    }
    /// For Morton codes.
    MortonArguments {
        /// Smallest coordinates of the box, metres; then a zero.
        low: Row => "vec4<f32>",
        /// Cells per metre along each axis; then a zero.
        scale: Row => "vec4<f32>",
        /// Fills the struct to a multiple of 16 bytes.
        unused: [u32; 3] => "vec3<u32>",
        /// Number of Gaussians.
        count: u32 => "u32",
    }
    /// For the kernels of a pyramid.
    PyramidArguments {
        /// Focal lengths of the level, in pixels.
        focal: [f32; 2] => "vec2<f32>",
        /// Principal point, in pixels.
        centre: [f32; 2] => "vec2<f32>",
        /// Width and height, in pixels.
        size: [u32; 2] => "vec2<u32>",
        /// Width of the next finer level, when it is halved.
        fine_width: u32 => "u32",
        /// Fills the struct to 32 bytes.
        unused: u32 => "u32",
    }
    /// For the kernel of a normal system.
    AlignArguments {
        /// First row of `reference_from_live`.
        pose_x: Row => "vec4<f32>",
        /// Second row.
        pose_y: Row => "vec4<f32>",
        /// Third row.
        pose_z: Row => "vec4<f32>",
        /// Focal lengths and principal point of the reference, in pixels.
        reference: Row => "vec4<f32>",
        /// Those of the live level.
        live: Row => "vec4<f32>",
        /// Robust thresholds of both terms, then residuals of an inlier: intensity, metres.
        thresholds: Row => "vec4<f32>",
        /// Largest distance from a surface in metres, smallest cosine between normals, standard
        /// deviation of a depth of one metre in metres (it grows with the depth squared), place in a
        /// run of `stride` pixels, 0 to 1.
        gates: Row => "vec4<f32>",
        /// Width and height of the reference, in pixels.
        reference_size: [u32; 2] => "vec2<u32>",
        /// Exposure: factor exp(a) and offset b.
        exposure: [f32; 2] => "vec2<f32>",
        /// Weights of the photometric and of the geometric term.
        weights: [f32; 2] => "vec2<f32>",
        /// Width and height of the live level, in pixels.
        live_size: [u32; 2] => "vec2<u32>",
        /// Number of live pixels that are looked at.
        count: u32 => "u32",
        /// One of so many live pixels is looked at.
        stride: u32 => "u32",
        /// Workgroups of this comparison.
        groups: u32 => "u32",
        /// Workgroups of those before it.
        first_group: u32 => "u32",
    }
}

/// Most iterations of one loop of a kernel. Mesa's llvmpipe silently ends loops after 65,535
/// iterations of all loops of a thread together.
pub const LONGEST_LOOP: usize = 1 << 14;
/// Most tiles of an image, for the same reason: a thread may loop over all of them.
pub const MAX_TILES: usize = 60_000;

/// Rows that hold `channels` values.
pub const fn rows_for(channels: usize) -> usize {
    channels.div_ceil(4)
}

/// Constants and structs in WGSL.
pub fn wgsl_header() -> String {
    let mut text = String::new();
    write_constants(&mut text);
    for layout in STRUCTS {
        let _ = writeln!(text, "struct {} {{", layout.name);
        for field in layout.fields {
            let _ = writeln!(text, "    {}: {},", field.name, field.wgsl);
        }
        text.push_str("}\n");
    }
    text
}
