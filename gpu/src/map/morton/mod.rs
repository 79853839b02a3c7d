//! Morton order, which puts Gaussians that are near each other in the world near each other in
//! memory.
//!
//! In: means, one row each, metres. Out: keys of 30 bits, ten per axis, x lowest, over the box
//! around all finite means: cell = floor((p - low) 1024 / (high - low)), at most 1023. A mean that
//! is not finite has the key [`MORTON_LAST`], behind all others. The box is read back (32 bytes)
//! and the cells per metre are computed once, on the host, so that no device's division can change
//! a key.
//!
//! Nothing here sorts or moves anything.

use crate::device::{Buffer, Gpu, GpuError};
use crate::primitives::sort::SortBuffers;
use crate::shader::layout::{ArrayArguments, MORTON_CELLS, MORTON_LAST, MortonArguments, RUN, Row};
use crate::shader::{Access, Constant, GRID, Kernel, Recorder, Shader};

/// Bits of a key, [`MORTON_LAST`] included.
pub const KEY_BITS: u32 = u32::BITS - MORTON_LAST.leading_zeros();

/// Axes shorter than this, in metres, are taken for a point.
const MIN_EXTENT: f32 = 1e-30;

/// The kernels.
pub struct Morton {
    points: Kernel,
    boxes: Kernel,
    codes: Kernel,
}

/// This kernel's shaders.
pub fn shaders() -> [Shader; 3] {
    use Access::{Read, Write};
    let bounds = |label, points| Shader {
        label,
        entry: "main",
        parts: vec![GRID, include_str!("bounds.wgsl")],
        constants: vec![("POINTS", Constant::Bool(points))],
        bindings: vec![Read, Write],
    };
    let codes = Shader {
        label: "morton_codes",
        entry: "main",
        parts: vec![GRID, include_str!("codes.wgsl")],
        constants: Vec::new(),
        bindings: vec![Read, Write, Write],
    };
    [bounds("morton_points", true), bounds("morton_boxes", false), codes]
}

/// The uniform for a box from `low` to `high`.
pub fn arguments(low: Row, high: Row, count: usize) -> MortonArguments {
    let scale = |axis: usize| {
        let extent = high[axis] - low[axis];
        if extent >= MIN_EXTENT { MORTON_CELLS as f32 / extent } else { 0.0 }
    };
    MortonArguments {
        low: [low[0], low[1], low[2], 0.0],
        scale: [scale(0), scale(1), scale(2), 0.0],
        unused: [0; 3],
        count: count as u32,
    }
}

impl Morton {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [points, boxes, codes] = shaders();
        Ok(Self {
            points: Kernel::new(gpu, &points)?,
            boxes: Kernel::new(gpu, &boxes)?,
            codes: Kernel::new(gpu, &codes)?,
        })
    }

    /// The smallest box around the finite means among the first `len`, waited for; none if none is
    /// finite.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn bounds(
        &self,
        gpu: &Gpu,
        means: &Buffer<Row>,
        len: usize,
    ) -> Result<Option<(Row, Row)>, GpuError> {
        if len == 0 {
            return Ok(None);
        }
        let runs = |len: usize| len.div_ceil(RUN as usize);
        let sides = [
            Buffer::new(gpu, "boxes", 2 * runs(len))?,
            Buffer::new(gpu, "boxes", 2 * runs(runs(len)))?,
        ];
        let mut recorder = Recorder::new(gpu)?;
        let (mut from, mut kernel, mut left) = (means, &self.points, len);
        for side in sides.iter().cycle() {
            let arguments = ArrayArguments { count: left as u32, detail: 0 };
            recorder.dispatch_threads(kernel, &arguments, &[from, side], runs(left));
            (from, kernel, left) = (side, &self.boxes, runs(left));
            if left <= 1 {
                break;
            }
        }
        recorder.submit();
        let found = from.read(gpu, 2)?;
        let finite = found[0][0] <= found[1][0];
        Ok(finite.then_some((found[0], found[1])))
    }

    /// Fills side 0 of `buffers` with keys and, as payload, Gaussians.
    pub fn codes(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &MortonArguments,
        means: &Buffer<Row>,
        buffers: &SortBuffers,
    ) {
        recorder.dispatch_threads(
            &self.codes,
            arguments,
            &[means, &buffers.keys[0], &buffers.values[0]],
            arguments.count as usize,
        );
    }
}
