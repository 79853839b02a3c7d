//! How the pixels of a tile are assigned to the threads of a workgroup ("lanes"), and how the lanes
//! exchange values.
//!
//! A lane owns `strips` strips of four neighbouring pixels in one row of the tile. Where every
//! workgroup is exactly one subgroup, lanes exchange values in registers, elsewhere in workgroup
//! memory. The text of the kernels is the same: they call the functions of
//! `shared/lanes_subgroup.wgsl` or of `shared/lanes_workgroup.wgsl`.

use crate::device::Tier;
use crate::shader::compose::Constant;
use crate::shader::shared::{LANES_SUBGROUP, LANES_WORKGROUP};

/// Bytes of workgroup memory that a batch may fill; WebGPU guarantees 16 KiB.
const BATCH_BYTES: u32 = 14 << 10;
/// Most hits in a batch that the lanes load and exchange together.
const BATCH: u32 = 8;
/// Bytes of a `vec4<f32>`.
const ROW_BYTES: u32 = 16;

/// The threads of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tiling {
    /// Threads per tile, a power of two.
    pub lanes: u32,
    /// Strips of four pixels per lane.
    pub strips: u32,
    /// Lanes side by side in a row of the tile.
    pub columns: u32,
    /// Whether lanes exchange values with subgroup operations.
    pub subgroups: bool,
}

impl Tiling {
    /// Needs nothing beyond WebGPU's baseline: 16x16 pixels, 32 lanes, workgroup memory.
    pub const PORTABLE: Self = Self { lanes: 32, strips: 2, columns: 2, subgroups: false };

    /// The tiling of a tier: one subgroup per tile if subgroups have a fixed size.
    pub fn of(tier: Tier) -> Self {
        let fixed = tier.subgroup().filter(|(min, max)| min == max);
        fixed.and_then(|(lanes, _)| Self::subgroup(lanes)).unwrap_or(Self::PORTABLE)
    }

    /// One subgroup of `lanes` threads per tile; none for widths that no adapter has.
    pub fn subgroup(lanes: u32) -> Option<Self> {
        let (strips, columns) = match lanes {
            4 | 8 => (2, 1),
            16 | 32 => (2, 2),
            64 => (1, 4),
            _ => return None,
        };
        Some(Self { lanes, strips, columns, subgroups: true })
    }

    /// Width and height of a tile, in pixels.
    pub const fn size(&self) -> [u32; 2] {
        [4 * self.strips * self.columns, self.lanes / self.columns]
    }

    /// Columns and rows of tiles of a picture of `width` by `height` pixels.
    pub const fn tiles(&self, [width, height]: [u32; 2]) -> [u32; 2] {
        let [columns, rows] = self.size();
        [width.div_ceil(columns), height.div_ceil(rows)]
    }

    /// WGSL functions to exchange values between lanes.
    pub fn part(&self) -> &'static str {
        if self.subgroups { LANES_SUBGROUP } else { LANES_WORKGROUP }
    }

    /// Constants of a kernel whose lanes exchange `published` rows per hit and sum records of
    /// `record_rows` rows.
    pub fn constants(&self, published: u32, record_rows: u32) -> Vec<(&'static str, Constant)> {
        let rows_per_hit = if self.subgroups { 1 } else { published + record_rows * self.lanes };
        let fits = (BATCH_BYTES / (rows_per_hit * ROW_BYTES)).max(1);
        let batch = BATCH.min(self.lanes).min(1 << fits.ilog2());
        let [width, height] = self.size();
        [
            ("LANES", self.lanes),
            ("STRIPS", self.strips),
            ("COLUMNS", self.columns),
            ("TILE_WIDTH", width),
            ("TILE_HEIGHT", height),
            ("BATCH", batch),
            ("PUBLISHED", published),
            ("RECORD_ROWS", record_rows.max(1)),
            ("FOLDS", batch.ilog2()),
            ("STEPS", self.lanes.ilog2() - batch.ilog2()),
        ]
        .map(|(name, value)| (name, Constant::U32(value)))
        .to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::Tiling;
    use crate::device::Tier;

    #[test]
    fn tiles_are_subgroups_where_the_size_is_fixed() {
        let tiling = |min, max| Tiling::of(Tier::Subgroup { min, max });
        assert_eq!(Tiling::of(Tier::Software).lanes, 8);
        assert!(Tiling::of(Tier::Software).subgroups && tiling(32, 32).subgroups);
        assert_eq!(tiling(32, 64), Tiling::PORTABLE);
        assert_eq!(Tiling::of(Tier::Portable), Tiling::PORTABLE);
    }

    #[test]
    fn lanes_cover_their_tile() {
        let sizes: Vec<_> = (0..9).filter_map(|power| Tiling::subgroup(1 << power)).collect();
        assert_eq!(sizes.len(), 5, "4, 8, 16, 32, 64");
        for tiling in sizes.into_iter().chain([Tiling::PORTABLE]) {
            let [width, height] = tiling.size();
            assert_eq!(width * height, tiling.lanes * tiling.strips * 4, "{tiling:?}");
            assert!(width % 8 == 0 && height >= 4, "{tiling:?}");
        }
        assert_eq!(Tiling::subgroup(12), None);
        assert_eq!(Tiling::subgroup(128), None);
    }
}
