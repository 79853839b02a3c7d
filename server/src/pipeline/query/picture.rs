//! Pictures of a map: color, depth, opacity, and codes as colors.

use super::answer::Picture;
use super::request::{Channel, RenderRequest, View};
use super::scene::Scene;
use super::{QueryError, viewpoint};
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::{Camera, ColorImage, HostGaussians};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use std::sync::Arc;

/// Opacity below which a pixel has no depth.
const LEAST_OPACITY: f32 = 0.5;
/// Codes that the colors of codes are fitted to.
const SAMPLED_CODES: usize = 4096;
/// Standard deviations along a principal direction from grey to full color.
const DEVIATIONS: f32 = 2.0;

/// Renders what was asked for.
pub(super) fn render(
    scene: &mut Scene,
    palette: &mut PaletteCache,
    snapshot: &MapSnapshot,
    request: &RenderRequest,
) -> Result<Picture, QueryError> {
    let camera = viewpoint::resized(viewpoint::camera(snapshot, &request.view)?, request.size)?;
    let rgb = |data: Vec<u8>| Picture::Rgb { width: camera.width, height: camera.height, data };
    Ok(match request.channel {
        Channel::Color => {
            let image = scene.color(snapshot, &camera)?;
            let [a, b] = exposure(snapshot, &request.view);
            rgb(image.rgb.iter().map(|&value| byte(a.exp() * value + b)).collect())
        }
        Channel::Opacity => {
            let image = scene.color(snapshot, &camera)?;
            rgb(image.opacity.iter().flat_map(|&value| [byte(value); 3]).collect())
        }
        Channel::Depth => {
            let metres = depth(&scene.color(snapshot, &camera)?, LEAST_OPACITY);
            Picture::Depth { width: camera.width, height: camera.height, metres }
        }
        Channel::Language => rgb(language(scene, palette, snapshot, &camera)?),
    })
}

/// (a, b) of a tracked frame, whose picture is rendered as bright as it was; none of another view.
fn exposure(snapshot: &MapSnapshot, view: &View) -> [f32; 2] {
    match view {
        View::Frame(sequence) => {
            snapshot.tracked(*sequence).map_or([0.0; 2], |frame| frame.exposure)
        }
        View::Camera { .. } => [0.0; 2],
    }
}

/// 0..1 to 0..255; what is beyond, or no number, is clamped.
fn byte(value: f32) -> u8 {
    (value * 255.0).round() as u8
}

/// Mean depth of what a pixel shows, metres; 0 where it shows less than `least_opacity`.
pub(super) fn depth(image: &ColorImage, least_opacity: f32) -> Vec<f32> {
    let pixel = |(&depth, &opacity): (&f32, &f32)| {
        if opacity > least_opacity { depth / opacity } else { 0.0 }
    };
    image.depth.iter().zip(&image.opacity).map(pixel).collect()
}

fn language(
    scene: &mut Scene,
    palette: &mut PaletteCache,
    snapshot: &MapSnapshot,
    camera: &Camera,
) -> Result<Vec<u8>, QueryError> {
    let palette = palette.of(snapshot);
    let image = scene.language(snapshot, camera)?;
    let channels = snapshot.online.code_size();
    let pixels = image.codes.chunks_exact(channels).zip(&image.opacity);
    Ok(pixels.flat_map(|(code, &opacity)| palette.color(code, opacity)).collect())
}

/// Three principal directions of a map's codes.
pub(super) struct Palette {
    /// `[code_size]`.
    mean: Vec<f32>,
    /// Three times `[code_size]`, scaled so that [`DEVIATIONS`] deviations are half the range.
    directions: Vec<f32>,
}

/// The palette of the snapshot that was rendered last: all its views have the same colors.
#[derive(Default)]
pub(super) struct PaletteCache {
    last: Option<(Arc<HostGaussians>, Palette)>,
}

impl PaletteCache {
    fn of(&mut self, snapshot: &MapSnapshot) -> &Palette {
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
    /// Fitted to codes `[n, channels]`; those of all zeros have no language and do not count.
    fn fit(codes: &[f32], channels: usize) -> Self {
        let coded = |code: &&[f32]| code.iter().any(|&value| value != 0.0);
        let all: Vec<&[f32]> = codes.chunks_exact(channels).filter(coded).collect();
        let stride = all.len().div_ceil(SAMPLED_CODES).max(1);
        let some: Vec<DVector<f64>> = (0..all.len())
            .step_by(stride)
            .map(|at| DVector::from_iterator(channels, all[at].iter().map(|&value| value.into())))
            .collect();
        let count = some.len().max(1) as f64;
        let mut mean = DVector::zeros(channels);
        some.iter().for_each(|code| mean += code / count);
        let mut spread = DMatrix::zeros(channels, channels);
        for code in &some {
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

    /// A blended code's color; black where nothing is.
    fn color(&self, code: &[f32], opacity: f32) -> [u8; 3] {
        if opacity <= 0.0 {
            return [0; 3];
        }
        let shares = self.directions.chunks_exact(self.mean.len()).map(|direction| {
            let along = code.iter().zip(&self.mean).zip(direction);
            0.5 + along.map(|((value, mean), d)| (value / opacity - mean) * d).sum::<f32>()
        });
        let mut color = [0; 3];
        for (channel, share) in color.iter_mut().zip(shares) {
            *channel = byte(share.clamp(0.0, 1.0) * opacity);
        }
        color
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_the_mean_of_what_is_shown() {
        let image = ColorImage {
            width: 3,
            height: 1,
            rgb: vec![0.0; 9],
            depth: vec![1.6, 0.2, 0.0],
            opacity: vec![0.8, 0.4, 0.0],
        };
        assert_eq!(depth(&image, 0.5), [2.0, 0.0, 0.0]);
    }

    #[test]
    fn bytes_are_clamped() {
        assert_eq!([-1.0, 0.0, 0.5, 1.0, 7.0, f32::NAN].map(byte), [0, 0, 128, 255, 255, 0]);
    }

    #[test]
    fn different_codes_have_different_colors_and_nothing_is_black() {
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
