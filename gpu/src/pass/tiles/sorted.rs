//! Grouping by a stable sort: a key per hit.

use super::{Compose, Hits, TALLY, View, kernel};
use crate::device::{Buffer, Gpu, GpuError};
use crate::primitives::sort::{Sort, SortBuffers};
use crate::shader::layout::HitCount;
use crate::shader::{Access, CONIC, EXTENT, GRID, Kernel, Recorder, Shader};

/// The kernels.
pub(super) struct Sorted {
    emit: Kernel,
    ranges: Kernel,
}

/// Tiles as keys, slots as payload.
pub(super) struct Keys {
    sort: SortBuffers,
    gaussian_from_slot: Buffer<u32>,
}

pub(super) fn shaders(shader: &Compose<'_>) -> [Shader; 2] {
    use Access::{Read, Write};
    [
        shader(
            "tiles_emit",
            vec![GRID, CONIC, EXTENT, include_str!("walk.wgsl"), TALLY, include_str!("emit.wgsl")],
            vec![Read, Read, Read, Read, Write, Write, Write, Write],
        ),
        shader(
            "tiles_ranges",
            vec![GRID, include_str!("ranges.wgsl")],
            vec![Read, Read, Read, Read, Write, Write],
        ),
    ]
}

impl Keys {
    /// Room for `capacity` hits in `tiles` tiles.
    pub fn new(gpu: &Gpu, sort: &Sort, capacity: usize, tiles: usize) -> Result<Self, GpuError> {
        // One key more than tiles: the tile that does not exist.
        let key_bits = u32::BITS - (tiles as u32).leading_zeros();
        Ok(Self {
            sort: sort.buffers(gpu, capacity, key_bits)?,
            gaussian_from_slot: Buffer::new(gpu, "gaussian from slot", capacity)?,
        })
    }

    pub fn slot_from_sorted(&self) -> &Buffer<u32> {
        &self.sort.values[self.sort.side()]
    }

    pub fn device_bytes(&self) -> u64 {
        self.sort.device_bytes() + self.gaussian_from_slot.size()
    }
}

impl Sorted {
    pub fn new(gpu: &Gpu, shaders: &[Shader]) -> Result<Self, GpuError> {
        Ok(Self {
            emit: kernel(gpu, shaders, "tiles_emit")?,
            ranges: kernel(gpu, shaders, "tiles_ranges")?,
        })
    }

    pub fn group(&self, recorder: &mut Recorder<'_>, view: View<'_>, hits: &Hits, keys: &Keys) {
        let View { arguments, projected, ranks, sort } = view;
        let emitted: [&wgpu::Buffer; 8] = [
            &projected.splats,
            &hits.coverage_from_rank,
            &ranks.gaussian_from_rank,
            &hits.slot_from_rank,
            &keys.sort.keys[0],
            &keys.sort.values[0],
            &keys.gaussian_from_slot,
            &hits.count,
        ];
        ranks.run(recorder, &self.emit, arguments, &emitted);
        sort.sort(recorder, &keys.sort, &hits.count);
        if arguments.band[0] == 0 {
            recorder.clear(&hits.ranges);
        }
        let tiles = &keys.sort.keys[keys.sort.side()];
        let buffers: [&wgpu::Buffer; 6] = [
            &hits.count,
            tiles,
            keys.slot_from_sorted(),
            &keys.gaussian_from_slot,
            &hits.gaussian_from_sorted,
            &hits.ranges,
        ];
        let groups = std::mem::offset_of!(HitCount, groups);
        recorder.dispatch_indirect(&self.ranges, arguments, &buffers, &hits.count, groups);
    }
}
