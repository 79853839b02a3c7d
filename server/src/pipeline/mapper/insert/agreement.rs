//! How well a new keyframe and the map agree where both show the same surface.
//!
//! In: a keyframe's picture and the map rendered from its pose. Out: the gain of each color channel between
//! them, and how much their colors differ once it is removed. A camera that sets its own exposure changes
//! the gain. What remains comes from poses, registration, blur and noise: on rendered frames under 0.01 of
//! the range, on frames of real cameras 0.02 to 0.07. Nothing here changes the map.

use super::super::super::downsampled_frame::DownsampledFrame;
use lexsplat_gpu::ColorImage;
use std::borrow::Cow;

/// About as many pixels are compared.
const SAMPLES: usize = 30_000;
/// Least share of the samples that must show the same surface; below it nothing is known.
const LEAST_SHARE: f32 = 0.05;
/// Pixels that are darker or brighter do not tell the gain.
const GAIN_RANGE: std::ops::Range<f32> = 0.1..0.95;
/// Gains are believed in this range,
const GAINS: [f32; 2] = [0.5, 2.0];
/// and a gain that differs from 1 by less than this is none.
const LEAST_GAIN: f32 = 0.02;
/// The share of the pixels that differ by less than the disagreement. Pixels beyond it are what the map
/// does not have yet.
const QUANTILE: f32 = 0.75;

/// The pixels that show the same surface in both pictures.
pub(super) struct Agreement<'a> {
    rendered: &'a ColorImage,
    pixels: Vec<usize>,
}

impl<'a> Agreement<'a> {
    /// Compares depths: pixels agree if they differ by at most `depth_error` as a share. Depths of
    /// `backdrop_metres` and more are not measured.
    pub fn new(
        image: &DownsampledFrame,
        rendered: &'a ColorImage,
        backdrop_metres: f32,
        depth_error: f32,
    ) -> Self {
        let stride = (image.camera.pixels() / SAMPLES).max(1);
        let samples = (0..image.camera.pixels()).step_by(stride);
        let least = samples.len() as f32 * LEAST_SHARE;
        let agrees = |pixel: &usize| {
            let measured = image.depth_metres[*pixel];
            measured < backdrop_metres && on_surface(rendered, *pixel, measured, depth_error)
        };
        let mut pixels: Vec<usize> = samples.filter(agrees).collect();
        if (pixels.len() as f32) < least {
            pixels.clear();
        }
        Self { rendered, pixels }
    }

    /// The picture in the map's colors.
    pub fn in_map_colors<'i>(&self, image: Cow<'i, DownsampledFrame>) -> Cow<'i, DownsampledFrame> {
        let gains: [f32; 3] = std::array::from_fn(|channel| self.gain(&image, channel));
        if gains == [1.0; 3] {
            return image;
        }
        let changed = |(at, seen): (usize, &u8)| (f32::from(*seen) * gains[at % 3]).round() as u8;
        let rgb = image.rgb.iter().enumerate().map(changed).collect();
        Cow::Owned(DownsampledFrame { rgb, ..image.into_owned() })
    }

    /// The factor that brings a channel of the picture to the map's; 1 if nothing is known.
    fn gain(&self, image: &DownsampledFrame, channel: usize) -> f32 {
        let ratio = |pixel: &usize| {
            let at = pixel * 3 + channel;
            let seen = f32::from(image.rgb[at]) / 255.0;
            GAIN_RANGE.contains(&seen).then(|| self.rendered.rgb[at] / seen)
        };
        let gain = quantile(self.pixels.iter().filter_map(ratio).collect(), 0.5).unwrap_or(1.0);
        if (gain - 1.0).abs() < LEAST_GAIN { 1.0 } else { gain.clamp(GAINS[0], GAINS[1]) }
    }

    /// The upper quartile of the color error of the picture, 0 to 1; 0 if nothing is known.
    pub fn disagreement(&self, image: &DownsampledFrame) -> f32 {
        let error = |pixel: &usize| color_error(image, self.rendered, *pixel, *pixel);
        quantile(self.pixels.iter().map(error).collect(), QUANTILE).unwrap_or(0.0)
    }
}

/// Mean absolute difference of the channels between a pixel that was seen and one that the map shows, 0 to 1.
pub(super) fn color_error(
    image: &DownsampledFrame,
    rendered: &ColorImage,
    seen: usize,
    shown: usize,
) -> f32 {
    let shown = rendered.rgb[shown * 3..shown * 3 + 3].iter();
    let seen = image.rgb[seen * 3..seen * 3 + 3].iter();
    let errors = shown.zip(seen).map(|(shown, seen)| (shown - f32::from(*seen) / 255.0).abs());
    errors.sum::<f32>() / 3.0
}

/// Whether the map is opaque at a pixel and its depth differs from `measured` by at most this share.
pub(super) fn on_surface(
    rendered: &ColorImage,
    pixel: usize,
    measured: f32,
    depth_error: f32,
) -> bool {
    let opacity = rendered.opacity[pixel];
    let depth = rendered.depth[pixel] / opacity;
    opacity > 0.0 && (depth - measured).abs() <= depth_error * measured
}

/// The value that this share of the values is below; `None` if there are none.
fn quantile(mut values: Vec<f32>, share: f32) -> Option<f32> {
    let at = (values.len() as f32 * share) as usize;
    if at >= values.len() {
        return None;
    }
    let (_, value, _) = values.select_nth_unstable_by(at, f32::total_cmp);
    value.is_finite().then_some(*value)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{explained, wall};
    use super::*;

    fn agreement(rendered: &ColorImage) -> Agreement<'_> {
        Agreement::new(&wall(8), rendered, f32::INFINITY, 0.05)
    }

    fn shown(rgb: f32, depth: f32) -> ColorImage {
        ColorImage { rgb: vec![rgb; 192], depth: vec![depth; 64], ..explained() }
    }

    #[test]
    fn a_gain_is_removed_and_no_difference_remains() {
        let wall = wall(8);
        let darker = shown(0.4, 2.0);
        let agreement = agreement(&darker);
        assert!((agreement.disagreement(&wall) - (128.0 / 255.0 - 0.4)).abs() < 1e-6);
        let changed = agreement.in_map_colors(Cow::Borrowed(&wall));
        assert_eq!(changed.rgb[0], 102, "0.4 of 255");
        assert!(agreement.disagreement(&changed) < 1e-6);
    }

    #[test]
    fn nothing_changes_without_a_gain_or_a_common_surface() {
        let wall = wall(8);
        // Negative controls of the test above: the same colors, and another surface in other colors.
        for rendered in [explained(), shown(0.4, 3.0)] {
            let agreement = agreement(&rendered);
            assert_eq!(agreement.in_map_colors(Cow::Borrowed(&wall)).rgb, wall.rgb);
            assert!(agreement.disagreement(&wall) < 1e-6);
        }
        assert!(agreement(&shown(f32::NAN, 2.0)).disagreement(&wall) == 0.0, "a broken picture");
    }

    #[test]
    fn a_quarter_of_the_pixels_may_be_new() {
        let mut rendered = explained();
        rendered.rgb[..3 * 15].fill(1.0);
        assert!(agreement(&rendered).disagreement(&wall(8)) < 1e-6);
        rendered.rgb[..3 * 17].fill(1.0);
        assert!(agreement(&rendered).disagreement(&wall(8)) > 0.4, "more than a quarter");
    }
}
