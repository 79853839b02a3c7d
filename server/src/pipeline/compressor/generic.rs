//! The first, pre-trained stage (paper §4.2, "Two-Stage Online CLIP Compression"): features of size D
//! to codes of 32 and back. Both are the bundle's networks.

use super::super::network::{Network, NetworkError, Tensor};
use super::{GENERIC, normalise_rows};

/// Codes decoded in one run of the network: bounds its memory.
const DECODE_BATCH: usize = 4096;

/// Features -> generic codes.
pub struct GenericEncoder {
    network: Network,
}

/// Generic codes of a grid.
pub struct CodeGrid {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// `[height * width * 32]`, row-major, unit length.
    pub codes: Vec<f32>,
}

impl GenericEncoder {
    /// With the bundle's network.
    pub fn new(network: Network) -> Self {
        Self { network }
    }

    /// `[1, D, height, width]` -> codes of every cell.
    ///
    /// # Errors
    /// [`NetworkError`] if the network fails.
    pub fn compress(&mut self, features: &[Tensor; 1]) -> Result<CodeGrid, NetworkError> {
        Ok(grid_of(&self.network.run(features)?[0]))
    }
}

/// Planes `[1, 32, height, width]` as rows of unit length.
pub fn grid_of(planes: &Tensor) -> CodeGrid {
    let shape = planes.shape();
    let (height, width) = (shape[2], shape[3]);
    let planes = planes.as_floats();
    let cells = height * width;
    let mut codes = vec![0.0; cells * GENERIC];
    for (cell, code) in codes.chunks_exact_mut(GENERIC).enumerate() {
        for (channel, value) in code.iter_mut().enumerate() {
            *value = planes[channel * cells + cell];
        }
    }
    normalise_rows(&mut codes, GENERIC);
    CodeGrid { height, width, codes }
}

/// Generic codes -> features.
pub struct GenericDecoder {
    network: Network,
}

impl GenericDecoder {
    /// With the bundle's network.
    pub fn new(network: Network) -> Self {
        Self { network }
    }

    /// `[n, 32]` -> `[n, D]`, unit length; `each` gets every batch in turn.
    ///
    /// # Errors
    /// [`NetworkError`] if the network fails.
    pub fn decompress(
        &mut self,
        codes: &[f32],
        mut each: impl FnMut(&[f32]),
    ) -> Result<(), NetworkError> {
        for batch in codes.chunks(DECODE_BATCH * GENERIC) {
            let rows = batch.len() / GENERIC;
            let input = Tensor::floats(&[rows, GENERIC], batch.to_vec());
            each(&self.network.run(&[input])?[0].as_floats());
        }
        Ok(())
    }
}
