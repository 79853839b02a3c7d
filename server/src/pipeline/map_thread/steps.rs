//! Optimiser steps of a map: behind a frame, between two frames, and while nobody sends.

use super::super::mapper::{Clock, optimise, refine};
use super::MapThread;
use crate::telemetry::{MAPPING_SECONDS, REFINEMENT_SECONDS, timed};
use lexsplat_gpu::GpuError;
use std::time::Duration;

/// Frames come as long as the newest is not older.
const FRAMES_COME: Duration = Duration::from_secs(1);

impl MapThread {
    /// With the clock `realtime`, takes a few steps after each frame even if others wait.
    pub(super) fn optimise_behind_frame(&mut self) -> Result<(), GpuError> {
        if self.config.clock == Clock::Realtime {
            for _ in 0..self.config.steps_per_frame.min(self.live.steps.color_left()) {
                self.optimise()?;
            }
        }
        Ok(())
    }

    /// Takes a step. With the clock `realtime`, while frames come, none is begun before the last is done, so that
    /// the tracking of a frame that comes meanwhile waits for one step at most.
    pub(super) fn optimise_between_frames(&mut self) -> Result<(), GpuError> {
        let frames_come = self.newest_frame.elapsed() < FRAMES_COME;
        let waits = frames_come && self.config.clock == Clock::Realtime;
        if waits && std::mem::take(&mut self.has_step_in_flight) {
            return self.trainer.settle(&mut self.live.gaussians);
        }
        self.optimise()
    }

    pub(super) fn optimise(&mut self) -> Result<(), GpuError> {
        self.has_step_in_flight = true;
        let Self { live, trainer, gpu, config, tracker_config, .. } = self;
        let changed =
            timed(MAPPING_SECONDS, || optimise::step(live, trainer, gpu, config, tracker_config))?;
        live.keyframes.release_targets();
        if changed {
            self.publisher.gaussians_changed();
        }
        Ok(())
    }

    pub(super) fn refine(&mut self) -> Result<(), GpuError> {
        let Self { live, trainer, gpu, config, refiner, .. } = self;
        if timed(REFINEMENT_SECONDS, || refine::step(live, trainer, gpu, config))? {
            refiner.changed();
        }
        Ok(())
    }

    /// Whether nothing is left to do before the next frame.
    pub(super) fn is_idle(&self) -> bool {
        !self.live.has_steps() && !self.language.is_pending()
    }
}
