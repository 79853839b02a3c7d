//! The kernels that both heads share, and the depth order of the last view.

use crate::device::{Gpu, GpuError};
use crate::map::Gaussians;
use crate::pass::order::{DepthOrder, Ranks};
use crate::pass::projected::Projected;
use crate::pass::tiles::Tiles;
use crate::primitives::sort::Sort;
use crate::shader::Recorder;

/// Orders the visible Gaussians by depth and bins them into tiles.
pub(crate) struct Binning {
    pub(super) sort: Sort,
    pub(super) tiles: Tiles,
    order: DepthOrder,
    ranks: Option<Ranks>,
}

impl Binning {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`crate::shader::Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let (sort, order, tiles) = (Sort::new(gpu)?, DepthOrder::new(gpu)?, Tiles::new(gpu)?);
        Ok(Self { sort, tiles, order, ranks: None })
    }

    /// Makes room to order the Gaussians of a map.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn reserve(&mut self, gpu: &Gpu, gaussians: &Gaussians) -> Result<(), GpuError> {
        let capacity = gaussians.capacity();
        if self.ranks.as_ref().is_none_or(|ranks| ranks.capacity() != capacity) {
            self.ranks = None;
            self.ranks = Some(Ranks::new(gpu, &self.sort, capacity)?);
        }
        Ok(())
    }

    /// Orders the first `count` Gaussians that one of two heads shows. With one head, give it
    /// twice.
    pub fn rank(&self, recorder: &mut Recorder<'_>, heads: [&Projected; 2], count: usize) {
        let [one, other] = heads;
        self.order.rank(recorder, one, other, count, self.ranks(), &self.sort);
    }

    /// The visible Gaussians of the last view.
    pub fn ranks(&self) -> &Ranks {
        self.ranks.as_ref().expect("reserved by the caller")
    }

    /// Bytes of scratch on the device.
    pub fn device_bytes(&self) -> u64 {
        self.ranks.as_ref().map_or(0, Ranks::device_bytes)
    }
}
