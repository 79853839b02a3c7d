//! The result of the projection, which ordering and binning read.

use crate::device::{Buffer, Gpu, GpuError};
use crate::shader::layout::{Coverage, Splat};

/// One head of every Gaussian, projected into one camera.
pub struct Projected {
    /// Written only for Gaussians that cover a tile.
    pub splats: Buffer<Splat>,
    /// Written for all Gaussians.
    pub coverage: Buffer<Coverage>,
    /// In: which tiles of the view are not drawn, 1 for each; the others have 0.
    pub left_out: Buffer<u32>,
}

impl Projected {
    /// Room for `capacity` Gaussians in a view of `tiles` tiles.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(gpu: &Gpu, capacity: usize, tiles: usize) -> Result<Self, GpuError> {
        Ok(Self {
            splats: Buffer::new(gpu, "splats", capacity)?,
            coverage: Buffer::new(gpu, "coverage", capacity)?,
            left_out: Buffer::new(gpu, "tiles left out", tiles)?,
        })
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        self.splats.size() + self.coverage.size() + self.left_out.size()
    }
}
