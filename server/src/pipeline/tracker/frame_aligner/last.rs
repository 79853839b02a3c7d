//! The last tracked frame compared with single keyframes.

use super::super::super::downsampled_frame::DownsampledFrame;
use super::super::super::keyframes::Keyframe;
use super::super::candidate::PoseCandidate;
use super::super::multi_reference::Reference;
use super::images::{fit, levels};
use super::{CHECKED_STRIDE, FrameAligner, MAX_STRIDE, align};
use lexsplat_gpu::{Estimate, GpuError, Schedule};
use nalgebra::Isometry3;

/// Alignments with a keyframe, each from where the one before ended.
const ALIGNMENTS: usize = 2;

impl FrameAligner {
    /// How well the last tracked frame agrees with a keyframe where it was tracked; `None` if there is none.
    /// `keyframes`: all that it is compared with, so that they stay on the device.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn compare_last(
        &mut self,
        keyframe: &Keyframe,
        keyframes: &[&Keyframe],
    ) -> Result<Option<PoseCandidate>, GpuError> {
        let Some(last) = self.last_found else { return Ok(None) };
        self.upload_keyframes(keyframes)?;
        let mut schedule = Schedule { steps: vec![0], ..self.schedule(false, None, 1) };
        let stride = schedule.settings.stride * CHECKED_STRIDE;
        schedule.settings.stride = stride.min(MAX_STRIDE as u32);
        let pose = keyframe.frame.world_from_camera.inverse() * last.world_from_camera;
        self.align_last_from(keyframe, &pose, last.exposure, &schedule).map(Some)
    }

    /// Aligns the last tracked frame with a keyframe alone, from a start that may be a few centimetres off;
    /// `None` if there is no such frame.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn align_last(
        &mut self,
        keyframe: &Keyframe,
        keyframe_from_camera: &Isometry3<f64>,
    ) -> Result<Option<PoseCandidate>, GpuError> {
        let Some(last) = self.last_found else { return Ok(None) };
        self.upload_keyframes(&[keyframe])?;
        let schedule = self.schedule(false, None, 1);
        let world_from_keyframe = keyframe.frame.world_from_camera;
        let mut found =
            self.align_last_from(keyframe, keyframe_from_camera, last.exposure, &schedule)?;
        for _ in 1..ALIGNMENTS {
            let start = world_from_keyframe.inverse() * found.world_from_camera;
            found = self.align_last_from(keyframe, &start, found.exposure, &schedule)?;
        }
        Ok(Some(found))
    }

    /// The last tracked frame, and where it was found.
    pub fn last(&self) -> Option<(DownsampledFrame, PoseCandidate)> {
        self.last_image.clone().zip(self.last_found)
    }

    /// Puts back the last tracked frame.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn restore_last(
        &mut self,
        image: DownsampledFrame,
        found: PoseCandidate,
    ) -> Result<(), GpuError> {
        let levels = levels(&image.camera, &self.config).unwrap_or(1);
        fit(&self.pyramids, &mut self.last, &image.camera, levels)?;
        self.pyramids.fill(&mut self.last, &image.rgb, &image.depth_metres)?;
        (self.last_image, self.last_found) = (Some(image), Some(found));
        Ok(())
    }

    /// Puts back the last lost frame.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn restore_stray(&mut self, image: &DownsampledFrame) -> Result<(), GpuError> {
        let levels = levels(&image.camera, &self.config).unwrap_or(1);
        fit(&self.pyramids, &mut self.stray, &image.camera, levels)?;
        self.pyramids.fill(&mut self.stray, &image.rgb, &image.depth_metres)
    }

    /// The map around the last tracked frame was moved.
    pub fn move_last(&mut self, moved_from_world: &Isometry3<f64>) {
        if let Some(last) = &mut self.last_found {
            last.world_from_camera = moved_from_world * last.world_from_camera;
        }
    }

    fn align_last_from(
        &mut self,
        keyframe: &Keyframe,
        keyframe_from_camera: &Isometry3<f64>,
        exposure: [f64; 2],
        schedule: &Schedule,
    ) -> Result<PoseCandidate, GpuError> {
        let sequence = keyframe.frame.sequence;
        let uploaded = self.keyframes.iter().find(|(uploaded, _)| *uploaded == sequence);
        let (_, pyramid) = uploaded.expect("the keyframe was uploaded");
        let world_from_reference = keyframe.frame.world_from_camera;
        let reference = Reference {
            pyramid,
            world_from_reference,
            exposure: keyframe.map_exposure,
            weight: 1.0,
        };
        let start = Estimate { reference_from_live: *keyframe_from_camera, exposure };
        let aligner = &mut self.aligner;
        align(aligner, &[reference], &self.last, &world_from_reference, &start, schedule)
    }
}
