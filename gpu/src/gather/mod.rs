//! Copies chosen elements of an array of words: `out[i] = in[index[i]]`, an element being `width`
//! words.
//!
//! This is how Gaussians are dropped without leaving the device.

use crate::buffer::Buffer;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::kernel::{Kernel, Recorder};
use crate::layout::ArrayArguments;
use crate::shader::{Access, GRID, Shader};

/// The kernel.
pub struct Gather {
    kernel: Kernel,
}

/// This kernel's shader.
pub fn shaders() -> [Shader; 1] {
    [Shader {
        label: "gather",
        entry: "main",
        parts: vec![GRID, include_str!("gather.wgsl")],
        constants: Vec::new(),
        bindings: vec![Access::Read, Access::Read, Access::Write],
    }]
}

impl Gather {
    /// Compiles the kernel.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [shader] = shaders();
        Ok(Self { kernel: Kernel::new(gpu, &shader)? })
    }

    /// Fills the first `index.len()` elements of `to`; an element is `width` words of four bytes.
    pub fn gather(
        &self,
        recorder: &mut Recorder<'_>,
        index: &Buffer<u32>,
        (from, to): (&wgpu::Buffer, &wgpu::Buffer),
        width: usize,
    ) {
        let words = index.len() * width;
        let arguments = ArrayArguments { count: words as u32, detail: width as u32 };
        recorder.dispatch_threads(&self.kernel, &arguments, &[index, from, to], words);
    }
}
