//! Grouping by counting: a table with the hits of each run in each tile is scanned, which gives the
//! place of each hit.

use super::{Compose, Hits, TALLY, View, kernel};
use crate::device::{Buffer, Gpu, GpuError};
use crate::primitives::scan::ScanScratch;
use crate::primitives::sort::{Sort, SortShape};
use crate::shader::layout::{LONGEST_LOOP, PassArguments};
use crate::shader::{Access, CONIC, EXTENT, GRID, Kernel, Recorder, Shader};

/// The kernels.
pub(super) struct Counted {
    count: Kernel,
    place: Kernel,
    bounds: Kernel,
    group: u32,
}

/// Hits of each run in each tile, then where they go.
pub(super) struct Table {
    runs: u32,
    cells: Buffer<u32>,
    scan: ScanScratch,
    /// Slots by tile, then by depth.
    pub slot_from_sorted: Buffer<u32>,
}

pub(super) fn shaders(shader: &Compose<'_>) -> [Shader; 3] {
    use Access::{Read, Write};
    let (walk, runs) = (include_str!("walk.wgsl"), include_str!("runs.wgsl"));
    [
        shader(
            "tiles_count",
            vec![GRID, CONIC, EXTENT, walk, runs, TALLY, include_str!("count.wgsl")],
            vec![Read, Read, Read, Read, Write, Write],
        ),
        shader(
            "tiles_place",
            vec![CONIC, EXTENT, walk, runs, include_str!("place.wgsl")],
            vec![Read, Read, Read, Read, Write, Write, Write],
        ),
        shader("tiles_bounds", vec![GRID, include_str!("bounds.wgsl")], vec![Read, Write]),
    ]
}

/// Runs into which hits are cut.
fn runs(gpu: &Gpu, capacity: usize, gaussians: usize) -> usize {
    let longest = capacity.max(gaussians);
    longest.div_ceil(LONGEST_LOOP).max(SortShape::of(gpu.tier()).runs as usize)
}

/// Most hits whose slots and whose table can be bound; none if not even the runs of the Gaussians
/// can.
pub(super) fn most(gpu: &Gpu, gaussians: usize, tiles: usize) -> usize {
    let most = Buffer::<u32>::most(gpu);
    let most_runs = most / tiles;
    if runs(gpu, 0, gaussians) > most_runs { 0 } else { most.min(most_runs * LONGEST_LOOP) }
}

impl Table {
    /// Room for `capacity` hits of `gaussians` Gaussians in `tiles` tiles.
    pub fn new(
        gpu: &Gpu,
        sort: &Sort,
        capacity: usize,
        gaussians: usize,
        tiles: usize,
    ) -> Result<Self, GpuError> {
        let runs = runs(gpu, capacity, gaussians);
        let cells = tiles * runs;
        Ok(Self {
            runs: runs as u32,
            cells: Buffer::new(gpu, "tile table", cells)?,
            scan: sort.scan().scratch(gpu, cells)?,
            slot_from_sorted: Buffer::new(gpu, "slot from sorted", capacity)?,
        })
    }

    pub fn device_bytes(&self) -> u64 {
        self.cells.size() + self.slot_from_sorted.size()
    }
}

impl Counted {
    pub fn new(gpu: &Gpu, shaders: &[Shader]) -> Result<Self, GpuError> {
        Ok(Self {
            count: kernel(gpu, shaders, "tiles_count")?,
            place: kernel(gpu, shaders, "tiles_place")?,
            bounds: kernel(gpu, shaders, "tiles_bounds")?,
            group: SortShape::of(gpu.tier()).group,
        })
    }

    pub fn group(&self, recorder: &mut Recorder<'_>, view: View<'_>, hits: &Hits, table: &Table) {
        let View { arguments, projected, ranks, sort } = view;
        let groups = table.runs.div_ceil(self.group);
        let arguments = &PassArguments { runs: table.runs, ..*arguments };
        let walked: [&wgpu::Buffer; 4] = [
            &projected.splats,
            &hits.coverage_from_rank,
            &ranks.gaussian_from_rank,
            &hits.slot_from_rank,
        ];
        let [splats, coverage, gaussians, slots] = walked;
        recorder.clear(&table.cells);
        let buffers: [&wgpu::Buffer; 6] =
            [splats, coverage, gaussians, slots, &table.cells, &hits.count];
        recorder.dispatch(&self.count, arguments, &buffers, groups);
        let [first, end] = arguments.band;
        let tiles = (arguments.tiles[0] * (end - first)) as usize;
        let cells = tiles * table.runs as usize;
        sort.scan().exclusive(recorder, &table.cells, cells, &table.scan);
        let buffers: [&wgpu::Buffer; 7] = [
            splats,
            coverage,
            gaussians,
            slots,
            &table.cells,
            &table.slot_from_sorted,
            &hits.gaussian_from_sorted,
        ];
        recorder.dispatch(&self.place, arguments, &buffers, groups);
        let buffers: [&wgpu::Buffer; 2] = [&table.cells, &hits.ranges];
        recorder.dispatch_threads(&self.bounds, arguments, &buffers, tiles);
    }
}
