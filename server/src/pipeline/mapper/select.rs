//! Selects keyframes: frames that show something new, or that were taken from far enough away.

use super::super::frame::{Frame, rasteriser_camera};
use super::super::keyframes::{KeyframeStore, SurfaceSample};
use super::super::quantile::median;
use super::config::MapperConfig;
use nalgebra::Isometry3;

/// Points of a frame that are looked up in the keyframes of the window.
const SAMPLES: f64 = 1000.0;

/// Whether a tracked frame becomes a keyframe. A frame that is held out never does.
///
/// Every keyframe gets language, so that what is new in color is new in language too (paper §4.3 asks for
/// both). Asking all keyframes with language instead of the window's gave fewer keyframes, and a lost camera
/// then accepted a wrong place (measured).
pub(in super::super) fn is_keyframe(
    keyframes: &KeyframeStore,
    frame: &Frame,
    world_from_camera: &Isometry3<f64>,
    config: &MapperConfig,
) -> bool {
    if frame.held_out {
        return false;
    }
    let Some(newest) = keyframes.newest() else { return true };
    let newest_from_camera = newest.frame.world_from_camera.inverse() * world_from_camera;
    let moved_metres = newest_from_camera.translation.vector.norm();
    let Some(median_metres) = median_depth(&frame.depth_metres) else { return false };
    if moved_metres > config.keyframe_translation * f64::from(median_metres)
        || newest_from_camera.rotation.angle() > config.keyframe_rotation_radians
    {
        return true;
    }
    let camera = rasteriser_camera(&frame.intrinsics, world_from_camera);
    let sample = SurfaceSample::new(&camera, &frame.depth_metres, SAMPLES);
    let window = keyframes.iter().rev().take(config.window.max(1));
    sample.novelty(window.map(|keyframe| &keyframe.training)) > config.keyframe_novelty
}

/// The median of a sample of the measured depths, metres; `None` if nothing was measured.
fn median_depth(depth_metres: &[f32]) -> Option<f32> {
    let stride = (depth_metres.len() / 4096).max(1);
    let mut sample: Vec<f32> =
        depth_metres.iter().step_by(stride).copied().filter(|depth| *depth > 0.0).collect();
    median(&mut sample)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_ignores_holes() {
        assert_eq!(median_depth(&[0.0, 0.0, 0.0, 1.0, 2.0, 9.0]), Some(2.0));
        assert_eq!(median_depth(&[0.0; 5]), None);
    }
}
