//! The Gaussians that a view sees, near to far: one depth sort for both heads, whose means are the
//! same.
//!
//! In: what [`crate::project`] found for one head or for both. Out: the number of visible Gaussians
//! and `gaussian_from_rank`, by depth, equal depths by index. Everything behind works in ranks and
//! costs nothing for a Gaussian that no head shows.

use bytemuck::Pod;

use crate::buffer::Buffer;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::kernel::{Kernel, Recorder};
use crate::layout::{ArrayArguments, FAR, GROUP, GROUPS_PER_AXIS, NEAR, Visible};
use crate::project::Projected;
use crate::scan::ScanScratch;
use crate::shader::{Access, GRID, Shader};
use crate::sort::{Sort, SortBuffers};

/// The kernels that pick and sort.
pub struct Order {
    flag: Kernel,
    compact: Kernel,
}

/// The visible Gaussians of one view; room for `capacity`.
pub struct Ranks {
    sort: SortBuffers,
    slots: Buffer<u32>,
    scan: ScanScratch,
    /// How many there are.
    pub visible: Buffer<Visible>,
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
        shader("order_flag", include_str!("flag.wgsl"), vec![Read, Read, Write]),
        shader(
            "order_compact",
            include_str!("compact.wgsl"),
            vec![Read, Read, Read, Read, Read, Write, Write, Write],
        ),
    ]
}

impl Ranks {
    /// Room for `capacity` Gaussians.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(gpu: &Gpu, sort: &Sort, capacity: usize) -> Result<Self, GpuError> {
        let depth_bits = u32::BITS - (FAR.to_bits() - NEAR.to_bits()).leading_zeros();
        Ok(Self {
            sort: sort.buffers(gpu, capacity, depth_bits)?,
            slots: Buffer::new(gpu, "visible slots", capacity + 1)?,
            scan: sort.scan().scratch(gpu, capacity + 1)?,
            visible: Buffer::new(gpu, "visible", 1)?,
        })
    }

    /// Ranks of `count` Gaussians that are all visible, in their own order: for kernels that are
    /// used without a view.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn all(gpu: &Gpu, sort: &Sort, count: usize) -> Result<Self, GpuError> {
        let ranks = Self::new(gpu, sort, count)?;
        let groups = (count as u32 + 1).div_ceil(GROUP);
        let rows = groups.div_ceil(GROUPS_PER_AXIS);
        let groups = [groups.min(GROUPS_PER_AXIS), rows, 1];
        ranks.visible.write(gpu, 0, &[Visible { count: count as u32, groups }]);
        let gaussians: Vec<u32> = (0..count as u32).collect();
        ranks.gaussian_from_rank().write(gpu, 0, &gaussians);
        Ok(ranks)
    }

    /// Gaussians by depth; the first `visible.count` count.
    pub fn gaussian_from_rank(&self) -> &Buffer<u32> {
        &self.sort.values[self.sort.side()]
    }

    /// Runs a kernel with one thread per visible Gaussian, and at least one.
    pub fn run<A: Pod>(
        &self,
        recorder: &mut Recorder<'_>,
        kernel: &Kernel,
        arguments: &A,
        buffers: &[&wgpu::Buffer],
    ) {
        let groups = std::mem::offset_of!(Visible, groups);
        recorder.dispatch_indirect(kernel, arguments, buffers, (&self.visible, groups));
    }

    /// Number of Gaussians that fit.
    pub fn capacity(&self) -> usize {
        self.slots.len() - 1
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        self.sort.device_bytes() + self.slots.size()
    }
}

impl Order {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [flag, compact] = shaders();
        Ok(Self { flag: Kernel::new(gpu, &flag)?, compact: Kernel::new(gpu, &compact)? })
    }

    /// Ranks the first `count` Gaussians that one of two heads shows; with one head, give it twice.
    pub fn rank(
        &self,
        recorder: &mut Recorder<'_>,
        (one, other): (&Projected, &Projected),
        count: usize,
        (ranks, sort): (&Ranks, &Sort),
    ) {
        let arguments = ArrayArguments { count: count as u32, detail: 0 };
        let coverage: [&wgpu::Buffer; 2] = [&one.coverage, &other.coverage];
        let flags: [&wgpu::Buffer; 3] = [coverage[0], coverage[1], &ranks.slots];
        recorder.dispatch_threads(&self.flag, &arguments, &flags, count + 1);
        sort.scan().exclusive(recorder, &ranks.slots, count + 1, &ranks.scan);
        let (keys, gaussians) = (&ranks.sort.keys[0], &ranks.sort.values[0]);
        let buffers: [&wgpu::Buffer; 8] = [
            coverage[0],
            coverage[1],
            &one.splats,
            &other.splats,
            &ranks.slots,
            keys,
            gaussians,
            &ranks.visible,
        ];
        recorder.dispatch_threads(&self.compact, &arguments, &buffers, count + 1);
        sort.sort(recorder, &ranks.sort, &ranks.visible);
    }
}
