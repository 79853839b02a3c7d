//! Copying a map for readers, and its whole state; and putting that back.

use super::super::checkpoint::{Checkpoint, Core};
use super::super::compressor;
use super::super::keyframes::{KeyframeState, KeyframeStore};
use super::super::live_map::{LiveMap, LiveState};
use super::super::mapper::Clock;
use super::MapThread;
use crate::telemetry::{CHECKPOINT_COPY_SECONDS, timed};
use lexsplat_gpu::{GpuError, SavedGaussians};

impl MapThread {
    /// Tells readers of changes when the map is idle and, with the clock `realtime`, every few seconds; and
    /// makes a copy if one is due. With `per_frame` results would depend on the time: steps in flight are
    /// waited for, and those that met full lists are then repeated in another order.
    pub(super) fn publish_if_due(&mut self) -> Result<(), GpuError> {
        if self.refiner.publishes(&self.live, self.publisher.age()) {
            self.publisher.gaussians_changed();
        }
        let is_realtime = self.config.clock == Clock::Realtime;
        let is_old = self.publisher.age().as_secs_f64() >= self.config.snapshot_seconds;
        if self.is_idle() || is_realtime && (is_old || self.map.copies().is_due()) {
            let Self { publisher, live, trainer, map, progress, .. } = self;
            publisher.publish(live, trainer, map, progress.through)?;
        }
        Ok(())
    }

    /// Whether nothing is left to do before the next frame.
    pub(super) fn is_idle(&self) -> bool {
        !self.live.has_steps() && !self.language.is_pending()
    }

    /// In this order: who sees that no work is left knows how far the map is refined.
    pub(super) fn tell_state(&self) {
        let is_idle = self.is_idle();
        self.map.set_refinement(self.refiner.state(&self.live, is_idle));
        self.map.set_working(!is_idle);
    }

    /// Gives the state of the map to those who wait for it. With the clock `per_frame` they wait until the
    /// last frame has its language and all its steps: waiting for steps in flight at another moment could
    /// change the map.
    pub(super) fn save_if_wanted(&mut self) -> Result<(), GpuError> {
        let may_save = self.config.clock == Clock::Realtime || self.is_idle();
        if self.saves.is_empty() || !may_save {
            return Ok(());
        }
        for reply in std::mem::take(&mut self.saves) {
            let saved = timed(CHECKPOINT_COPY_SECONDS, || self.save())?;
            // An error means that nobody waits any more.
            let _ = reply.send(Ok(saved));
        }
        Ok(())
    }

    fn save(&mut self) -> Result<Checkpoint, GpuError> {
        self.trainer.settle(&mut self.live.gaussians)?;
        let mut progress = self.progress.clone();
        self.map.save_progress(&mut progress);
        let keyframes = self.live.keyframes.iter();
        let keyframes = keyframes.map(|keyframe| KeyframeState::of(keyframe, &self.gpu));
        let keyframes = keyframes.collect::<Result<Vec<_>, _>>()?;
        let core = Core {
            progress,
            live: live_state(&self.live),
            tracker: self.tracker.save(),
            detection: self.closure.save(),
            input_check: self.input_check.clone(),
            waiting_for_language: self.language.pending(),
            hit_capacities: self.trainer.hit_capacities(),
            keyframes: keyframes.len(),
        };
        let gaussians = SavedGaussians::of(&self.live.gaussians)?;
        Ok(Checkpoint { core, gaussians, keyframes })
    }

    /// Puts back the state of a map with the same settings, and tells readers of it.
    ///
    /// # Errors
    /// The reason in words.
    pub(super) fn restore(&mut self, saved: Checkpoint) -> Result<(), String> {
        let Checkpoint { core, gaussians, keyframes } = saved;
        let on_device = |error: GpuError| error.to_string();
        let online = compressor::restored(&self.compressor_config, &core.live.online);
        let online = online.map_err(|error| error.to_string())?;
        let channels = online.code_size();
        if channels != self.live.online.code_size() || channels != gaussians.channels {
            return Err("its codes have another size".into());
        }
        let keyframes = keyframes.into_iter().map(|keyframe| keyframe.keyframe(&self.gpu));
        let keyframes = keyframes.collect::<Result<Vec<_>, _>>().map_err(on_device)?;
        let LiveState { trajectory, forgotten, graph, steps, refinement, rng, sorted_len, .. } =
            core.live;
        self.live = LiveMap {
            gaussians: gaussians.upload(&self.gpu).map_err(on_device)?,
            keyframes: KeyframeStore::restored(keyframes, forgotten),
            trajectory,
            graph,
            online,
            steps,
            refinement,
            rng,
            sorted_len,
            farthest_metres: core.live.farthest_metres,
            largest_scale_metres: core.live.largest_scale_metres,
            revision: core.live.revision,
        };
        self.trainer.set_hit_capacities(core.hit_capacities);
        self.tracker.restore(core.tracker).map_err(on_device)?;
        self.closure.restore(core.detection);
        self.input_check = core.input_check;
        core.waiting_for_language.into_iter().for_each(|frame| self.language.push(frame));
        self.progress = core.progress.clone();
        self.map.restore_progress(core.progress, self.tracker.state());
        self.publisher.tell(&self.live, &self.map);
        self.language.send(&self.live.keyframes);
        self.tell_state();
        Ok(())
    }
}

fn live_state(live: &LiveMap) -> LiveState {
    LiveState {
        trajectory: live.trajectory.clone(),
        forgotten: live.keyframes.forgotten().clone(),
        graph: live.graph.clone(),
        online: live.online.save(),
        steps: live.steps.clone(),
        refinement: live.refinement.clone(),
        rng: live.rng.clone(),
        sorted_len: live.sorted_len,
        farthest_metres: live.farthest_metres,
        largest_scale_metres: live.largest_scale_metres,
        revision: live.revision,
    }
}
