//! Super-resolution decoder (paper §4.1, "High-Resolution CLIP Embedding"): coarse features and the
//! encoder's skips in, one feature per grid cell out. The architecture is the bundle's.

use super::network::{Network, NetworkError, Tensor};

/// Makes coarse features dense.
pub struct SuperResolution {
    network: Network,
}

impl SuperResolution {
    /// With the bundle's network.
    pub fn new(network: Network) -> Self {
        Self { network }
    }

    /// The encoder's outputs, in the manifest's order, to `[1, D, grid height, grid width]`.
    ///
    /// # Errors
    /// [`NetworkError`] if the network fails.
    pub fn upsample(&mut self, coarse_and_skips: &[Tensor]) -> Result<[Tensor; 1], NetworkError> {
        Ok([self.network.run(coarse_and_skips)?.swap_remove(0)])
    }
}
