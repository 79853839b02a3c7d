//! Exclusive prefix sum of `u32`, in place: `out[i] = in[0] + ... + in[i - 1]`, saturating.
//!
//! A thread owns a run of [`RUN`] elements. Runs are summed, the sums are scanned the same way, and
//! every run is rewritten from its sum of predecessors. No barrier, any length.

use crate::device::{Buffer, Gpu, GpuError};
use crate::shader::layout::{ArrayArguments, RUN};
use crate::shader::{Access, GRID, Kernel, Recorder, Shader};

/// The two kernels of a scan.
pub struct Scan {
    sum: Kernel,
    apply: Kernel,
}

/// Sums of runs, level by level, for arrays up to one length.
pub struct ScanScratch {
    levels: Vec<Buffer<u32>>,
    zero: Buffer<u32>,
}

/// This kernel's shaders.
pub fn shaders() -> [Shader; 2] {
    let shader = |label, entry, bindings: [Access; 2]| Shader {
        label,
        entry,
        parts: vec![GRID, include_str!("scan.wgsl")],
        constants: Vec::new(),
        bindings: bindings.to_vec(),
    };
    [
        shader("scan_sum", "sum_runs", [Access::Write, Access::Write]),
        shader("scan_apply", "apply_runs", [Access::Write, Access::Write]),
    ]
}

impl Scan {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [sum, apply] = shaders();
        Ok(Self { sum: Kernel::new(gpu, &sum)?, apply: Kernel::new(gpu, &apply)? })
    }

    /// Room to scan up to `len` elements.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn scratch(&self, gpu: &Gpu, len: usize) -> Result<ScanScratch, GpuError> {
        let mut levels = Vec::new();
        let mut len = len;
        while len > RUN as usize {
            len = len.div_ceil(RUN as usize);
            levels.push(Buffer::new(gpu, "scan level", len)?);
        }
        Ok(ScanScratch { levels, zero: Buffer::new(gpu, "scan zero", 1)? })
    }

    /// Scans the first `len` elements of `values`.
    pub fn exclusive(
        &self,
        recorder: &mut Recorder<'_>,
        values: &Buffer<u32>,
        len: usize,
        scratch: &ScanScratch,
    ) {
        self.level(recorder, values, len, &scratch.levels, &scratch.zero);
    }

    fn level(
        &self,
        recorder: &mut Recorder<'_>,
        values: &Buffer<u32>,
        len: usize,
        levels: &[Buffer<u32>],
        zero: &Buffer<u32>,
    ) {
        let runs = len.div_ceil(RUN as usize);
        let arguments = ArrayArguments { count: len as u32, detail: 0 };
        let before = match levels.split_first() {
            Some((sums, rest)) if runs > 1 => {
                recorder.dispatch_threads(&self.sum, &arguments, &[values, sums], runs);
                self.level(recorder, sums, runs, rest, zero);
                sums
            }
            _ => zero,
        };
        recorder.dispatch_threads(&self.apply, &arguments, &[values, before], runs);
    }
}
