//! Sum of one row of each element of an array, component by component, in a fixed order.
//!
//! A thread sums a run of [`RUN`] rows; the sums are summed again until one is left.

use crate::device::{Buffer, Gpu, GpuError};
use crate::shader::layout::{RUN, ReduceArguments, Row};
use crate::shader::{Access, GRID, Kernel, Recorder, Shader};

/// The kernel of a sum.
pub struct Reduce {
    kernel: Kernel,
    no_limit: Buffer<u32>,
}

/// Input of a sum.
#[derive(Clone, Copy)]
pub struct Summands<'a> {
    /// All elements.
    pub rows: &'a Buffer<Row>,
    /// Number of elements.
    pub len: usize,
    /// Rows per element.
    pub stride: u32,
    /// The row of an element that is summed.
    pub row: u32,
    /// A buffer that starts with the number of elements to sum; `None` to sum all.
    pub limit: Option<&'a wgpu::Buffer>,
}

/// Sums of runs for arrays up to one length.
pub struct ReduceScratch {
    levels: [Buffer<Row>; 2],
}

/// This kernel's shader.
pub fn shaders() -> [Shader; 1] {
    [Shader {
        label: "reduce",
        entry: "main",
        parts: vec![GRID, include_str!("reduce.wgsl")],
        constants: Vec::new(),
        bindings: vec![Access::Read, Access::Read, Access::Write],
    }]
}

impl ReduceScratch {
    /// Room to sum up to `len` elements.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(gpu: &Gpu, len: usize) -> Result<Self, GpuError> {
        let first = len.div_ceil(RUN as usize);
        let second = first.div_ceil(RUN as usize);
        Ok(Self { levels: [Buffer::new(gpu, "sums", first)?, Buffer::new(gpu, "sums", second)?] })
    }
}

impl Reduce {
    /// Compiles the kernel.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [shader] = shaders();
        let no_limit = Buffer::from_slice(gpu, "no limit", &[u32::MAX])?;
        Ok(Self { kernel: Kernel::new(gpu, &shader)?, no_limit })
    }

    /// Writes the sum to `results[slot]`; the sum of no element writes nothing.
    pub fn sum(
        &self,
        recorder: &mut Recorder<'_>,
        summands: Summands<'_>,
        results: &Buffer<Row>,
        slot: u32,
        scratch: &ReduceScratch,
    ) {
        let Summands { rows: mut from, mut len, mut stride, mut row, .. } = summands;
        let mut limit = summands.limit.unwrap_or(&self.no_limit);
        for side in (0..2).cycle() {
            let runs = len.div_ceil(RUN as usize);
            let (to, slot) = if runs > 1 { (&scratch.levels[side], 0) } else { (results, slot) };
            let arguments = ReduceArguments { count: len as u32, stride, row, slot };
            recorder.dispatch_threads(&self.kernel, &arguments, &[limit, from, to], runs);
            if runs <= 1 {
                return;
            }
            (from, len, stride, row, limit) = (to, runs, 1, 0, &self.no_limit);
        }
    }
}
