//! The kernels that rearrange a map.

use crate::device::{Gpu, GpuError};
use crate::map::morton::Morton;
use crate::map::prune::Prune;
use crate::primitives::gather::Gather;
use crate::primitives::sort::Sort;

/// The kernels that rearrange a map. They are compiled at the first use.
pub(super) struct Tools {
    pub(super) gather: Gather,
    pub(super) prune: Prune,
    pub(super) morton: Morton,
    pub(super) sort: Sort,
}

impl Tools {
    pub(super) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            gather: Gather::new(gpu)?,
            prune: Prune::new(gpu)?,
            morton: Morton::new(gpu)?,
            sort: Sort::new(gpu)?,
        })
    }
}
