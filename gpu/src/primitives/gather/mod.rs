//! Copies chosen elements of an array: `out[i] = in[index[i]]`, an element being `width` words of
//! four bytes. Elements of whole rows are copied row by row.
//!
//! This is how Gaussians are dropped, copied and re-ordered without leaving the device. An entry of
//! `index` holds the source in its low 30 bits ([`INDEX_MASK`]) and two marks above: [`FRESH`] for
//! a newborn, which [`Gather::gather_state`] gives zeros, and
//! [`CHILD`](crate::shader::layout::CHILD), which this kernel ignores.
//!
//! [`INDEX_MASK`]: crate::shader::layout::INDEX_MASK
//! [`FRESH`]: crate::shader::layout::FRESH

use crate::device::{Buffer, Gpu, GpuError};
use crate::shader::layout::GatherArguments;
use crate::shader::{Access, GRID, Kernel, Recorder, Shader};

/// Words per row.
const ROW_WORDS: usize = 4;

/// The kernels.
pub struct Gather {
    words: Kernel,
    rows: Kernel,
}

/// This kernel's shaders: by words and by rows.
pub fn shaders() -> [Shader; 2] {
    let shader = |label, unit| Shader {
        label,
        entry: "main",
        parts: vec![GRID, unit, include_str!("gather.wgsl")],
        constants: Vec::new(),
        bindings: vec![Access::Read, Access::Read, Access::Write],
    };
    [
        shader("gather_words", include_str!("words.wgsl")),
        shader("gather_rows", include_str!("rows.wgsl")),
    ]
}

impl Gather {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [words, rows] = shaders();
        Ok(Self { words: Kernel::new(gpu, &words)?, rows: Kernel::new(gpu, &rows)? })
    }

    /// Fills the first `index.len()` elements of `to`; an element is `width` words of four bytes.
    pub fn gather(
        &self,
        recorder: &mut Recorder<'_>,
        index: &Buffer<u32>,
        buffers: (&wgpu::Buffer, &wgpu::Buffer),
        width: usize,
    ) {
        self.record(recorder, index, buffers, (width, false));
    }

    /// As [`Gather::gather`], for state that a newborn does not inherit: it gets zeros.
    pub fn gather_state(
        &self,
        recorder: &mut Recorder<'_>,
        index: &Buffer<u32>,
        buffers: (&wgpu::Buffer, &wgpu::Buffer),
        width: usize,
    ) {
        self.record(recorder, index, buffers, (width, true));
    }

    fn record(
        &self,
        recorder: &mut Recorder<'_>,
        index: &Buffer<u32>,
        (from, to): (&wgpu::Buffer, &wgpu::Buffer),
        (width, fresh): (usize, bool),
    ) {
        let by_rows = width.is_multiple_of(ROW_WORDS);
        let (kernel, width) =
            if by_rows { (&self.rows, width / ROW_WORDS) } else { (&self.words, width) };
        let units = index.len() * width;
        let arguments =
            GatherArguments { count: units as u32, width: width as u32, fresh: u32::from(fresh) };
        recorder.dispatch_threads(kernel, &arguments, &[index, from, to], units);
    }
}
