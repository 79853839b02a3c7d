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
use crate::layout::{HitCount, PassArguments, Splat};
use crate::scan::ScanScratch;
use crate::shader::{Access, GRID, Shader};
use crate::sort::{Sort, SortBuffers};

/// The kernels that make lists.
pub struct Tiles {
    rank: Kernel,
    emit: Kernel,
    ranges: Kernel,
}

/// Per Gaussian, what the lists are made from; for up to `capacity` Gaussians.
pub struct Ranks {
    /// Projected Gaussians.
    pub splats: Buffer<Splat>,
    /// Depth keys and, as payload, Gaussians: after the sort side 0 is `gaussian_from_rank`.
    pub sort: SortBuffers,
    /// Hits of each Gaussian.
    pub hits: Buffer<u32>,
    /// First slot of each rank; one more element than Gaussians.
    pub slot_from_rank: Buffer<u32>,
    /// The number of Gaussians, for the sort.
    pub count: Buffer<u32>,
    scan: ScanScratch,
}

/// The lists; for up to `capacity` hits.
pub struct Hits {
    /// Tile keys and, as payload, slots: after the sort side 0 is `slot_from_sorted`.
    pub sort: SortBuffers,
    /// Gaussian of each slot.
    pub gaussian_from_slot: Buffer<u32>,
    /// Gaussian of each hit in its tile's list.
    pub gaussian_from_sorted: Buffer<u32>,
    /// How many there are.
    pub count: Buffer<HitCount>,
}

/// This kernel's shaders.
pub fn shaders() -> [Shader; 3] {
    use Access::{Read, Write};
    let shader = |label, parts, bindings| Shader {
        label,
        entry: "main",
        parts,
        constants: Vec::new(),
        bindings,
    };
    let extent = include_str!("../shared/extent.wgsl");
    [
        shader("tiles_rank", vec![GRID, include_str!("rank.wgsl")], vec![Read, Read, Write]),
        shader(
            "tiles_emit",
            vec![GRID, extent, include_str!("emit.wgsl")],
            vec![Read, Read, Read, Write, Write, Write, Write, Write],
        ),
        shader(
            "tiles_ranges",
            vec![GRID, include_str!("ranges.wgsl")],
            vec![Read, Read, Read, Read, Write, Write],
        ),
    ]
}

impl Ranks {
    /// Room for `capacity` Gaussians.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(gpu: &Gpu, sort: &Sort, capacity: usize) -> Result<Self, GpuError> {
        Ok(Self {
            splats: Buffer::new(gpu, "splats", capacity)?,
            sort: sort.buffers(gpu, capacity)?,
            hits: Buffer::new(gpu, "hits per gaussian", capacity)?,
            slot_from_rank: Buffer::new(gpu, "slots", capacity + 1)?,
            count: Buffer::new(gpu, "gaussian count", 1)?,
            scan: sort.scan().scratch(gpu, capacity + 1)?,
        })
    }
}

impl Hits {
    /// Room for `capacity` hits.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(gpu: &Gpu, sort: &Sort, capacity: usize) -> Result<Self, GpuError> {
        Ok(Self {
            sort: sort.buffers(gpu, capacity)?,
            gaussian_from_slot: Buffer::new(gpu, "gaussian from slot", capacity)?,
            gaussian_from_sorted: Buffer::new(gpu, "gaussian from sorted", capacity)?,
            count: Buffer::new(gpu, "hit count", 1)?,
        })
    }
}

impl Tiles {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [rank, emit, ranges] = shaders();
        Ok(Self {
            rank: Kernel::new(gpu, &rank)?,
            emit: Kernel::new(gpu, &emit)?,
            ranges: Kernel::new(gpu, &ranges)?,
        })
    }

    /// Makes the lists of a view from projected Gaussians. `ranges` gets, for every tile, the first
    /// and the end of its list.
    pub fn list(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &PassArguments,
        (ranks, hits, ranges): (&Ranks, &Hits, &Buffer<[u32; 2]>),
        sort: &Sort,
    ) {
        let count = arguments.count as usize;
        let tiles = arguments.tiles[0] * arguments.tiles[1];
        sort.sort(recorder, &ranks.sort, &ranks.count, u32::BITS);
        let gaussian_from_rank = &ranks.sort.values[0];
        recorder.dispatch_threads(
            &self.rank,
            arguments,
            &[gaussian_from_rank, &ranks.hits, &ranks.slot_from_rank],
            count + 1,
        );
        sort.scan().exclusive(recorder, &ranks.slot_from_rank, count + 1, &ranks.scan);
        recorder.dispatch_threads(
            &self.emit,
            arguments,
            &[
                &ranks.splats,
                gaussian_from_rank,
                &ranks.slot_from_rank,
                &ranks.hits,
                &hits.sort.keys[0],
                &hits.sort.values[0],
                &hits.gaussian_from_slot,
                &hits.count,
            ],
            count + 1,
        );
        sort.sort(recorder, &hits.sort, &hits.count, u32::BITS - tiles.leading_zeros());
        recorder.clear(ranges);
        recorder.dispatch_threads(
            &self.ranges,
            arguments,
            &[
                &hits.count,
                &hits.sort.keys[0],
                &hits.sort.values[0],
                &hits.gaussian_from_slot,
                &hits.gaussian_from_sorted,
                ranges,
            ],
            hits.sort.capacity(),
        );
    }
}
