//! From splats to lists: every (Gaussian, tile) pair that may matter is a hit; hits are grouped by
//! tile and stay in depth order inside a tile.
//!
//! A Gaussian's hits have consecutive slots, in depth order over Gaussians; the sort carries the
//! slot, so that the backward blend can leave one record per slot and no atomic is needed. When
//! there are more hits than slots, the rest is dropped and [`HitCount`] says so: the pass must be
//! repeated.

use crate::buffer::Buffer;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::kernel::{Kernel, Recorder};
use crate::layout::{HitCount, PassArguments};
use crate::order::Ranks;
use crate::project::Projected;
use crate::scan::ScanScratch;
use crate::shader::{Access, EXTENT, GRID, Shader};
use crate::sort::{Sort, SortBuffers};
use crate::tiling::Tiling;

/// The kernels that make lists.
pub struct Tiles {
    rank: Kernel,
    emit: Kernel,
    ranges: Kernel,
}

/// The lists of one head.
pub struct Hits {
    sort: SortBuffers,
    scan: ScanScratch,
    /// First slot of each rank; one more element than Gaussians.
    pub slot_from_rank: Buffer<u32>,
    /// Gaussian of each slot.
    pub gaussian_from_slot: Buffer<u32>,
    /// First and end of each tile's list.
    pub ranges: Buffer<[u32; 2]>,
    /// How many there are.
    pub count: Buffer<HitCount>,
}

/// This kernel's shaders.
pub fn shaders(tiling: Tiling) -> [Shader; 3] {
    use Access::{Read, Write};
    let shader = |label, parts, bindings| Shader {
        label,
        entry: "main",
        parts,
        constants: tiling.constants(1, 1),
        bindings,
    };
    [
        shader("tiles_rank", vec![GRID, include_str!("rank.wgsl")], vec![Read, Read, Read, Write]),
        shader(
            "tiles_emit",
            vec![GRID, EXTENT, include_str!("emit.wgsl")],
            vec![Read, Read, Read, Read, Write, Write, Write, Write],
        ),
        shader("tiles_ranges", vec![GRID, include_str!("ranges.wgsl")], vec![Read, Read, Write]),
    ]
}

impl Hits {
    /// Room for `capacity` hits of `gaussians` Gaussians in `tiles` tiles.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(
        gpu: &Gpu,
        sort: &Sort,
        capacity: usize,
        (gaussians, tiles): (usize, usize),
    ) -> Result<Self, GpuError> {
        // One key more than tiles: the tile that does not exist.
        let key_bits = u32::BITS - (tiles as u32).leading_zeros();
        Ok(Self {
            sort: sort.buffers(gpu, capacity, key_bits)?,
            scan: sort.scan().scratch(gpu, gaussians + 1)?,
            slot_from_rank: Buffer::new(gpu, "slots", gaussians + 1)?,
            gaussian_from_slot: Buffer::new(gpu, "gaussian from slot", capacity)?,
            ranges: Buffer::new(gpu, "tile ranges", tiles)?,
            count: Buffer::new(gpu, "hit count", 1)?,
        })
    }

    /// Number of hits that fit.
    pub fn capacity(&self) -> usize {
        self.gaussian_from_slot.len()
    }

    /// Slots by tile, then by depth.
    pub fn slot_from_sorted(&self) -> &Buffer<u32> {
        &self.sort.values[self.sort.side()]
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        self.sort.device_bytes()
            + self.slot_from_rank.size()
            + self.gaussian_from_slot.size()
            + self.ranges.size()
    }
}

impl Tiles {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [rank, emit, ranges] = shaders(gpu.tiling());
        Ok(Self {
            rank: Kernel::new(gpu, &rank)?,
            emit: Kernel::new(gpu, &emit)?,
            ranges: Kernel::new(gpu, &ranges)?,
        })
    }

    /// Makes the lists of a view from projected Gaussians and their ranks.
    pub fn list(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &PassArguments,
        (projected, ranks): (&Projected, &Ranks),
        (hits, sort): (&Hits, &Sort),
    ) {
        let count = arguments.count as usize + 1;
        let gaussian_from_rank = ranks.gaussian_from_rank();
        let counted: [&wgpu::Buffer; 4] =
            [&ranks.visible, gaussian_from_rank, &projected.coverage, &hits.slot_from_rank];
        recorder.dispatch_threads(&self.rank, arguments, &counted, count);
        sort.scan().exclusive(recorder, &hits.slot_from_rank, count, &hits.scan);
        let emitted: [&wgpu::Buffer; 8] = [
            &projected.splats,
            &projected.coverage,
            gaussian_from_rank,
            &hits.slot_from_rank,
            &hits.sort.keys[0],
            &hits.sort.values[0],
            &hits.gaussian_from_slot,
            &hits.count,
        ];
        ranks.run(recorder, &self.emit, arguments, &emitted);
        sort.sort(recorder, &hits.sort, &hits.count);
        recorder.clear(&hits.ranges);
        let keys = &hits.sort.keys[hits.sort.side()];
        let buffers: [&wgpu::Buffer; 3] = [&hits.count, keys, &hits.ranges];
        let groups = std::mem::offset_of!(HitCount, groups);
        recorder.dispatch_indirect(&self.ranges, arguments, &buffers, (&hits.count, groups));
    }
}
