//! Keeping, putting back, moving and forgetting what the tracker knows.

use super::super::downsampled_frame::DownsampledFrame;
use super::Tracker;
use super::frame_aligner::FrameAligner;
use super::state::TrackerState;
use lexsplat_gpu::GpuError;
use nalgebra::Isometry3;

impl Tracker {
    /// What it knows.
    pub fn save(&self) -> TrackerState {
        TrackerState {
            motion: self.motion.clone(),
            exposure: self.exposure,
            state: self.state,
            judge: self.judge,
            young: self.young.clone(),
            last: self.aligner.as_ref().and_then(FrameAligner::last),
        }
    }

    /// The map around the newest frame was moved by `moved_from_world`.
    pub fn move_with_map(&mut self, moved_from_world: &Isometry3<f64>) {
        self.motion.move_by(moved_from_world);
        if let Some(aligner) = &mut self.aligner {
            aligner.move_last(moved_from_world);
        }
    }

    /// Forgets the map, which was emptied. Kernels and buffers are kept.
    pub fn begin_anew(&mut self) {
        let aligner = self.aligner.take();
        *self = Self { aligner, ..Self::new(&self.gpu, &self.config) };
    }

    /// Puts back what a tracker with the same settings knew.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn restore(&mut self, saved: TrackerState) -> Result<(), GpuError> {
        let TrackerState { motion, exposure, state, judge, young, last } = saved;
        let stray = young
            .stray()
            .map(|frame| DownsampledFrame::new(frame, &Isometry3::identity(), self.config.width));
        if last.is_some() || stray.is_some() {
            let aligner = self.aligner.insert(FrameAligner::new(&self.gpu, &self.config)?);
            if let Some(stray) = &stray {
                aligner.restore_stray(stray)?;
            }
            if let Some((image, found)) = last {
                aligner.restore_last(image, found)?;
            }
        }
        (self.motion, self.exposure, self.state) = (motion, exposure, state);
        (self.judge, self.young) = (judge, young);
        Ok(())
    }
}
