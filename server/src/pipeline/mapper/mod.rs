//! Builds the map (paper §4.3): keyframes, insertion by need, optimisation of both heads.
//!
//! In: frames in order, language maps of keyframes when they are ready. Out: outcomes, snapshots.
//! One named thread per map owns the live Gaussians. It never waits for the networks: language is
//! written into the map when it arrives. It must not know who asked or how frames came in.

mod budget;
mod config;
mod insert;
mod keyframe;
mod language;
mod optimise;
mod prune;
mod refine;
mod steps;
mod trajectory;

pub use config::{Clock, MapperConfig, TiesConfig};

use super::compressor::{self, OnlineStage};
use super::encoder::{LanguageMap, LanguageThread};
use super::engine::PipelineConfig;
use super::frame::{Frame, FrameOutcome};
use super::map::{Event, Map};
use super::snapshot::{KeyframeInfo, MapSnapshot};
use super::tracker::{Scene, Tracked, Tracker, TrackerConfig};
use crate::telemetry::{
    COMPRESSION_SECONDS, INSERTION_SECONDS, SNAPSHOT_SECONDS, TRACKING_SECONDS, timed,
};
use keyframe::Keyframe;
use lexsplat_gpu::{Gaussians, Gpu, GpuError, HostGaussians, Ties, Trainer};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use steps::Steps;
use tokio::sync::mpsc;
use trajectory::Trajectory;

/// Which random views are replayed is the same in every run.
const REPLAY_SEED: u64 = 0x5eed;
/// How often a map whose keyframes found no room at the language thread asks again.
const LANGUAGE_RETRY: Duration = Duration::from_millis(20);

/// Starts a map's thread.
///
/// # Errors
/// Why its device memory, its kernels or its thread cannot be had.
pub(super) fn spawn(
    name: &str,
    gpu: &Gpu,
    language: &Arc<LanguageThread>,
    config: &PipelineConfig,
) -> Result<(Arc<Map>, JoinHandle<()>), String> {
    let online = compressor::online(&config.compressor);
    let mut trainer = Trainer::new(gpu, online.code_size()).map_err(|error| error.to_string())?;
    let TiesConfig { rotation, scale, opacity } = config.mapper.ties;
    trainer.set_ties(Ties { rotation, scale, opacity });
    let gaussians = Gaussians::new(gpu, online.code_size());
    let empty = MapSnapshot {
        map: name.to_owned(),
        revision: 0,
        gaussians: Arc::new(HostGaussians::default()),
        online: Arc::from(online.boxed_clone()),
        intrinsics: None,
        trajectory: Arc::default(),
        keyframes: Arc::default(),
    };
    let (map, events) = Map::new(name, config.mapper.queue_frames, empty);
    let map = Arc::new(map);
    let mapper = Mapper {
        config: config.mapper.clone(),
        gpu: gpu.clone(),
        map: map.clone(),
        language: language.clone(),
        tracker: Tracker::new(gpu, &config.tracker),
        tracker_config: config.tracker.clone(),
        online,
        trainer,
        gaussians,
        keyframes: Vec::new(),
        trajectory: Trajectory::default(),
        awaiting_language: VecDeque::new(),
        language_in_flight: 0,
        deferred: VecDeque::new(),
        steps: Steps::new(&config.mapper),
        ordered_len: 0,
        farthest_metres: 0.0,
        revision: 0,
        published: Arc::default(),
        changed: false,
        moved: false,
        published_at: Instant::now(),
        sender: 0,
        rng: ChaCha8Rng::seed_from_u64(REPLAY_SEED),
    };
    let thread = std::thread::Builder::new()
        .name(format!("map {name}"))
        .spawn(move || mapper.run(events))
        .map_err(|error| error.to_string())?;
    Ok((map, thread))
}

/// The live map and all that works on it.
struct Mapper {
    config: MapperConfig,
    gpu: Gpu,
    map: Arc<Map>,
    language: Arc<LanguageThread>,
    tracker: Tracker,
    tracker_config: TrackerConfig,
    online: Box<dyn OnlineStage>,
    trainer: Trainer,
    gaussians: Gaussians,
    keyframes: Vec<Keyframe>,
    trajectory: Trajectory,
    /// Keyframes that the language thread had no room for yet, oldest first.
    awaiting_language: VecDeque<Frame>,
    language_in_flight: usize,
    /// Frames that came while the clock stood still.
    deferred: VecDeque<Event>,
    steps: Steps,
    /// Size of the map when it was last brought into spatial order.
    ordered_len: usize,
    /// The farthest that a keyframe measured.
    farthest_metres: f32,
    revision: u64,
    /// The map as readers have it.
    published: Arc<HostGaussians>,
    changed: bool,
    /// Frames were tracked that readers do not know of.
    moved: bool,
    published_at: Instant,
    /// Whose frames came last.
    sender: u64,
    rng: ChaCha8Rng,
}

impl Mapper {
    /// The thread: frames first, optimisation while there are none, sleep when all is done.
    fn run(mut self, mut events: mpsc::Receiver<Event>) {
        loop {
            let event = self.next(&mut events);
            let done = match event {
                Some(Event::Stop) => break,
                Some(event) => self.handle(event),
                None if self.has_work() => self.optimise_once(),
                None if self.waits_for_room() => {
                    std::thread::sleep(LANGUAGE_RETRY);
                    Ok(())
                }
                None => break,
            };
            let done = done.and_then(|()| self.settle());
            if let Err(error) = done {
                tracing::error!(map = self.map.name(), %error, "the map stopped");
                self.map.fail(error.to_string());
                self.map.counters.working.store(false, Ordering::Release);
                return;
            }
        }
        if (self.changed || self.moved)
            && let Err(error) = self.publish()
        {
            tracing::error!(map = self.map.name(), %error, "no last snapshot");
        }
    }

    /// What to do next; `None`: nothing has come, or the channel is closed.
    fn next(&mut self, events: &mut mpsc::Receiver<Event>) -> Option<Event> {
        let is_per_frame = self.config.clock == Clock::PerFrame;
        if is_per_frame && self.language_in_flight > 0 {
            // Frames that come meanwhile wait.
            loop {
                match events.blocking_recv()? {
                    frame @ Event::Frame { .. } => self.deferred.push_back(frame),
                    other => return Some(other),
                }
            }
        }
        if is_per_frame && (self.has_work() || self.waits_for_room()) {
            return None;
        }
        if let Some(deferred) = self.deferred.pop_front() {
            return Some(deferred);
        }
        if self.has_work() || self.waits_for_room() {
            events.try_recv().ok()
        } else {
            events.blocking_recv()
        }
    }

    fn has_work(&self) -> bool {
        !self.steps.is_done() && !self.gaussians.is_empty()
    }

    /// Other maps' keyframes fill the language thread's queue: nothing will wake this map when there
    /// is room.
    fn waits_for_room(&self) -> bool {
        !self.awaiting_language.is_empty() && self.language_in_flight == 0
    }

    fn handle(&mut self, event: Event) -> Result<(), GpuError> {
        match event {
            Event::Frame { frame, sender, permit, reply } => {
                drop(permit);
                if self.map.failure().is_some() {
                    self.map.counters.dropped.fetch_add(1, Ordering::Relaxed);
                    self.map.counters.unsettled.fetch_sub(1, Ordering::AcqRel);
                    return Ok(());
                }
                if std::mem::replace(&mut self.sender, sender) != sender {
                    self.tracker.resume();
                }
                let outcome = self.map_frame(frame)?;
                self.map.finish_frame(&outcome);
                // The sender may have gone: its frame is in the map all the same.
                let _ = reply.send(outcome);
                self.map.counters.working.store(true, Ordering::Release);
                self.map.counters.unsettled.fetch_sub(1, Ordering::AcqRel);
                Ok(())
            }
            Event::Language { sequence, map } => {
                self.language_in_flight -= 1;
                match map {
                    Ok(map) => timed(COMPRESSION_SECONDS, || self.write_language(sequence, map)),
                    Err(error) => {
                        tracing::error!(sequence, error, "a keyframe stays without language");
                        Ok(())
                    }
                }
            }
            Event::Stop => unreachable!("the loop ends on Stop"),
        }
    }

    /// One frame's way through the map.
    fn map_frame(&mut self, frame: Frame) -> Result<FrameOutcome, GpuError> {
        let sequence = frame.sequence;
        let mut scene = Scene { trainer: &mut self.trainer, gaussians: &self.gaussians };
        let tracked = timed(TRACKING_SECONDS, || self.tracker.track(&frame, &mut scene))?;
        let mut is_keyframe = false;
        if let Some(tracked) = &tracked {
            is_keyframe = self.is_keyframe(&frame, &tracked.world_from_camera);
            let times = (sequence, frame.timestamp_nanos);
            if is_keyframe {
                self.add_keyframe(frame, tracked)?;
            }
            self.trajectory.push(times, tracked, &self.keyframes);
            self.moved = true;
            let is_realtime = self.config.clock == Clock::Realtime;
            let at_once = if is_realtime { self.config.steps_per_frame } else { 0 };
            for _ in 0..at_once.min(self.steps.color_left()) {
                self.optimise_once()?;
            }
        }
        Ok(FrameOutcome {
            sequence,
            tracking: self.tracker.state(),
            relocalised: tracked.is_some_and(|tracked| tracked.relocalised),
            world_from_camera: tracked.map(|tracked| tracked.world_from_camera),
            keyframe: is_keyframe,
            revision: self.revision,
        })
    }

    fn add_keyframe(&mut self, frame: Frame, tracked: &Tracked) -> Result<(), GpuError> {
        let mut keyframe = Keyframe::new(&self.gpu, tracked, &frame, self.config.train_width)?;
        timed(INSERTION_SECONDS, || self.insert(&keyframe))?;
        keyframe.tracker_bytes = self.tracker.add_keyframe(&frame, &keyframe.working, tracked);
        self.keyframes.push(keyframe);
        self.keep_to_budget();
        self.awaiting_language.push_back(frame);
        self.steps.earn();
        Ok(())
    }

    /// After each turn: hand keyframes to the networks, tell readers, say whether work is left.
    fn settle(&mut self) -> Result<(), GpuError> {
        self.request_language();
        let idle =
            !self.has_work() && self.awaiting_language.is_empty() && self.language_in_flight == 0;
        // Copying waits for the steps in flight, and those that met full lists are taken again: by the clock
        // on the wall, their order would not be the same in every run.
        let is_realtime = self.config.clock == Clock::Realtime;
        let since = self.published_at.elapsed().as_secs_f64();
        let due = is_realtime && since >= self.config.snapshot_seconds;
        if (self.changed || self.moved) && (idle || due) {
            timed(SNAPSHOT_SECONDS, || self.publish())?;
        }
        self.map.counters.working.store(!idle, Ordering::Release);
        Ok(())
    }

    fn request_language(&mut self) {
        while let Some(frame) = self.awaiting_language.pop_front() {
            let sequence = frame.sequence;
            let events = self.map.control();
            let reply = move |map: Result<LanguageMap, String>| {
                // The map may have been deleted meanwhile.
                let _ = events.blocking_send(Event::Language { sequence, map });
            };
            match self.language.try_submit(frame, reply) {
                Ok(()) => self.language_in_flight += 1,
                Err(frame) => {
                    self.awaiting_language.push_front(frame);
                    return;
                }
            }
        }
    }

    /// Copies the map for readers.
    fn publish(&mut self) -> Result<(), GpuError> {
        if self.changed {
            self.trainer.settle(&mut self.gaussians)?;
            self.published = Arc::new(self.gaussians.to_host()?);
            self.revision += 1;
        }
        let info = |keyframe: &Keyframe| KeyframeInfo {
            frame: keyframe.frame,
            intrinsics: keyframe.intrinsics,
            rgb: keyframe.rgb.clone(),
            has_language: keyframe.generic.is_some(),
        };
        let counters = &self.map.counters;
        counters.keyframes.store(self.keyframes.len() as u64, Ordering::Relaxed);
        counters.gaussians.store(self.gaussians.len() as u64, Ordering::Relaxed);
        counters.gpu_bytes.store(self.gaussians.device_bytes(), Ordering::Relaxed);
        counters.keyframe_bytes.store(self.keyframe_bytes(), Ordering::Relaxed);
        counters.olae_version.store(self.online.version(), Ordering::Relaxed);
        self.map.publish(MapSnapshot {
            map: self.map.name().to_owned(),
            revision: self.revision,
            gaussians: self.published.clone(),
            online: Arc::from(self.online.boxed_clone()),
            intrinsics: self.keyframes.first().map(|keyframe| keyframe.intrinsics),
            trajectory: Arc::new(self.trajectory.frames(&self.keyframes)),
            keyframes: Arc::new(self.keyframes.iter().map(info).collect()),
        });
        (self.changed, self.moved) = (false, false);
        self.published_at = Instant::now();
        Ok(())
    }
}
