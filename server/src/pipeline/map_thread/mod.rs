//! The thread that owns one live map.
//!
//! In: messages (frames, language maps, stop). Out: outcomes of frames, snapshots, status. It decides when
//! each stage of the pipeline runs: a frame at once, language when it arrives, optimiser steps in between.
//! It never waits for the networks while a frame waits for it, unless the clock is `per_frame`.

mod language_requests;
mod publisher;
mod refiner;
mod saving;
pub(super) mod start;

use super::checkpoint::{Checkpoint, Progress};
use super::closure::{Closure, MapParts};
use super::compressor::CompressorConfig;
use super::encoder::LanguageMap;
use super::frame::{Frame, FrameOutcome, TrackedPose, TrackingState};
use super::input_check::{Examined, InputCheck};
use super::input_warning::InputWarning;
use super::keyframes::{Keyframe, KeyframeWidths};
use super::live_map::{LiveMap, StepBudget};
use super::map::{Map, Message};
use super::mapper::{Clock, MapperConfig, insert, language, optimise, refine, select};
use super::pose_covariance::carried;
use super::registration;
use super::tracker::{Scene, Tracker, TrackerConfig, Tracking};
use crate::telemetry::{
    CLOSED_LOOPS, CLOSURE_SECONDS, COMPRESSION_SECONDS, INPUT_CHECK_SECONDS, INSERTION_SECONDS,
    MAPPING_SECONDS, REFINEMENT_SECONDS, TRACKING_SECONDS, timed,
};
use language_requests::LanguageRequests;
use lexsplat_gpu::{Gpu, GpuError, Trainer};
use nalgebra::Isometry3;
use publisher::Publisher;
use refiner::Refiner;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, oneshot};

/// Frames come as long as the newest is not older.
const FRAMES_COME: Duration = Duration::from_secs(1);

/// The live map and everything that works on it.
struct MapThread {
    config: MapperConfig,
    compressor_config: CompressorConfig,
    tracker_config: TrackerConfig,
    gpu: Gpu,
    live: LiveMap,
    tracker: Tracker,
    closure: Closure,
    /// Examines the frames of the current stream.
    input_check: InputCheck,
    trainer: Trainer,
    language: LanguageRequests,
    publisher: Publisher,
    refiner: Refiner,
    /// Frames deferred until the current keyframe is optimised (clock `per_frame`).
    deferred: VecDeque<Message>,
    /// How far the map has come.
    progress: Progress,
    /// When the newest frame was acknowledged.
    newest_frame: Instant,
    /// Whether steps were begun that nobody waited for.
    has_step_in_flight: bool,
    /// Who waits for the state of the map.
    saves: Vec<oneshot::Sender<Result<Checkpoint, String>>>,
    map: Arc<Map>,
}

/// What became of a tracked frame.
struct Mapped {
    is_keyframe: bool,
    /// Its pose after loops were closed.
    world_from_camera: Isometry3<f64>,
}

/// What the thread does next.
enum Work {
    Handle(Message),
    Optimise,
    Refine,
}

impl MapThread {
    /// Works until it is told to stop or the device fails.
    fn run(mut self, mut messages: mpsc::Receiver<Message>) {
        let _span = tracing::info_span!("map", name = self.map.name()).entered();
        let ended = self.serve(&mut messages);
        let Self { publisher, live, trainer, map, progress, .. } = &mut self;
        let shown = publisher.end(live, trainer, map, progress.through);
        if let Err(error) = ended.and(shown) {
            tracing::error!(%error, "the map stopped");
            self.map.fail(error.to_string());
            self.map.set_working(false);
        }
    }

    fn serve(&mut self, messages: &mut mpsc::Receiver<Message>) -> Result<(), GpuError> {
        while let Some(work) = self.next(messages) {
            match work {
                Work::Handle(Message::Stop) => break,
                Work::Handle(Message::Save(reply)) => self.saves.push(reply),
                Work::Handle(message) => self.handle(message)?,
                Work::Optimise => self.optimise_between_frames()?,
                Work::Refine => self.refine()?,
            }
            self.language.send(&self.live.keyframes);
            self.publish_if_due()?;
            self.save_if_wanted()?;
            self.tell_state();
        }
        Ok(())
    }

    /// Waits for the next work. Frames come before optimiser steps; with the clock `per_frame` a frame
    /// waits until the keyframe before it has its language and all its steps. The map is refined when there
    /// is nothing else. `None`: no handle to the map is left.
    fn next(&mut self, messages: &mut mpsc::Receiver<Message>) -> Option<Work> {
        if self.config.clock == Clock::PerFrame {
            while self.language.is_pending() {
                match messages.blocking_recv()? {
                    frame @ Message::Frame { .. } => self.deferred.push_back(frame),
                    other => return Some(Work::Handle(other)),
                }
            }
            if self.live.has_steps() {
                return Some(Work::Optimise);
            }
        }
        if let Some(deferred) = self.deferred.pop_front() {
            return Some(Work::Handle(deferred));
        }
        if self.live.has_steps() {
            return Some(messages.try_recv().map_or(Work::Optimise, Work::Handle));
        }
        if self.is_idle() && self.refiner.is_due(&self.live) {
            return Some(messages.try_recv().map_or(Work::Refine, Work::Handle));
        }
        messages.blocking_recv().map(Work::Handle)
    }

    fn handle(&mut self, message: Message) -> Result<(), GpuError> {
        match message {
            Message::Frame { frame, stream, times, permit, reply } => {
                drop(permit);
                if self.map.failure().is_some() {
                    self.map.drop_frame();
                    return Ok(());
                }
                self.progress.through = Some(frame.sequence);
                self.progress.times = times;
                if std::mem::replace(&mut self.progress.stream, stream) != stream {
                    self.tracker.resume();
                    self.input_check = InputCheck::new();
                }
                self.map_frame(*frame, reply)
            }
            Message::Language { sequence, map } => {
                self.language.answered();
                match map {
                    Ok(map) => self.write_language(sequence, &map),
                    Err(error) => {
                        tracing::error!(sequence, error, "a keyframe stays without language");
                        Ok(())
                    }
                }
            }
            Message::LanguageRoom => {
                self.language.has_room();
                Ok(())
            }
            Message::Refine => {
                self.refiner.want();
                Ok(())
            }
            // What is due after each message is done behind it.
            Message::CopyWanted | Message::Save(_) | Message::Stop => Ok(()),
        }
    }

    /// One frame's way through the map: track, insert, request language, acknowledge, optimise, publish.
    fn map_frame(
        &mut self,
        frame: Frame,
        reply: oneshot::Sender<FrameOutcome>,
    ) -> Result<(), GpuError> {
        let frame = self.at_one_time(frame);
        let Examined { repeats_depth, mut warnings } =
            timed(INPUT_CHECK_SECONDS, || self.input_check.examine(&frame));
        let tracked = match self.track(&frame, repeats_depth)? {
            Tracking::Found(tracked) => Some(*tracked),
            Tracking::Lost => None,
            Tracking::BeginAnew(first) => {
                warnings.push(InputWarning::bad_beginning(first.sequence));
                self.begin_anew(*first, &frame)?
            }
        };
        let mut outcome = FrameOutcome {
            sequence: frame.sequence,
            tracking: if tracked.is_some() { self.tracker.state() } else { TrackingState::Lost },
            relocalised: tracked.is_some_and(|tracked| tracked.relocalised),
            world_from_camera: None,
            covariance: None,
            keyframe: false,
            revision: self.live.revision,
            input_warnings: warnings,
        };
        if let Some(tracked) = &tracked {
            let mapped = self.map_tracked(frame, tracked, repeats_depth)?;
            outcome.keyframe = mapped.is_keyframe;
            outcome.world_from_camera = Some(mapped.world_from_camera);
            outcome.covariance =
                tracked.covariance.map(|own| carried(&mapped.world_from_camera, &own));
        } else {
            // Readers are told that the frame came.
            self.publisher.poses_changed();
        }
        self.map.finish_frame(&outcome);
        // An error means that the sender is gone. Its frame is in the map all the same.
        let _ = reply.send(outcome);
        self.newest_frame = Instant::now();
        if tracked.is_some() {
            self.optimise_behind_frame()?;
        }
        self.publish_if_due()
    }

    /// A frame whose depth was taken at another time than color: its depth follows the camera's motion.
    fn at_one_time(&self, frame: Frame) -> Frame {
        match frame.depth_lag_nanos {
            0 => frame,
            lag => match self.tracker.motion_during(&frame, lag) {
                Some(color_from_depth) => registration::at_one_time(frame, &color_from_depth),
                None => frame,
            },
        }
    }

    /// Adds a tracked frame to the trajectory, and to the map if it is a keyframe. One whose depth is that of
    /// another frame never is.
    fn map_tracked(
        &mut self,
        frame: Frame,
        tracked: &TrackedPose,
        repeats_depth: bool,
    ) -> Result<Mapped, GpuError> {
        if let Some(sequence) = tracked.beside {
            self.closure.found_beside(&mut self.live, sequence);
        }
        let mut world_from_camera = tracked.world_from_camera;
        let keyframes = &self.live.keyframes;
        let is_keyframe = !repeats_depth
            && select::is_keyframe(keyframes, &frame, &world_from_camera, &self.config);
        if is_keyframe {
            world_from_camera = self.insert_keyframe(&frame, tracked)?;
        }
        let tracked = TrackedPose { world_from_camera, ..*tracked };
        self.live.trajectory.push(&frame, &tracked, &self.live.keyframes);
        self.publisher.poses_changed();
        if is_keyframe {
            self.language.push(frame);
            self.language.send(&self.live.keyframes);
        }
        Ok(Mapped { is_keyframe, world_from_camera })
    }

    /// Empties a young map that nothing can be tracked in, and begins it with the frame `first`, which was
    /// lost. Returns the pose of the frame `second`, which agrees with that.
    fn begin_anew(
        &mut self,
        first: Frame,
        second: &Frame,
    ) -> Result<Option<TrackedPose>, GpuError> {
        self.trainer.settle(&mut self.live.gaussians)?;
        let MapperConfig { steps_per_keyframe, language_every, .. } = self.config;
        self.live.clear(&self.gpu, StepBudget::new(steps_per_keyframe, language_every));
        self.tracker.begin_anew();
        self.closure.begin_anew();
        self.publisher.gaussians_changed();
        if let Tracking::Found(tracked) = self.track(&first, false)? {
            self.map_tracked(first, &tracked, false)?;
        }
        Ok(match self.track(second, false)? {
            Tracking::Found(tracked) => Some(*tracked),
            Tracking::Lost | Tracking::BeginAnew(_) => None,
        })
    }

    /// Estimates the pose of a frame. One whose depth is that of another frame is lost, which says nothing of
    /// the frames after it.
    fn track(&mut self, frame: &Frame, repeats_depth: bool) -> Result<Tracking, GpuError> {
        if repeats_depth && frame.world_from_camera.is_none() {
            return Ok(Tracking::Lost);
        }
        let mut scene = Scene {
            trainer: &mut self.trainer,
            gaussians: &self.live.gaussians,
            keyframes: &self.live.keyframes,
        };
        timed(TRACKING_SECONDS, || self.tracker.track(frame, &mut scene))
    }

    /// Returns the keyframe's pose, which differs from the tracked one if it closes a loop.
    fn insert_keyframe(
        &mut self,
        frame: &Frame,
        tracked: &TrackedPose,
    ) -> Result<Isometry3<f64>, GpuError> {
        let (training, tracking) = (self.config.train_width, self.tracker_config.width);
        let full = self.config.refine_sweeps > 0;
        let widths = KeyframeWidths { training, tracking, full };
        let mut keyframe = Keyframe::new(frame, tracked, widths)?;
        self.close_loops(&mut keyframe)?;
        timed(INSERTION_SECONDS, || {
            insert::insert(&mut self.live, &mut self.trainer, &keyframe, &self.config)
        })?;
        let world_from_camera = keyframe.frame.world_from_camera;
        self.live.keyframes.add(keyframe);
        self.live.steps.earn();
        self.live.refinement.begin_anew();
        self.publisher.gaussians_changed();
        self.keep_to_budget();
        Ok(world_from_camera)
    }

    fn close_loops(&mut self, keyframe: &mut Keyframe) -> Result<(), GpuError> {
        let Self { live, trainer, tracker, closure, .. } = self;
        let mut map = MapParts { live, trainer, tracker };
        let closed = timed(CLOSURE_SECONDS, || closure.join(&mut map, keyframe))?;
        if closed {
            metrics::counter!(CLOSED_LOOPS).increment(1);
            self.publisher.gaussians_changed();
            self.publisher.poses_changed();
        }
        Ok(())
    }

    fn write_language(&mut self, sequence: u64, map: &LanguageMap) -> Result<(), GpuError> {
        let changed = timed(COMPRESSION_SECONDS, || {
            language::write(&mut self.live, &mut self.trainer, sequence, map)
        })?;
        if changed {
            self.publisher.gaussians_changed();
            self.keep_to_budget();
        }
        Ok(())
    }

    fn keep_to_budget(&mut self) {
        let limit_bytes = self.config.max_keyframe_mib << 20;
        if self.live.keyframes.keep_to_budget(limit_bytes, self.config.window) > 0 {
            self.publisher.poses_changed();
        }
    }

    /// With the clock `realtime`, takes a few steps after each frame even if others wait.
    fn optimise_behind_frame(&mut self) -> Result<(), GpuError> {
        if self.config.clock == Clock::Realtime {
            for _ in 0..self.config.steps_per_frame.min(self.live.steps.color_left()) {
                self.optimise()?;
            }
        }
        Ok(())
    }

    /// Takes a step. In `realtime`, while frames come, it waits for the last: a frame waits for one at most.
    fn optimise_between_frames(&mut self) -> Result<(), GpuError> {
        let frames_come = self.newest_frame.elapsed() < FRAMES_COME;
        let waits = frames_come && self.config.clock == Clock::Realtime;
        if waits && std::mem::take(&mut self.has_step_in_flight) {
            return self.trainer.settle(&mut self.live.gaussians);
        }
        self.optimise()
    }

    fn optimise(&mut self) -> Result<(), GpuError> {
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

    fn refine(&mut self) -> Result<(), GpuError> {
        let Self { live, trainer, gpu, config, refiner, .. } = self;
        if timed(REFINEMENT_SECONDS, || refine::step(live, trainer, gpu, config))? {
            refiner.changed();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
