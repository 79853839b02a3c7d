//! How much a new keyframe and an earlier one disagree about the colors of the same surfaces.
//!
//! In: the training images of two keyframes with their poses. Out: a share of the color range. It comes from
//! errors of poses, registration, blur and noise: up to 0.0095 on rendered frames, with a simulated sensor or
//! without, and 0.007 to 0.05 on frames of real cameras. The map takes no part, so its age does not matter:
//! a map with few steps is blurred and differs from every picture.

use super::super::super::downsampled_frame::DownsampledFrame;
use super::super::super::quantile::median;

/// About as many pixels are compared.
const SAMPLES: usize = 4000;
/// Least share of them that both keyframes must show; below it nothing is known.
const LEAST_SHARE: f32 = 0.1;
/// The newest keyframes that may be compared with.
const KEYFRAMES: usize = 4;
/// Pixels that are darker do not tell the gain.
const LEAST_INTENSITY: f32 = 0.1;

/// The median color error between a new keyframe and the newest keyframe that shares surfaces with it, 0 to
/// 1; 0 if there is none. A gain of each color channel is removed first. A higher quantile would take small
/// images for noisy ones: they consist of edges, which differ when pixels are averaged.
pub(super) fn disagreement<'a>(
    image: &DownsampledFrame,
    keyframes: impl DoubleEndedIterator<Item = &'a DownsampledFrame>,
) -> f32 {
    keyframes.rev().take(KEYFRAMES).find_map(|keyframe| between(image, keyframe)).unwrap_or(0.0)
}

/// As [`disagreement`], with one keyframe; `None` if it shows too little of the same surfaces.
fn between(image: &DownsampledFrame, keyframe: &DownsampledFrame) -> Option<f32> {
    let stride = (image.camera.pixels() / SAMPLES).max(1);
    let samples = (0..image.camera.pixels()).step_by(stride);
    let least = samples.len() as f32 * LEAST_SHARE;
    let pair = |pixel| {
        let shown = keyframe.color_at(&image.point(pixel)?)?;
        Some((image.color(pixel), shown))
    };
    let pairs: Vec<([f32; 3], [f32; 3])> = samples.filter_map(pair).collect();
    if (pairs.len() as f32) < least {
        return None;
    }
    let gain = |channel: usize| {
        let usable = pairs.iter().filter(|(seen, _)| seen[channel] > LEAST_INTENSITY);
        let ratios = usable.map(|(seen, shown)| shown[channel] / seen[channel]);
        median(&mut ratios.collect::<Vec<f32>>()).unwrap_or(1.0)
    };
    let gains: [f32; 3] = std::array::from_fn(gain);
    let error = |(seen, shown): &([f32; 3], [f32; 3])| {
        (0..3).map(|at| (seen[at] * gains[at] - shown[at]).abs()).sum::<f32>() / 3.0
    };
    median(&mut pairs.iter().map(error).collect::<Vec<f32>>())
}

#[cfg(test)]
mod tests {
    use super::super::tests::wall;
    use super::*;
    use nalgebra::Isometry3;

    /// A wall with vertical stripes, seen from `pixels` further to the right than its pose says, and `gain`
    /// times as bright.
    fn striped(pixels: usize, gain: f32) -> DownsampledFrame {
        let bright = |at: usize| if (at / 3 + pixels) % 4 < 2 { 200.0 } else { 100.0 };
        let rgb = (0..16 * 16 * 3).map(|at| (bright(at) * gain) as u8).collect();
        DownsampledFrame { rgb, ..wall(16) }
    }

    fn compared(new: &DownsampledFrame, keyframes: &[DownsampledFrame]) -> f32 {
        disagreement(new, keyframes.iter())
    }

    #[test]
    fn a_wrong_pose_disagrees_and_a_gain_does_not() {
        let here = striped(0, 1.0);
        assert!(compared(&here, &[striped(0, 1.0)]) < 1e-6);
        assert!(compared(&here, &[striped(0, 0.8)]) < 5e-3, "rounding");
        assert!(compared(&here, &[striped(2, 1.0)]) > 0.1, "negative control");
    }

    #[test]
    fn the_newest_keyframe_that_shows_the_same_counts() {
        let here = striped(0, 1.0);
        let aside = || {
            let mut aside = striped(2, 1.0);
            aside.camera.camera_from_world = Isometry3::translation(90.0, 0.0, 0.0);
            aside
        };
        assert_eq!(compared(&here, &[]), 0.0);
        assert_eq!(compared(&here, &[aside()]), 0.0, "nothing is known");
        assert!(compared(&here, &[striped(0, 1.0), striped(2, 1.0), aside()]) > 0.1);
        assert!(compared(&here, &[striped(2, 1.0), striped(0, 1.0), aside()]) < 1e-6);
    }
}
