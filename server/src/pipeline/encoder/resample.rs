//! Resampling of images. Shrinking uses a triangle filter as wide as the scale, or, without
//! antialiasing, bilinear interpolation. Growing is bilinear. Source and result cover the same
//! area.

use rayon::prelude::*;

/// Source pixels and weights of one destination pixel along an axis. The weights add up to 1.
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

impl Taps {
    fn all(from: usize, to: usize, antialias: bool) -> Vec<Self> {
        let scale = from as f32 / to as f32;
        let radius = if antialias { scale.max(1.0) } else { 1.0 };
        let taps = |at: usize| {
            let center = (at as f32 + 0.5) * scale - 0.5;
            let first = (center - radius).ceil().max(0.0) as usize;
            let last = ((center + radius).floor() as usize).min(from - 1);
            let weight = |source: usize| 1.0 - (source as f32 - center).abs() / radius;
            let mut weights: Vec<f32> = (first..=last).map(weight).collect();
            let sum: f32 = weights.iter().sum();
            weights.iter_mut().for_each(|weight| *weight /= sum);
            Self { first, weights }
        };
        (0..to).map(taps).collect()
    }
}

/// Resamples images, reusing its buffers.
#[derive(Default)]
pub(super) struct Resampler {
    /// The image with resampled columns and unchanged rows.
    narrow: Vec<f32>,
    result: Vec<f32>,
}

impl Resampler {
    /// `[height, width, 3]`, 8 bit, of size `from` to f32 of size `to`; sizes are (width, height).
    pub(super) fn run(
        &mut self,
        rgb: &[u8],
        from: (usize, usize),
        to: (usize, usize),
        antialias: bool,
    ) -> &[f32] {
        let columns = Taps::all(from.0, to.0, antialias);
        self.narrow.resize(from.1 * to.0 * 3, 0.0);
        let rows = self.narrow.par_chunks_exact_mut(to.0 * 3).zip(rgb.par_chunks_exact(from.0 * 3));
        rows.for_each(|(narrow, wide)| {
            for (pixel, taps) in narrow.chunks_exact_mut(3).zip(&columns) {
                let sources = wide[taps.first * 3..].chunks_exact(3);
                let mut sum = [0.0; 3];
                for (&weight, source) in taps.weights.iter().zip(sources) {
                    for (sum, &value) in sum.iter_mut().zip(source) {
                        *sum += weight * f32::from(value);
                    }
                }
                pixel.copy_from_slice(&sum);
            }
        });
        let lines = Taps::all(from.1, to.1, antialias);
        let narrow = &self.narrow;
        self.result.resize(to.1 * to.0 * 3, 0.0);
        self.result.par_chunks_exact_mut(to.0 * 3).zip(&lines).for_each(|(row, taps)| {
            row.fill(0.0);
            let sources = narrow[taps.first * to.0 * 3..].chunks_exact(to.0 * 3);
            for (&weight, source) in taps.weights.iter().zip(sources) {
                row.iter_mut().zip(source).for_each(|(sum, value)| *sum += weight * value);
            }
        });
        &self.result
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::imageops::{FilterType, resize};
    use image::{ImageBuffer, Rgb};

    /// The `image` crate's implementation of the same filter, rounded to 8 bit.
    fn reference(rgb: &[u8], from: (u32, u32), to: (u32, u32), filter: FilterType) -> Vec<f32> {
        let image: ImageBuffer<Rgb<u8>, &[u8]> =
            ImageBuffer::from_raw(from.0, from.1, rgb).unwrap();
        resize(&image, to.0, to.1, filter).into_raw().into_iter().map(f32::from).collect()
    }

    fn furthest(a: &[f32], b: &[f32]) -> f32 {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn shrinking_is_the_triangle_filter() {
        let from = (37, 23);
        let rgb: Vec<u8> = (0..37 * 23 * 3_u32).map(|i| (i * i % 251) as u8).collect();
        for to in [(37, 23), (11, 9), (12, 40), (80, 60)] {
            let found = Resampler::default().run(&rgb, (37, 23), to, true).to_vec();
            let to = (to.0 as u32, to.1 as u32);
            let apart = furthest(&found, &reference(&rgb, from, to, FilterType::Triangle));
            // The reference is rounded to 8 bit.
            assert!(apart < 1.01, "{to:?}: {apart}");
            // Negative control: another filter differs, unless the size is unchanged.
            let nearest = furthest(&found, &reference(&rgb, from, to, FilterType::Nearest));
            assert!(nearest > 20.0 || to == from, "{to:?}: {nearest}");
        }
    }
    /// Computed with `torch.nn.functional.interpolate(torch.arange(6.)[None, None, None] ** 2 * 10,
    /// (1, 4), mode="bilinear", align_corners=False)`, torch 2.15.
    const BILINEAR: [f32; 4] = [2.5, 32.5, 107.5, 227.5];

    #[test]
    fn without_antialiasing_it_is_bilinear() {
        let rgb: Vec<u8> = (0..6_u8).flat_map(|i| [i * i * 10; 3]).collect();
        let mut resampler = Resampler::default();
        let found = |antialias, resampler: &mut Resampler| -> Vec<f32> {
            resampler.run(&rgb, (6, 1), (4, 1), antialias).iter().step_by(3).copied().collect()
        };
        assert!(furthest(&found(false, &mut resampler), &BILINEAR) < 1e-3);
        // Negative control: with antialiasing the result differs. Earlier images have no influence.
        assert!(furthest(&found(true, &mut resampler), &BILINEAR) > 1.0);
        assert!(furthest(&found(false, &mut resampler), &BILINEAR) < 1e-3);
    }
}
