//! Brings a keyframe's picture to the colors of the map.
//!
//! In: the picture and the map rendered from its pose. Out: the picture with a gain of each color channel
//! removed. A camera that sets its own exposure and white balance changes these gains; left in, a surface
//! would be inserted again in other colors.

use super::super::super::downsampled_frame::DownsampledFrame;
use super::super::super::quantile::median;
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

/// The factors that bring the channels of the picture to the map's. Pixels tell them where the map's depth
/// differs by at most `depth_error` as a share. Depths of `backdrop_metres` and more are not measured.
pub(super) fn gains(
    image: &DownsampledFrame,
    rendered: &ColorImage,
    backdrop_metres: f32,
    depth_error: f32,
) -> [f32; 3] {
    let pixels = common_pixels(image, rendered, backdrop_metres, depth_error);
    std::array::from_fn(|channel| gain(image, rendered, &pixels, channel))
}

/// The picture with its channels multiplied by gains.
pub(super) fn apply<'i>(
    image: Cow<'i, DownsampledFrame>,
    gains: [f32; 3],
) -> Cow<'i, DownsampledFrame> {
    if gains == [1.0; 3] {
        return image;
    }
    let changed = |(at, seen): (usize, &u8)| (f32::from(*seen) * gains[at % 3]).round() as u8;
    let rgb = image.rgb.iter().enumerate().map(changed).collect();
    Cow::Owned(DownsampledFrame { rgb, ..image.into_owned() })
}

/// The sampled pixels that show the same surface in both pictures; none if they are few.
fn common_pixels(
    image: &DownsampledFrame,
    rendered: &ColorImage,
    backdrop_metres: f32,
    depth_error: f32,
) -> Vec<usize> {
    let stride = (image.camera.pixels() / SAMPLES).max(1);
    let samples = (0..image.camera.pixels()).step_by(stride);
    let least = samples.len() as f32 * LEAST_SHARE;
    let agrees = |pixel: &usize| {
        let measured = image.depth_metres[*pixel];
        measured < backdrop_metres && on_surface(rendered, *pixel, measured, depth_error)
    };
    let pixels: Vec<usize> = samples.filter(agrees).collect();
    if (pixels.len() as f32) < least { Vec::new() } else { pixels }
}

/// The factor that brings a channel of the picture to the map's; 1 if nothing is known.
fn gain(image: &DownsampledFrame, rendered: &ColorImage, pixels: &[usize], channel: usize) -> f32 {
    let ratio = |pixel: &usize| {
        let at = pixel * 3 + channel;
        let seen = f32::from(image.rgb[at]) / 255.0;
        GAIN_RANGE.contains(&seen).then(|| rendered.rgb[at] / seen)
    };
    let mut ratios: Vec<f32> = pixels.iter().filter_map(ratio).collect();
    let gain = median(&mut ratios).unwrap_or(1.0);
    if (gain - 1.0).abs() < LEAST_GAIN { 1.0 } else { gain.clamp(GAINS[0], GAINS[1]) }
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

#[cfg(test)]
mod tests {
    use super::super::tests::{explained, wall};
    use super::*;

    fn shown(rgb: f32, depth: f32) -> ColorImage {
        ColorImage { rgb: vec![rgb; 192], depth: vec![depth; 64], ..explained() }
    }

    fn changed(rendered: &ColorImage) -> u8 {
        let gains = gains(&wall(8), rendered, f32::INFINITY, 0.05);
        apply(Cow::Owned(wall(8)), gains).rgb[0]
    }

    #[test]
    fn a_gain_is_removed_where_both_show_a_surface() {
        assert_eq!(changed(&shown(0.4, 2.0)), 102, "0.4 of 255");
        // Negative controls: the same colors, another surface, a broken picture.
        assert_eq!(changed(&explained()), 128);
        assert_eq!(changed(&shown(0.4, 3.0)), 128);
        assert_eq!(changed(&shown(f32::NAN, 2.0)), 128);
    }
}
