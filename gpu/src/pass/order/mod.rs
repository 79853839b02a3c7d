//! The visible Gaussians of a view, sorted by depth. The heads share their means, so one sort
//! serves both.
//!
//! In: the projection of one head or of both. Out: the visible Gaussians in the order of the map,
//! the same by depth (equal depths by index), and the permutation between the two orders. A *rank*
//! is a place in the order by depth. Tile lists are made in the order of ranks. Gradients are in
//! the order of the map, where neighbours in memory are read one after the other. A Gaussian that
//! no head shows costs no further work.

use bytemuck::Pod;

use crate::device::{Buffer, Gpu, GpuError};
use crate::pass::projected::Projected;
use crate::primitives::scan::ScanScratch;
use crate::primitives::sort::{Sort, SortBuffers};
use crate::shader::layout::{
    ArrayArguments, DEPTH_SHIFT, FAR, GROUP, GROUPS_PER_AXIS, NEAR, Visible,
};
use crate::shader::{Access, GRID, Kernel, Recorder, Shader};

/// The kernels that pick and sort.
pub struct DepthOrder {
    flag: Kernel,
    compact: Kernel,
    invert: Kernel,
}

/// The visible Gaussians of one view; room for `capacity`.
pub struct Ranks {
    sort: SortBuffers,
    slots: Buffer<u32>,
    scan: ScanScratch,
    /// Number of visible Gaussians.
    pub visible: Buffer<Visible>,
    /// Visible Gaussians in the order of the map. Here and below the first `visible.count` are
    /// valid.
    pub gaussian_from_visible: Buffer<u32>,
    /// Rank of each of these.
    pub rank_from_visible: Buffer<u32>,
    /// Visible Gaussians by depth.
    pub gaussian_from_rank: Buffer<u32>,
}

/// This kernel's shaders.
pub fn shaders() -> [Shader; 3] {
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
        shader("order_invert", include_str!("invert.wgsl"), vec![Read, Read, Read, Write, Write]),
    ]
}

impl Ranks {
    /// Room for `capacity` Gaussians.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(gpu: &Gpu, sort: &Sort, capacity: usize) -> Result<Self, GpuError> {
        let steps = (FAR.to_bits() - NEAR.to_bits()) >> DEPTH_SHIFT;
        let depth_bits = u32::BITS - steps.leading_zeros();
        let indices = |label| Buffer::new(gpu, label, capacity);
        Ok(Self {
            sort: sort.buffers(gpu, capacity, depth_bits)?,
            slots: Buffer::new(gpu, "visible slots", capacity + 1)?,
            scan: sort.scan().scratch(gpu, capacity + 1)?,
            visible: Buffer::new(gpu, "visible", 1)?,
            gaussian_from_visible: indices("gaussian from visible")?,
            rank_from_visible: indices("rank from visible")?,
            gaussian_from_rank: indices("gaussian from rank")?,
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
        for order in
            [&ranks.gaussian_from_visible, &ranks.rank_from_visible, &ranks.gaussian_from_rank]
        {
            order.write(gpu, 0, &gaussians);
        }
        Ok(ranks)
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
        recorder.dispatch_indirect(kernel, arguments, buffers, &self.visible, groups);
    }

    /// Number of Gaussians that fit.
    pub fn capacity(&self) -> usize {
        self.slots.len() - 1
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        self.sort.device_bytes() + self.slots.size() + 3 * self.gaussian_from_rank.size()
    }
}

impl DepthOrder {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [flag, compact, invert] = shaders();
        Ok(Self {
            flag: Kernel::new(gpu, &flag)?,
            compact: Kernel::new(gpu, &compact)?,
            invert: Kernel::new(gpu, &invert)?,
        })
    }

    /// Sorts the first `count` Gaussians that one of two heads shows. With one head, give it twice.
    pub fn rank(
        &self,
        recorder: &mut Recorder<'_>,
        one: &Projected,
        other: &Projected,
        count: usize,
        ranks: &Ranks,
        sort: &Sort,
    ) {
        let arguments = ArrayArguments { count: count as u32, detail: 0 };
        let coverage: [&wgpu::Buffer; 2] = [&one.coverage, &other.coverage];
        let flags: [&wgpu::Buffer; 3] = [coverage[0], coverage[1], &ranks.slots];
        recorder.dispatch_threads(&self.flag, &arguments, &flags, count + 1);
        sort.scan().exclusive(recorder, &ranks.slots, count + 1, &ranks.scan);
        let buffers: [&wgpu::Buffer; 8] = [
            coverage[0],
            coverage[1],
            &one.splats,
            &other.splats,
            &ranks.slots,
            &ranks.sort.keys[0],
            &ranks.gaussian_from_visible,
            &ranks.visible,
        ];
        recorder.dispatch_threads(&self.compact, &arguments, &buffers, count + 1);
        let sorted = sort.sort_indices(recorder, &ranks.sort, &ranks.visible);
        let buffers: [&wgpu::Buffer; 5] = [
            &ranks.visible,
            sorted,
            &ranks.gaussian_from_visible,
            &ranks.rank_from_visible,
            &ranks.gaussian_from_rank,
        ];
        ranks.run(recorder, &self.invert, &arguments, &buffers);
    }
}
