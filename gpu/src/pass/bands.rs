//! Bands of a picture: rows of tiles that are listed, blended and taken back together.
//!
//! A picture has one band as long as the device can bind all of its lists and the records of their
//! hits. Otherwise the bands share the buffers, one after the other. Pictures and gradients are the
//! same to the bit.

use crate::device::{Buffer, Gpu, GpuError, Tier};
use crate::pass::tiles::Hits;
use crate::shader::layout::{MAX_TILES, PassArguments, Row};

/// Room for hits that is made, as a multiple of what a view needed.
pub(super) const HEADROOM: f32 = 1.5;

/// How a picture is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Bands {
    tiles: [u32; 2],
    count: u32,
    capacity: usize,
}

/// What the lists of a picture must hold.
#[derive(Clone, Copy)]
pub(super) struct Demand {
    /// Columns and rows of tiles.
    pub tiles: [u32; 2],
    /// Hits of all tiles together.
    pub hits: usize,
    /// Gaussians of the map.
    pub gaussians: usize,
    /// Rows of the record of a hit.
    pub record_rows: usize,
    /// Most hits of one list.
    pub most: usize,
}

impl Bands {
    /// The fewest bands whose lists the device can bind.
    ///
    /// # Errors
    /// [`GpuError::Limit`] if even the hits of one row of tiles are too many.
    pub fn fewest(gpu: &Gpu, demand: Demand) -> Result<Self, GpuError> {
        let Demand { tiles, hits, .. } = demand;
        for count in 1..=tiles[1] {
            let capacity = hits.div_ceil(count as usize);
            let bands = Self { tiles, count, capacity };
            if capacity <= bands.room(gpu, demand) {
                return Ok(bands);
            }
        }
        // The demand has headroom, which one row of tiles can do without.
        let rows = Self { tiles, count: tiles[1], capacity: hits.div_ceil(tiles[1] as usize) };
        let room = rows.room(gpu, demand);
        if rows.capacity as f32 > HEADROOM * room as f32 {
            let limit = "room for the hits of one row of a picture's tiles";
            let (found, needed) = (room as u64, rows.capacity as u64);
            return Err(GpuError::Limit { limit, found, needed });
        }
        Ok(Self { capacity: room, ..rows })
    }

    /// Most hits that the device can bind for one band.
    fn room(self, gpu: &Gpu, demand: Demand) -> usize {
        let tiles = self.most_tiles();
        if gpu.tier() == Tier::Software && tiles > MAX_TILES {
            return 0;
        }
        let records = Buffer::<Row>::most(gpu) / demand.record_rows;
        demand.most.min(records).min(Hits::most(gpu, demand.gaussians, tiles))
    }

    /// Whether the picture is cut at all.
    pub fn several(self) -> bool {
        self.count > 1
    }

    /// Hits of one band that its lists hold.
    pub fn capacity(self) -> usize {
        self.capacity
    }

    /// Tiles of the largest band.
    pub fn most_tiles(self) -> usize {
        self.tiles[0] as usize * self.tiles[1].div_ceil(self.count) as usize
    }

    /// The arguments of each band, from top to bottom.
    pub fn each(self, view: PassArguments) -> impl Iterator<Item = PassArguments> {
        let Self { count, tiles: [_, rows], .. } = self;
        (0..count).map(move |band| PassArguments {
            band: [band * rows / count, (band + 1) * rows / count],
            bands: count,
            ..view
        })
    }
}
