//! The first, pre-trained stage (paper §4.2, "Two-Stage Online CLIP Compression"): features of D
//! channels to generic codes of 32 and back. Both directions are networks of the bundle.

use super::rows::normalise_rows;
use crate::pipeline::network::{GENERIC_SIZE, Network, NetworkError, Tensor};

/// Codes decoded in one run of the network; limits its memory.
const DECODE_BATCH: usize = 4096;

/// Features -> generic codes.
pub(crate) struct GenericEncoder {
    network: Network,
}

/// Generic codes on a grid.
pub(crate) struct CodeGrid {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// `[height * width * 32]`, row-major, unit length.
    pub codes: Vec<f32>,
}

impl CodeGrid {
    /// From channels-first codes `[1, 32, height, width]`; each code is scaled to unit length.
    pub(crate) fn from_planes(planes: &Tensor) -> Self {
        let shape = planes.shape();
        let (height, width) = (shape[2], shape[3]);
        let planes = planes.as_floats();
        let cells = height * width;
        let mut codes = vec![0.0; cells * GENERIC_SIZE];
        for (cell, code) in codes.chunks_exact_mut(GENERIC_SIZE).enumerate() {
            for (channel, value) in code.iter_mut().enumerate() {
                *value = planes[channel * cells + cell];
            }
        }
        normalise_rows(&mut codes, GENERIC_SIZE);
        Self { height, width, codes }
    }
}

impl GenericEncoder {
    /// Wraps the bundle's network.
    pub(crate) fn new(network: Network) -> Self {
        Self { network }
    }

    /// `[1, D, height, width]` -> the code of each cell.
    ///
    /// # Errors
    /// [`NetworkError`] if the network fails.
    pub(crate) fn compress(&mut self, features: &[Tensor; 1]) -> Result<CodeGrid, NetworkError> {
        Ok(CodeGrid::from_planes(&self.network.run(features)?[0]))
    }
}

/// Generic codes -> features.
pub(crate) struct GenericDecoder {
    network: Network,
}

impl GenericDecoder {
    /// Wraps the bundle's network.
    pub(crate) fn new(network: Network) -> Self {
        Self { network }
    }

    /// `[n, 32]` -> `[n, D]`, unit length. `each` is called with each batch of features, in order.
    ///
    /// # Errors
    /// [`NetworkError`] if the network fails.
    pub(crate) fn decompress(
        &mut self,
        codes: &[f32],
        mut each: impl FnMut(&[f32]),
    ) -> Result<(), NetworkError> {
        for batch in codes.chunks(DECODE_BATCH * GENERIC_SIZE) {
            let rows = batch.len() / GENERIC_SIZE;
            let input = Tensor::floats(&[rows, GENERIC_SIZE], batch.to_vec());
            each(&self.network.run(&[input])?[0].as_floats());
        }
        Ok(())
    }
}
