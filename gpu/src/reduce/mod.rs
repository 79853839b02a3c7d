//! Sum of an array of rows, component by component, in a fixed order.
//!
//! A thread sums a run of [`RUN`] rows; the sums are summed again until one is left.

use crate::buffer::Buffer;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::kernel::{Kernel, Recorder};
use crate::layout::{ArrayArguments, RUN, Row};
use crate::shader::{Access, GRID, Shader};

/// The kernel of a sum.
pub struct Reduce {
    kernel: Kernel,
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
        bindings: vec![Access::Read, Access::Write],
    }]
}

impl Reduce {
    /// Compiles the kernel.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [shader] = shaders();
        Ok(Self { kernel: Kernel::new(gpu, &shader)? })
    }

    /// Room to sum up to `len` rows.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn scratch(&self, gpu: &Gpu, len: usize) -> Result<ReduceScratch, GpuError> {
        let first = len.div_ceil(RUN as usize);
        let second = first.div_ceil(RUN as usize);
        Ok(ReduceScratch {
            levels: [Buffer::new(gpu, "sums", first)?, Buffer::new(gpu, "sums", second)?],
        })
    }

    /// Writes the sum of the first `len` rows to `results[slot]`; the sum of nothing writes
    /// nothing.
    pub fn sum(
        &self,
        recorder: &mut Recorder<'_>,
        (rows, len): (&Buffer<Row>, usize),
        (results, slot): (&Buffer<Row>, u32),
        scratch: &ReduceScratch,
    ) {
        let (mut from, mut len) = (rows, len);
        for side in (0..2).cycle() {
            let runs = len.div_ceil(RUN as usize);
            let (to, detail) = if runs > 1 { (&scratch.levels[side], 0) } else { (results, slot) };
            let arguments = ArrayArguments { count: len as u32, detail };
            recorder.dispatch_threads(&self.kernel, &arguments, &[from, to], runs);
            if runs <= 1 {
                return;
            }
            (from, len) = (to, runs);
        }
    }
}
