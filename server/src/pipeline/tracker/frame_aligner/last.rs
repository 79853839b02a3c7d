//! The last tracked frame compared with single keyframes.

use super::super::super::downsampled_frame::DownsampledFrame;
use super::super::super::keyframes::Keyframe;
use super::super::candidate::PoseCandidate;
use super::{CHECKED_STRIDE, FrameAligner, MAX_STRIDE, Uploaded, align};
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
        let Some(last) = self.last_found() else { return Ok(None) };
        self.upload_keyframes(keyframes)?;
        let mut schedule = Schedule { steps: vec![0], ..self.schedule(false, None, 1) };
        let stride = schedule.settings.stride * CHECKED_STRIDE;
        schedule.settings.stride = stride.min(MAX_STRIDE as u32);
        let pose = keyframe.frame.world_from_camera.inverse() * last.world_from_camera;
        self.align_last_from(keyframe, &pose, last.exposure, &schedule)
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
        let Some(last) = self.last_found() else { return Ok(None) };
        self.upload_keyframes(&[keyframe])?;
        let schedule = self.schedule(false, None, 1);
        let world_from_keyframe = keyframe.frame.world_from_camera;
        let (mut start, mut exposure, mut aligned) = (*keyframe_from_camera, last.exposure, None);
        for _ in 0..ALIGNMENTS {
            aligned = self.align_last_from(keyframe, &start, exposure, &schedule)?;
            let Some(found) = &aligned else { break };
            start = world_from_keyframe.inverse() * found.world_from_camera;
            exposure = found.exposure;
        }
        Ok(aligned)
    }

    /// The last tracked frame, and where it was found.
    pub fn last(&self) -> Option<(DownsampledFrame, PoseCandidate)> {
        self.last.as_ref().map(|(last, found)| (last.image.clone(), *found))
    }

    fn last_found(&self) -> Option<PoseCandidate> {
        self.last.as_ref().map(|(_, found)| *found)
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
        let Some(pyramid) = self.images.make(&image)? else { return Ok(()) };
        self.last = Some((Uploaded { sequence: None, image, pyramid }, found));
        Ok(())
    }

    /// Puts back the last lost frame.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn restore_stray(&mut self, image: &DownsampledFrame) -> Result<(), GpuError> {
        self.stray = self.images.make(image)?;
        Ok(())
    }

    /// The map around the last tracked frame was moved.
    pub fn move_last(&mut self, moved_from_world: &Isometry3<f64>) {
        if let Some((_, found)) = &mut self.last {
            found.world_from_camera = moved_from_world * found.world_from_camera;
        }
    }

    /// `None` if the keyframe is not on the device.
    fn align_last_from(
        &mut self,
        keyframe: &Keyframe,
        keyframe_from_camera: &Isometry3<f64>,
        exposure: [f64; 2],
        schedule: &Schedule,
    ) -> Result<Option<PoseCandidate>, GpuError> {
        let last = self.last.as_ref().map(|(last, _)| last.pyramid.clone());
        let Some((live, reference)) = last.zip(self.reference(keyframe)) else { return Ok(None) };
        let start = Estimate { reference_from_live: *keyframe_from_camera, exposure };
        let base = reference.world_from_reference;
        align(&mut self.aligner, &[reference], &live, &base, &start, schedule).map(Some)
    }
}
