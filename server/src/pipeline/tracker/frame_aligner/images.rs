//! Room on the device for images of any camera.
//!
//! In: downsampled frames. Out: their pyramids, which are shared: the last frame may be a keyframe, too. The
//! room of one that nobody uses any more is used again.

use super::super::super::downsampled_frame::DownsampledFrame;
use super::super::config::TrackerConfig;
use super::super::multi_reference::Reference;
use lexsplat_gpu::{Camera, Gpu, GpuError, Pyramid, Pyramids, Schedule, pyramid};
use std::sync::Arc;

/// Unused pyramids that are kept.
const MOST_SPARE: usize = 2;

/// Makes pyramids.
pub(super) struct Images {
    pub pyramids: Pyramids,
    /// Most levels of a pyramid.
    levels: usize,
    spare: Vec<Pyramid>,
}

impl Images {
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn new(gpu: &Gpu, config: &TrackerConfig) -> Result<Self, GpuError> {
        let levels = config.steps.len().max(config.wide_steps.len()).max(1);
        Ok(Self { pyramids: Pyramids::new(gpu)?, levels, spare: Vec::new() })
    }

    /// The pyramid of an image; `None` if that is too small to be aligned.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn make(&mut self, image: &DownsampledFrame) -> Result<Option<Arc<Pyramid>>, GpuError> {
        let Some(mut pyramid) = self.empty(&image.camera)? else { return Ok(None) };
        self.pyramids.fill(&mut pyramid, &image.rgb, &image.depth_metres)?;
        Ok(Some(Arc::new(pyramid)))
    }

    /// Room for an image of a camera, with as many levels as are asked for, or as its size allows; `None`
    /// if it is too small for one.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn empty(&mut self, camera: &Camera) -> Result<Option<Pyramid>, GpuError> {
        if let Some(at) = self.spare.iter().position(|spare| is_for(spare, camera)) {
            return Ok(Some(self.spare.swap_remove(at)));
        }
        let fits = |levels: &usize| pyramid::cameras(camera, *levels).is_ok();
        let levels = (1..=self.levels).rev().find(fits);
        levels.map(|levels| self.pyramids.allocate(camera, levels)).transpose()
    }

    /// Somebody uses a pyramid no more.
    pub fn give_back(&mut self, pyramid: Arc<Pyramid>) {
        if let Some(pyramid) = Arc::into_inner(pyramid) {
            self.spare.truncate(MOST_SPARE - 1);
            // The newest first: others may be of a camera that is gone.
            self.spare.insert(0, pyramid);
        }
    }
}

/// Whether a pyramid has room for images of this camera.
pub(super) fn is_for(pyramid: &Pyramid, camera: &Camera) -> bool {
    let lens = |c: &Camera| ([c.width, c.height], [c.fx, c.fy, c.cx, c.cy]);
    lens(&pyramid.levels()[0].camera) == lens(camera)
}

/// The steps at sizes that all images have: those of a small camera have fewer.
pub(super) fn within_levels(
    schedule: &Schedule,
    references: &[Reference],
    live: &Pyramid,
) -> Schedule {
    let images = references.iter().map(|reference| &*reference.pyramid).chain([live]);
    let levels = images.map(|image| image.levels().len()).min().unwrap_or(1);
    let mut schedule = schedule.clone();
    schedule.steps.truncate(levels);
    schedule
}
