//! The result of the projection, which ordering and binning read.

use crate::device::{Buffer, Gpu, GpuError};
use crate::shader::layout::{Coverage, Splat};

/// One head of every Gaussian, projected into one camera.
pub struct Projected {
    /// Written only for Gaussians that cover a tile.
    pub splats: Buffer<Splat>,
    /// Written for all Gaussians.
    pub coverage: Buffer<Coverage>,
}

impl Projected {
    /// Room for `capacity` Gaussians.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(gpu: &Gpu, capacity: usize) -> Result<Self, GpuError> {
        Ok(Self {
            splats: Buffer::new(gpu, "splats", capacity)?,
            coverage: Buffer::new(gpu, "coverage", capacity)?,
        })
    }
}
