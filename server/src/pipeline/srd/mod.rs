//! Super-resolution decoder (paper §4.1, "High-Resolution CLIP Embedding").
//!
//! In: coarse features and skip connections of the image encoder. Out: one feature per grid cell.
//! The architecture is the bundle's. The decoder can be replaced by bilinear interpolation of the
//! coarse features, for the paper's ablation.

use super::bilinear;
use super::network::{Network, NetworkError, Tensor};

/// Upsamples coarse features to the grid.
pub(super) struct SuperResolution {
    network: Network,
    /// Rows and columns for bilinear interpolation; `None`: the network runs.
    interpolated_to: Option<[usize; 2]>,
}

impl SuperResolution {
    /// Wraps the bundle's network with its output's rows and columns. If it is not `used`, coarse
    /// features are interpolated instead.
    pub(super) fn new(network: Network, grid: [usize; 2], used: bool) -> Self {
        Self { network, interpolated_to: (!used).then_some(grid) }
    }

    /// The encoder's outputs, in the manifest's order, to features `[1, D, rows, columns]`.
    ///
    /// # Errors
    /// [`NetworkError`] if the network fails.
    pub(super) fn upsample(
        &mut self,
        coarse_and_skips: &[Tensor],
    ) -> Result<[Tensor; 1], NetworkError> {
        if let Some(grid) = self.interpolated_to {
            return Ok([interpolated(&coarse_and_skips[0], grid)]);
        }
        Ok([self.network.run(coarse_and_skips)?.swap_remove(0)])
    }
}

/// Features `[1, D, h, w]` at another size: bilinear, then scaled to unit length over D.
fn interpolated(coarse: &Tensor, [rows, columns]: [usize; 2]) -> Tensor {
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
    fn coarse_features_are_interpolated_to_unit_length() {
        // Tensors belong to ONNX Runtime: its library must be loaded.
        let _runtime = crate::test_support::engine();
        // Two cells: along the first axis, and along the second, of length 3.
        let coarse = Tensor::floats(&[1, 2, 1, 2], vec![1.0, 0.0, 0.0, 3.0]);
        let dense = interpolated(&coarse, [2, 4]);
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
