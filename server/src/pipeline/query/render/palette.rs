//! Colors for language codes.

use super::color::to_byte;
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::HostGaussians;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use std::sync::Arc;

/// Codes to which a palette is fitted.
const SAMPLED_CODES: usize = 4096;
/// Standard deviations along a principal direction from grey to full color.
const DEVIATIONS: f32 = 2.0;

/// Colors for codes: their three principal components.
pub(super) struct Palette {
    /// `[code_size]`.
    mean: Vec<f32>,
    /// `[3 * code_size]`, scaled so that [`DEVIATIONS`] deviations are half the range of colors.
    directions: Vec<f32>,
}

/// The palette of the most recent snapshot: all its views have the same colors.
#[derive(Default)]
pub(crate) struct PaletteCache {
    last: Option<(Arc<HostGaussians>, Palette)>,
}

impl PaletteCache {
    pub(super) fn palette(&mut self, snapshot: &MapSnapshot) -> &Palette {
        let is_last = |last: &(Arc<HostGaussians>, _)| Arc::ptr_eq(&last.0, &snapshot.gaussians);
        let kept = self.last.take().filter(is_last);
        let palette = kept.unwrap_or_else(|| {
            let codes = &snapshot.gaussians.language.features;
            (snapshot.gaussians.clone(), Palette::fit(codes, snapshot.online.code_size()))
        });
        &self.last.insert(palette).1
    }
}

impl Palette {
    /// Fits a palette to codes `[n, channels]`. Codes of zeros mean "no language" and do not count.
    fn fit(codes: &[f32], channels: usize) -> Self {
        let has_language = |code: &&[f32]| code.iter().any(|&value| value != 0.0);
        let all: Vec<&[f32]> = codes.chunks_exact(channels).filter(has_language).collect();
        let stride = all.len().div_ceil(SAMPLED_CODES).max(1);
        let sample: Vec<DVector<f64>> = (0..all.len())
            .step_by(stride)
            .map(|at| DVector::from_iterator(channels, all[at].iter().map(|&value| value.into())))
            .collect();
        let count = sample.len().max(1) as f64;
        let mut mean = DVector::zeros(channels);
        sample.iter().for_each(|code| mean += code / count);
        let mut spread = DMatrix::zeros(channels, channels);
        for code in &sample {
            let offset = code - &mean;
            spread.ger(1.0 / count, &offset, &offset, 1.0);
        }
        let eigen = SymmetricEigen::new(spread);
        let mut order: Vec<usize> = (0..channels).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let mut directions = Vec::with_capacity(3 * channels);
        for &at in order.iter().cycle().take(3) {
            let direction = eigen.eigenvectors.column(at);
            let sign = direction[direction.iamax()].signum();
            let deviation = eigen.eigenvalues[at].max(0.0).sqrt().max(1e-6);
            let scale = 0.5 * sign / (f64::from(DEVIATIONS) * deviation);
            directions.extend(direction.iter().map(|&value| (value * scale) as f32));
        }
        Self { mean: mean.iter().map(|&value| value as f32).collect(), directions }
    }

    /// The color of a blended code; black where there is no language.
    pub(super) fn color(&self, code: &[f32], opacity: f32) -> [u8; 3] {
        if opacity <= 0.0 {
            return [0; 3];
        }
        let shares = self.directions.chunks_exact(self.mean.len()).map(|direction| {
            let along = code.iter().zip(&self.mean).zip(direction);
            0.5 + along.map(|((value, mean), d)| (value / opacity - mean) * d).sum::<f32>()
        });
        let mut color = [0; 3];
        for (channel, share) in color.iter_mut().zip(shares) {
            *channel = to_byte(share.clamp(0.0, 1.0) * opacity);
        }
        color
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn different_codes_have_different_colors_and_no_language_is_black() {
        let (a, b, c) = ([1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]);
        let codes = [a, b, c, [0.0; 4]].concat();
        let palette = Palette::fit(&codes, 4);
        let [a, b, c] = [a, b, c].map(|code| palette.color(&code, 1.0).map(i32::from));
        let apart = |x: [i32; 3], y: [i32; 3]| (0..3).map(|i| (x[i] - y[i]).abs()).sum::<i32>();
        assert!(apart(a, b) > 60 && apart(b, c) > 60 && apart(a, c) > 60, "{a:?} {b:?} {c:?}");
        assert_eq!(palette.color(&[0.0; 4], 0.0), [0; 3]);
        // A half-transparent code has the same hue, half as bright.
        let half = palette.color(&[0.5, 0.0, 0.0, 0.0], 0.5).map(i32::from);
        assert!((0..3).all(|i| (2 * half[i] - a[i]).abs() <= 1), "{half:?} {a:?}");
    }

    #[test]
    fn a_map_without_language_has_a_palette() {
        let palette = Palette::fit(&[], 15);
        assert_eq!(palette.color(&[0.0; 15], 0.5), [64; 3]);
    }
}
