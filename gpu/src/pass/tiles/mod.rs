//! Tile lists from projected Gaussians. A *hit* is a (Gaussian, tile) pair where the Gaussian may
//! be visible in the tile. Hits are grouped by tile and are in depth order inside a tile.
//!
//! The hits of a Gaussian have consecutive *slots*, in depth order over Gaussians. Lists hold
//! slots, so the backward blend can write one record per slot and needs no atomics. If there are
//! more hits than slots, the rest is dropped, [`HitCount`] reports it, and the pass must be
//! repeated. The lists are those of one band of the picture.
//!
//! Grouping is a stable sort by tile (`sorted.rs`). On a processor it counts instead
//! (`counted.rs`): each thread goes through a run of hits twice, and no keys are written and
//! sorted.

use crate::device::{Buffer, Gpu, GpuError};
use crate::pass::order::Ranks;
use crate::pass::projected::Projected;
use crate::primitives::scan::ScanScratch;
use crate::primitives::sort::{Sort, SortShape};
use crate::shader::layout::{Coverage, HitCount, PassArguments};
use crate::shader::{
    Access, CONIC, COVERED, Constant, EXTENT, GRID, Kernel, Recorder, Shader, Tiling,
};

mod counted;
mod sorted;

/// Counts hits over the bands; both ways of grouping do it.
const TALLY: &str = include_str!("tally.wgsl");

/// The kernels that make lists.
pub struct Tiles {
    rank: Kernel,
    group: Group,
}

/// The two ways of grouping.
enum Group {
    Sorted(sorted::Sorted),
    Counted(counted::Counted),
}

/// The lists of one head.
pub struct Hits {
    tiles: [usize; 2],
    scan: ScanScratch,
    group: GroupBuffers,
    /// Which tiles each rank hits.
    coverage_from_rank: Buffer<Coverage>,
    /// First slot of each rank; one more element than Gaussians.
    pub slot_from_rank: Buffer<u32>,
    /// Gaussian of each hit, by tile, then by depth.
    pub gaussian_from_sorted: Buffer<u32>,
    /// First and end of each tile's list. The lists of the last band are there, and of the bands
    /// above their lengths.
    pub ranges: Buffer<[u32; 2]>,
    /// Number of hits.
    pub count: Buffer<HitCount>,
}

enum GroupBuffers {
    Sorted(sorted::Keys),
    Counted(counted::Table),
}

/// A view with projected and ordered Gaussians.
#[derive(Clone, Copy)]
struct View<'a> {
    arguments: &'a PassArguments,
    projected: &'a Projected,
    ranks: &'a Ranks,
    sort: &'a Sort,
}

/// This kernel's shaders.
pub fn shaders(tiling: Tiling, shape: SortShape) -> Vec<Shader> {
    let rank = Shader {
        label: "tiles_rank",
        entry: "main",
        parts: vec![GRID, CONIC, EXTENT, COVERED, include_str!("rank.wgsl")],
        constants: tiling.constants(1, 1),
        bindings: [[Access::Read; 5].as_slice(), &[Access::Write; 2]].concat(),
    };
    let group_size = ("SORT_GROUP", Constant::U32(shape.group));
    let mut constants = tiling.constants(1, 1);
    constants.push(group_size);
    let shader = |label, parts, bindings| Shader {
        label,
        entry: "main",
        parts,
        constants: constants.clone(),
        bindings,
    };
    [rank].into_iter().chain(sorted::shaders(&shader)).chain(counted::shaders(&shader)).collect()
}

/// Makes a shader from label, parts and bindings.
type Compose<'a> = dyn Fn(&'static str, Vec<&'static str>, Vec<Access>) -> Shader + 'a;

impl Hits {
    /// Room for `capacity` hits of `gaussians` Gaussians in a band of `band_tiles` of `tiles` tiles.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(
        gpu: &Gpu,
        sort: &Sort,
        capacity: usize,
        gaussians: usize,
        [band_tiles, tiles]: [usize; 2],
    ) -> Result<Self, GpuError> {
        let group = if gpu.tier().counts_tiles() {
            GroupBuffers::Counted(counted::Table::new(gpu, sort, capacity, gaussians, band_tiles)?)
        } else {
            GroupBuffers::Sorted(sorted::Keys::new(gpu, sort, capacity, tiles)?)
        };
        Ok(Self {
            tiles: [band_tiles, tiles],
            scan: sort.scan().scratch(gpu, gaussians + 1)?,
            group,
            coverage_from_rank: Buffer::new(gpu, "coverage by rank", gaussians)?,
            slot_from_rank: Buffer::new(gpu, "slots", gaussians + 1)?,
            gaussian_from_sorted: Buffer::new(gpu, "gaussian from sorted", capacity)?,
            ranges: Buffer::new(gpu, "tile ranges", tiles)?,
            count: Buffer::new(gpu, "hit count", 1)?,
        })
    }

    /// Most hits, of `gaussians` Gaussians in a band of `band_tiles` tiles, whose lists the device
    /// can bind.
    pub fn most(gpu: &Gpu, gaussians: usize, band_tiles: usize) -> usize {
        let most = Buffer::<u32>::most(gpu);
        if gpu.tier().counts_tiles() { counted::most(gpu, gaussians, band_tiles) } else { most }
    }

    /// Number of tiles that a band and the picture may have.
    pub fn tiles(&self) -> [usize; 2] {
        self.tiles
    }

    /// Number of hits that fit.
    pub fn capacity(&self) -> usize {
        self.gaussian_from_sorted.len()
    }

    /// Slots by tile, then by depth.
    pub fn slot_from_sorted(&self) -> &Buffer<u32> {
        match &self.group {
            GroupBuffers::Sorted(keys) => keys.slot_from_sorted(),
            GroupBuffers::Counted(table) => &table.slot_from_sorted,
        }
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        let group = match &self.group {
            GroupBuffers::Sorted(keys) => keys.device_bytes(),
            GroupBuffers::Counted(table) => table.device_bytes(),
        };
        group + self.slot_from_rank.size() + self.gaussian_from_sorted.size() + self.ranges.size()
    }
}

impl Tiles {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let shaders = shaders(Tiling::of(gpu.tier()), SortShape::of(gpu.tier()));
        let group = if gpu.tier().counts_tiles() {
            Group::Counted(counted::Counted::new(gpu, &shaders)?)
        } else {
            Group::Sorted(sorted::Sorted::new(gpu, &shaders)?)
        };
        Ok(Self { rank: kernel(gpu, &shaders, "tiles_rank")?, group })
    }

    /// Makes the lists of a band from projected Gaussians and their ranks.
    pub fn list(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &PassArguments,
        projected: &Projected,
        ranks: &Ranks,
        hits: &Hits,
        sort: &Sort,
    ) {
        let count = arguments.count as usize + 1;
        let counted: [&wgpu::Buffer; 7] = [
            &ranks.visible,
            &ranks.gaussian_from_rank,
            &projected.coverage,
            &projected.splats,
            &projected.left_out,
            &hits.slot_from_rank,
            &hits.coverage_from_rank,
        ];
        recorder.dispatch_threads(&self.rank, arguments, &counted, count);
        sort.scan().exclusive(recorder, &hits.slot_from_rank, count, &hits.scan);
        let view = View { arguments, projected, ranks, sort };
        match (&self.group, &hits.group) {
            (Group::Sorted(sorted), GroupBuffers::Sorted(keys)) => {
                sorted.group(recorder, view, hits, keys);
            }
            (Group::Counted(counted), GroupBuffers::Counted(table)) => {
                counted.group(recorder, view, hits, table);
            }
            _ => unreachable!("kernels and buffers are made for the same device"),
        }
    }
}

fn kernel(gpu: &Gpu, shaders: &[Shader], label: &str) -> Result<Kernel, GpuError> {
    let shader = shaders.iter().find(|shader| shader.label == label);
    Kernel::new(gpu, shader.expect("every label is a shader of this kernel"))
}
