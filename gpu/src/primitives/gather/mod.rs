//! Copies chosen elements of an array: `to[i] = from[index[i]]`, an element being `width` words of
//! four bytes. Elements of whole rows are copied row by row. Gaussians are removed and reordered
//! with it, without leaving the device.

use crate::device::{Buffer, Gpu, GpuError};
use crate::shader::layout::ArrayArguments;
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

    /// Fills the first `len` elements of `to` by the first `len` entries of `index`; an element is
    /// `width` words of four bytes.
    pub fn gather(
        &self,
        recorder: &mut Recorder<'_>,
        index: &Buffer<u32>,
        len: usize,
        from: &wgpu::Buffer,
        to: &wgpu::Buffer,
        width: usize,
    ) {
        let by_rows = width.is_multiple_of(ROW_WORDS);
        let (kernel, width) =
            if by_rows { (&self.rows, width / ROW_WORDS) } else { (&self.words, width) };
        let units = len * width;
        let arguments = ArrayArguments { count: units as u32, detail: width as u32 };
        recorder.dispatch_threads(kernel, &arguments, &[index, from, to], units);
    }
}
