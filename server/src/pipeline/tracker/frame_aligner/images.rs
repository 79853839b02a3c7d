//! Room on the device for images of any camera.

use super::super::config::TrackerConfig;
use super::super::multi_reference::Reference;
use lexsplat_gpu::{Camera, GpuError, Pyramid, Pyramids, Schedule, pyramid};

/// Sizes at which images of a camera are aligned: as many as the settings ask for, or as its size allows.
/// `None` if it is too small for one.
pub(super) fn levels(camera: &Camera, config: &TrackerConfig) -> Option<usize> {
    let wanted = config.steps.len().max(config.wide_steps.len()).max(1);
    (1..=wanted).rev().find(|levels| pyramid::cameras(camera, *levels).is_ok())
}

/// Makes room for images of a camera, if the pyramid is for another one.
pub(super) fn fit(
    pyramids: &Pyramids,
    pyramid: &mut Pyramid,
    camera: &Camera,
    levels: usize,
) -> Result<(), GpuError> {
    let there = &pyramid.levels()[0].camera;
    let lens = |c: &Camera| ([c.width, c.height], [c.fx, c.fy, c.cx, c.cy]);
    if lens(there) != lens(camera) {
        *pyramid = pyramids.allocate(camera, levels)?;
    }
    Ok(())
}

/// The steps at sizes that all images have: those of a small camera have fewer.
pub(super) fn within_levels(
    schedule: &Schedule,
    references: &[Reference<'_>],
    live: &Pyramid,
) -> Schedule {
    let images = references.iter().map(|reference| reference.pyramid).chain([live]);
    let levels = images.map(|image| image.levels().len()).min().unwrap_or(1);
    let mut schedule = schedule.clone();
    schedule.steps.truncate(levels);
    schedule
}
