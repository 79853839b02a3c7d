//! Which Gaussians stay in a map.
//!
//! In: log scales and opacity logits of both heads, and the means. Out: `source[i]`, the index of
//! the Gaussian that comes to place i, for [`Gather`](crate::primitives::gather::Gather), and the
//! number of Gaussians that stay. Their order stays too.
//!
//! A Gaussian is removed if its opacity is below a limit in both heads (the paper, section 4.3), or
//! if its mean or a scale of its color head is not a number. Opacities are compared as logits, so
//! that the arithmetic of a device cannot change a decision.

use crate::device::{Buffer, Gpu, GpuError};
use crate::map::arrays::Arrays;
use crate::primitives::scan::{Scan, ScanScratch};
use crate::shader::layout::PruneArguments;
use crate::shader::{Access, GRID, Kernel, Recorder, Shader};

/// The kernels.
pub struct Prune {
    decide: Kernel,
    compact: Kernel,
}

/// Buffers to prune a map of one size.
pub struct PruneBuffers {
    /// 1 for a Gaussian that stays; scanned, the number of those before it.
    kept: Buffer<u32>,
    scan: ScanScratch,
    /// Where each Gaussian comes from; the first `total` count.
    pub source: Buffer<u32>,
    /// The number of Gaussians that stay.
    pub total: Buffer<u32>,
}

/// This kernel's shaders.
pub fn shaders() -> [Shader; 2] {
    use Access::{Read, Write};
    let shader = |label, text, bindings| Shader {
        label,
        entry: "main",
        parts: vec![GRID, text],
        constants: Vec::new(),
        bindings,
    };
    [
        shader("prune_decide", include_str!("decide.wgsl"), vec![Read, Read, Read, Write]),
        shader("prune_compact", include_str!("compact.wgsl"), vec![Read, Write, Write]),
    ]
}

/// The uniform for a map of `count` Gaussians.
///
/// # Errors
/// [`GpuError::BadValue`] unless `min_opacity` is a number from 0 to 1.
pub fn arguments(min_opacity: f32, count: usize) -> Result<PruneArguments, GpuError> {
    if !(0.0..=1.0).contains(&min_opacity) {
        let (what, expected) = ("min_opacity", "a number from 0 to 1");
        return Err(GpuError::BadValue { what, expected, found: min_opacity.to_string() });
    }
    // Devices need not know infinity.
    let min_logit = (min_opacity / (1.0 - min_opacity)).ln().clamp(f32::MIN, f32::MAX);
    Ok(PruneArguments { count: count as u32, min_logit })
}

impl PruneBuffers {
    /// Room for a map of `len` Gaussians.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(gpu: &Gpu, scan: &Scan, len: usize) -> Result<Self, GpuError> {
        Ok(Self {
            kept: Buffer::new(gpu, "kept", len + 1)?,
            scan: scan.scratch(gpu, len + 1)?,
            source: Buffer::new(gpu, "source", len)?,
            total: Buffer::new(gpu, "kept total", 1)?,
        })
    }
}

impl Prune {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [decide, compact] = shaders();
        Ok(Self { decide: Kernel::new(gpu, &decide)?, compact: Kernel::new(gpu, &compact)? })
    }

    /// Fills `source` and `total` of `buffers`.
    pub fn record(
        &self,
        recorder: &mut Recorder<'_>,
        scan: &Scan,
        arguments: &PruneArguments,
        arrays: &Arrays,
        buffers: &PruneBuffers,
    ) {
        let PruneBuffers { kept, source, total, .. } = buffers;
        let (color, language) = (&arrays.color.geometry.values, &arrays.language.geometry.values);
        let elements = arguments.count as usize + 1;
        let decided: [&wgpu::Buffer; 4] = [color, language, &arrays.means.values, kept];
        recorder.dispatch_threads(&self.decide, arguments, &decided, elements);
        scan.exclusive(recorder, kept, elements, &buffers.scan);
        recorder.dispatch_threads(&self.compact, arguments, &[kept, source, total], elements);
    }
}
