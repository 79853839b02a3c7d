//! Super-resolution decoder (paper §4.1, "High-Resolution CLIP Embedding"): coarse features and the
//! encoder's skips in, one feature per grid cell out. The architecture is the bundle's.
//!
//! Without it, which the paper compares with, the coarse features are stretched.

use super::bilinear;
use super::network::{Network, NetworkError, Tensor};

/// Makes coarse features dense.
pub struct SuperResolution {
    network: Network,
    /// Rows and columns to stretch to instead of running the network.
    stretched_to: Option<[usize; 2]>,
}

impl SuperResolution {
    /// With the bundle's network; `grid`: its rows and columns. If it is not `used`, coarse features
    /// are stretched.
    pub fn new(network: Network, grid: [usize; 2], used: bool) -> Self {
        Self { network, stretched_to: (!used).then_some(grid) }
    }

    /// The encoder's outputs, in the manifest's order, to `[1, D, grid height, grid width]`.
    ///
    /// # Errors
    /// [`NetworkError`] if the network fails.
    pub fn upsample(&mut self, coarse_and_skips: &[Tensor]) -> Result<[Tensor; 1], NetworkError> {
        if let Some(grid) = self.stretched_to {
            return Ok([stretched(&coarse_and_skips[0], grid)]);
        }
        Ok([self.network.run(coarse_and_skips)?.swap_remove(0)])
    }
}

/// Features `[1, D, h, w]` at another size: bilinear, centres of cells at their middle, unit length over D.
fn stretched(coarse: &Tensor, [rows, columns]: [usize; 2]) -> Tensor {
    let shape = coarse.shape();
    let (size, from) = (shape[1], (shape[2], shape[3]));
    let planes = coarse.as_floats();
    let mut dense = Vec::with_capacity(size * rows * columns);
    for plane in planes.chunks_exact(from.0 * from.1) {
        dense.extend(bilinear::resized(plane, (from.1, from.0), (columns, rows)));
    }
    let cells = rows * columns;
    for cell in 0..cells {
        let squared: f32 = (0..size).map(|channel| dense[channel * cells + cell].powi(2)).sum();
        let length = squared.sqrt().max(1e-12);
        (0..size).for_each(|channel| dense[channel * cells + cell] /= length);
    }
    Tensor::floats(&[1, size, rows, columns], dense)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarse_features_are_stretched_and_of_unit_length() {
        // Tensors are ONNX Runtime's: its library must be loaded.
        let _runtime = crate::test_support::engine();
        // Two cells: along the first axis, and along the second, of length 3.
        let coarse = Tensor::floats(&[1, 2, 1, 2], vec![1.0, 0.0, 0.0, 3.0]);
        let dense = stretched(&coarse, [2, 4]);
        assert_eq!(dense.shape(), [1, 2, 2, 4]);
        let planes = dense.as_floats();
        let at =
            |row: usize, column: usize| [planes[row * 4 + column], planes[8 + row * 4 + column]];
        for row in 0..2 {
            assert_eq!((at(row, 0), at(row, 3)), ([1.0, 0.0], [0.0, 1.0]));
            // A quarter of the way: (0.75, 0.75), of unit length.
            let half = std::f32::consts::FRAC_1_SQRT_2;
            let [x, y] = at(row, 1);
            assert!((x - half).abs() < 1e-6 && (y - half).abs() < 1e-6, "{x} {y}");
            // Negative control: three quarters of the way is nearer to the second.
            assert!(at(row, 2)[1] > 0.9);
        }
    }
}
