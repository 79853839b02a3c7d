//! A map as the edges see it: a name, a queue of frames, snapshots, events and a status.
//!
//! In: checked [`Frame`]s. Out: [`FrameOutcome`]s, [`MapSnapshot`]s and [`MapEvent`]s. The live map belongs
//! to its thread (`map_thread/`), which publishes here.

mod copies;
mod error;
mod event;
mod reading;
mod saving;
mod status;

pub use error::MapError;
pub(super) use event::Message;
pub use event::{MapEvent, NumberedEvent};
pub use reading::{Reading, Wait};
pub use status::{MapStatus, Refinement};

use super::frame::{Frame, FrameOutcome, TrackingState};
use super::frame_times::FrameTimes;
use super::input_warning::InputWarning;
use super::live_map::LiveMap;
use super::snapshot::MapSnapshot;
use super::up::MapUp;
use copies::Copies;
use status::Counters;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use tokio::sync::{Notify, Semaphore, broadcast, mpsc, oneshot};

/// Events that a watcher may fall behind before it misses some.
const EVENT_BACKLOG: usize = 256;
/// Places in the thread's queue beside those for frames: for language results and commands.
const CONTROL_SLOTS: usize = 16;

/// State behind the lock. The lock is held briefly and never over an await.
struct Shared {
    tracking: TrackingState,
    refinement: Refinement,
    failure: Option<String>,
    recording_damage: Option<String>,
    input_warnings: Vec<InputWarning>,
    up: Option<MapUp>,
    received_through: Option<u64>,
    has_stream: bool,
    /// Streams that were opened so far.
    streams: u64,
    times: FrameTimes,
    /// The last stream whose times did not increase.
    warned_of_times: u64,
    next_event: u64,
}

/// A handle to a map. Share it with `Arc`.
pub struct Map {
    name: String,
    queue_capacity: usize,
    frame_slots: Arc<Semaphore>,
    messages: mpsc::Sender<Message>,
    watchers: broadcast::Sender<NumberedEvent>,
    copies: Copies,
    /// Told when readers may have something to see that they wait for.
    progressed: Notify,
    counters: Counters,
    shared: Mutex<Shared>,
}

impl Map {
    /// A handle and the receiving end of its messages, which belongs to the map's thread.
    pub(super) fn new(
        name: &str,
        queue_capacity: usize,
        empty: MapSnapshot,
    ) -> (Self, mpsc::Receiver<Message>) {
        let (messages, receiver) = mpsc::channel(queue_capacity + CONTROL_SLOTS);
        let map = Self {
            name: name.to_owned(),
            queue_capacity,
            frame_slots: Arc::new(Semaphore::new(queue_capacity)),
            messages,
            watchers: broadcast::Sender::new(EVENT_BACKLOG),
            copies: Copies::new(empty),
            progressed: Notify::new(),
            counters: Counters::default(),
            shared: Mutex::new(Shared {
                tracking: TrackingState::Empty,
                refinement: Refinement::Off,
                failure: None,
                recording_damage: None,
                input_warnings: Vec::new(),
                up: None,
                received_through: None,
                has_stream: false,
                streams: 0,
                times: FrameTimes::default(),
                warned_of_times: 0,
                next_event: 1,
            }),
        };
        (map, receiver)
    }

    fn shared(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().expect("no thread panics while it holds a map's lock")
    }

    /// The map's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether no frame waits and no work is left.
    fn is_settled(&self) -> bool {
        self.counters.unsettled.load(Ordering::Acquire) == 0
            && !self.counters.working.load(Ordering::Acquire)
    }

    /// Receives events from now on.
    pub fn subscribe(&self) -> broadcast::Receiver<NumberedEvent> {
        self.watchers.subscribe()
    }

    /// Sequence number of the newest accepted frame.
    pub fn received_through(&self) -> Option<u64> {
        self.shared().received_through
    }

    /// Frames that wait, and how many fit into the queue.
    pub fn queue(&self) -> (usize, usize) {
        (self.queue_capacity - self.frame_slots.available_permits(), self.queue_capacity)
    }

    /// Makes the caller's stream the only one that writes to the map until the guard is dropped. Its first
    /// frame without a pose is relocalised in the map, because the camera may have moved since the last
    /// stream, or be another one.
    ///
    /// # Errors
    /// [`MapError::Busy`] if another stream writes; [`MapError::Failed`] if it takes no more frames.
    pub fn claim(self: &Arc<Self>) -> Result<StreamGuard, MapError> {
        let mut shared = self.shared();
        if let Some(reason) = &shared.failure {
            return Err(MapError::Failed { name: self.name.clone(), reason: reason.clone() });
        }
        if shared.has_stream {
            return Err(MapError::Busy { name: self.name.clone() });
        }
        shared.has_stream = true;
        shared.streams += 1;
        Ok(StreamGuard { map: self.clone() })
    }

    /// Sends a frame to the map's thread; waits while the queue is full. The receiver resolves when the frame
    /// was mapped; it is closed if the thread stopped first. A frame whose time is not later than the newest
    /// frame's gets another time (`frame_times.rs`).
    ///
    /// # Errors
    /// [`MapError::Failed`] if the thread has stopped.
    pub async fn submit(
        &self,
        mut frame: Frame,
    ) -> Result<oneshot::Receiver<FrameOutcome>, MapError> {
        let permit = self
            .frame_slots
            .clone()
            .acquire_owned()
            .await
            .expect("the semaphore of a map is never closed");
        let (reply, outcome) = oneshot::channel();
        let sequence = frame.sequence;
        let (stream, times) = self.give_time(&mut frame);
        let frame = Box::new(frame);
        self.counters.unsettled.fetch_add(1, Ordering::AcqRel);
        let message = Message::Frame { frame, stream, times, permit, reply };
        if self.messages.send(message).await.is_err() {
            self.counters.unsettled.fetch_sub(1, Ordering::AcqRel);
            let reason = self.shared().failure.clone().unwrap_or_else(|| "it was stopped".into());
            return Err(MapError::Failed { name: self.name.clone(), reason });
        }
        self.counters.received.fetch_add(1, Ordering::Relaxed);
        self.shared().received_through = Some(sequence);
        Ok(outcome)
    }

    /// Makes the frame's time later than the newest frame's. Returns the number of its stream, which is
    /// warned once, and the times up to it.
    fn give_time(&self, frame: &mut Frame) -> (u64, FrameTimes) {
        let mut shared = self.shared();
        let given = frame.timestamp_nanos;
        frame.timestamp_nanos = shared.times.next(given);
        let (stream, used) = (shared.streams, frame.timestamp_nanos);
        let is_late = given != 0 && used != given;
        if is_late && std::mem::replace(&mut shared.warned_of_times, stream) != stream {
            tracing::warn!(
                map = self.name,
                sequence = frame.sequence,
                given,
                used,
                "timestamp_nanos is not later than the frame before: the map uses times of its own"
            );
        }
        (stream, shared.times)
    }

    /// Counts a frame that did not pass the checks.
    pub fn count_refused(&self) {
        self.counters.refused.fetch_add(1, Ordering::Relaxed);
    }

    /// Notes what is wrong with the recording that the map was rebuilt from.
    pub fn note_damage(&self, words: String) {
        self.shared().recording_damage = Some(words);
    }

    /// The current status.
    pub fn status(&self) -> MapStatus {
        let (queue_depth, queue_capacity) = self.queue();
        let counters = &self.counters;
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let settled = self.is_settled();
        let shared = self.shared();
        MapStatus {
            name: self.name.clone(),
            revision: read(&counters.revision),
            frames_received: read(&counters.received),
            frames_tracked: read(&counters.tracked),
            frames_lost: read(&counters.lost),
            frames_dropped: read(&counters.dropped),
            frames_refused: read(&counters.refused),
            keyframes: read(&counters.keyframes),
            gaussians: read(&counters.gaussians),
            gpu_bytes: read(&counters.gpu_bytes),
            keyframe_bytes: read(&counters.keyframe_bytes),
            tracking_state: shared.tracking,
            olae_version: read(&counters.olae_version),
            queue_depth,
            queue_capacity,
            settled,
            refinement: shared.refinement,
            failure: shared.failure.clone(),
            recording_damage: shared.recording_damage.clone(),
            input_warnings: shared.input_warnings.clone(),
            up: shared.up,
        }
    }

    /// The sending end of the thread's messages.
    pub(super) fn sender(&self) -> mpsc::Sender<Message> {
        self.messages.clone()
    }

    /// Called by the map's thread: whether work is left beside frames that wait.
    pub(super) fn set_working(&self, working: bool) {
        self.counters.working.store(working, Ordering::Release);
        self.progressed.notify_waiters();
    }

    /// Called by the map's thread: how far the map is refined.
    pub(super) fn set_refinement(&self, refinement: Refinement) {
        if std::mem::replace(&mut self.shared().refinement, refinement) != refinement {
            self.announce(MapEvent::Refinement(refinement));
        }
    }

    /// Called by the map's thread: a frame is discarded because the map has failed.
    pub(super) fn drop_frame(&self) {
        self.counters.dropped.fetch_add(1, Ordering::Relaxed);
        self.counters.unsettled.fetch_sub(1, Ordering::AcqRel);
    }

    /// Called by the map's thread: tells that the map has changed, and updates what a status shows of it.
    pub(super) fn tell_change(&self, live: &LiveMap, up: Option<MapUp>) {
        let counters = &self.counters;
        let write = |counter: &AtomicU64, value| counter.store(value, Ordering::Relaxed);
        write(&counters.revision, live.revision);
        write(&counters.keyframes, live.keyframes.len() as u64);
        write(&counters.gaussians, live.gaussians.len() as u64);
        write(&counters.gpu_bytes, live.gaussians.device_bytes());
        write(&counters.keyframe_bytes, live.keyframes.bytes());
        write(&counters.olae_version, live.online.version());
        self.shared().up = up;
        self.copies.set_outdated();
        self.announce(MapEvent::Revision {
            revision: live.revision,
            gaussians: live.gaussians.len(),
            keyframes: live.keyframes.len(),
        });
    }

    /// Called by the map's thread: a frame is done.
    pub(super) fn finish_frame(&self, outcome: &FrameOutcome) {
        self.shared().tracking = outcome.tracking;
        let counter = match outcome.tracking {
            TrackingState::Tracking => &self.counters.tracked,
            TrackingState::Lost | TrackingState::Empty => &self.counters.lost,
        };
        counter.fetch_add(1, Ordering::Relaxed);
        // Working before settled, so that no reader sees an idle map in between.
        self.set_working(true);
        self.counters.unsettled.fetch_sub(1, Ordering::AcqRel);
        self.announce(MapEvent::Frame(Box::new(outcome.clone())));
        for warning in &outcome.input_warnings {
            self.warn_of_input(outcome.sequence, warning);
        }
    }

    /// Logs and announces what is wrong with the frames, and keeps it for the status: the newest warning of
    /// each kind.
    fn warn_of_input(&self, sequence: u64, warning: &InputWarning) {
        let InputWarning { problem, message } = warning;
        tracing::warn!(sequence, problem = problem.as_str(), "{message}");
        let mut shared = self.shared();
        shared.input_warnings.retain(|other| other.problem != *problem);
        shared.input_warnings.push(warning.clone());
        drop(shared);
        self.announce(MapEvent::InputWarning { sequence, warning: warning.clone() });
    }

    /// The copy that readers get, for the map's thread.
    pub(super) fn copies(&self) -> &Copies {
        &self.copies
    }

    /// Called by the map's thread: gives readers a new copy.
    pub(super) fn publish(&self, snapshot: MapSnapshot) {
        self.copies.put(snapshot);
        self.progressed.notify_waiters();
    }

    /// Why the map takes no more frames, if so.
    pub fn failure(&self) -> Option<String> {
        self.shared().failure.clone()
    }

    /// The map takes no more frames from now on.
    pub(super) fn fail(&self, reason: String) {
        self.shared().failure = Some(reason);
        self.progressed.notify_waiters();
    }

    fn announce(&self, event: MapEvent) {
        let mut shared = self.shared();
        let id = shared.next_event;
        shared.next_event += 1;
        // An error means that nobody watches.
        let _ = self.watchers.send(NumberedEvent { id, event });
    }
}

/// The right to write to a map; one stream holds it at a time.
pub struct StreamGuard {
    map: Arc<Map>,
}

impl StreamGuard {
    /// The map.
    pub fn map(&self) -> &Arc<Map> {
        &self.map
    }
}

impl Drop for StreamGuard {
    fn drop(&mut self) {
        self.map.shared().has_stream = false;
    }
}
