//! A map as the edges see it: a name, a queue of frames to its mapper, a snapshot and a status.
//!
//! In: checked [`Frame`]s. Out: [`FrameOutcome`]s, [`MapSnapshot`]s, [`MapEvent`]s. The edges never
//! touch the live map: the mapper's thread owns it and publishes here.

use super::frame::{Frame, FrameOutcome, Intrinsics, TrackingState};
use super::snapshot::MapSnapshot;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, broadcast, mpsc, oneshot, watch};

/// Events that a slow reader may fall behind by before it misses some.
const EVENT_BACKLOG: usize = 256;
/// Places in the mapper's queue beside those for frames: language results and commands.
pub(super) const CONTROL_SLOTS: usize = 16;

/// What a map answers instead of doing what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// Nobody made it.
    #[error("no map is called {name:?}; GET /v1/maps lists those that there are")]
    NotFound {
        /// The name that was asked for.
        name: String,
    },
    /// The name is taken.
    #[error("a map called {name:?} is there already")]
    AlreadyExists {
        /// The name.
        name: String,
    },
    /// Not a name.
    #[error(
        "{name:?} cannot be a map's name: expected 1 to 64 of A-Z a-z 0-9 . _ - and not a dot first"
    )]
    InvalidName {
        /// What was given.
        name: String,
    },
    /// As many as configured.
    #[error("{limit} maps are there already, as many as mapper.max_maps allows: delete one first")]
    TooMany {
        /// The configured limit.
        limit: usize,
    },
    /// Another sender is writing.
    #[error("map {name:?} has another sender: one stream writes a map at a time")]
    Busy {
        /// The map.
        name: String,
    },
    /// The map has frames of another camera.
    #[error("map {name:?} was opened with another camera: expected {expected:?}, found {found:?}")]
    OtherCamera {
        /// The map.
        name: String,
        /// What the map has.
        expected: Box<Intrinsics>,
        /// What the sender has.
        found: Box<Intrinsics>,
    },
    /// The mapper stopped.
    #[error("map {name:?} takes no more frames: {reason}")]
    Failed {
        /// The map.
        name: String,
        /// Why.
        reason: String,
    },
}

/// What happened, for those who watch.
#[derive(Clone, Debug)]
pub enum MapEvent {
    /// A frame was handled.
    Frame(FrameOutcome),
    /// Readers have a new snapshot.
    Revision {
        /// Its revision.
        revision: u64,
        /// Gaussians in it.
        gaussians: usize,
        /// Keyframes in it.
        keyframes: usize,
    },
}

/// An event with its place in the map's sequence of events.
#[derive(Clone, Debug)]
pub struct NumberedEvent {
    /// 1, 2, 3 … within a map.
    pub id: u64,
    /// What happened.
    pub event: MapEvent,
}

/// Numbers for people and programs.
#[derive(Clone, Debug)]
pub struct MapStatus {
    /// The map's name.
    pub name: String,
    /// Of the newest snapshot.
    pub revision: u64,
    /// Frames that passed the checks.
    pub frames_received: u64,
    /// Of those, with a pose.
    pub frames_tracked: u64,
    /// Of those, without.
    pub frames_lost: u64,
    /// Frames accepted but never mapped.
    pub frames_dropped: u64,
    /// Frames that did not pass the checks.
    pub frames_refused: u64,
    /// Keyframes.
    pub keyframes: u64,
    /// Gaussians.
    pub gaussians: u64,
    /// Device memory of the Gaussians.
    pub gpu_bytes: u64,
    /// Memory of the keyframes' pictures and codes, the device's too.
    pub keyframe_bytes: u64,
    /// What the tracker says.
    pub tracking_state: TrackingState,
    /// Version of the online compressor.
    pub olae_version: u64,
    /// Frames waiting.
    pub queue_depth: usize,
    /// How many may wait.
    pub queue_capacity: usize,
    /// Nothing waits and the mapper has done its work on what it has.
    pub settled: bool,
    /// Why the map takes no more frames, if so.
    pub failure: Option<String>,
}

/// What the mapper's thread is told.
pub(super) enum Event {
    Frame {
        frame: Frame,
        /// Which of the map's senders it is of: 1, 2, 3 …
        sender: u64,
        permit: OwnedSemaphorePermit,
        reply: oneshot::Sender<FrameOutcome>,
    },
    Language {
        sequence: u64,
        map: Result<super::encoder::LanguageMap, String>,
    },
    Stop,
}

/// Numbers that the mapper's thread writes and statuses read.
#[derive(Default)]
pub(super) struct Counters {
    pub received: AtomicU64,
    pub tracked: AtomicU64,
    pub lost: AtomicU64,
    pub dropped: AtomicU64,
    pub refused: AtomicU64,
    pub keyframes: AtomicU64,
    pub gaussians: AtomicU64,
    pub gpu_bytes: AtomicU64,
    pub keyframe_bytes: AtomicU64,
    pub olae_version: AtomicU64,
    /// Frames accepted and not yet answered, plus work left: 0 is settled.
    pub unsettled: AtomicU64,
    pub working: AtomicBool,
}

/// The mutable rest: short critical sections, never held over an await.
struct Shared {
    tracking: TrackingState,
    failure: Option<String>,
    intrinsics: Option<Intrinsics>,
    received_through: Option<u64>,
    has_sender: bool,
    /// How many there were so far.
    senders: u64,
    next_event: u64,
}

/// A map: share it with `Arc`.
pub struct Map {
    name: String,
    queue_capacity: usize,
    frame_slots: Arc<Semaphore>,
    events_in: mpsc::Sender<Event>,
    events_out: broadcast::Sender<NumberedEvent>,
    snapshot: watch::Sender<Arc<MapSnapshot>>,
    pub(super) counters: Counters,
    shared: Mutex<Shared>,
}

impl Map {
    /// A map without a mapper; the receiver is the mapper's.
    pub(super) fn new(
        name: &str,
        queue_capacity: usize,
        empty: MapSnapshot,
    ) -> (Self, mpsc::Receiver<Event>) {
        let (events_in, receiver) = mpsc::channel(queue_capacity + CONTROL_SLOTS);
        let map = Self {
            name: name.to_owned(),
            queue_capacity,
            frame_slots: Arc::new(Semaphore::new(queue_capacity)),
            events_in,
            events_out: broadcast::Sender::new(EVENT_BACKLOG),
            snapshot: watch::Sender::new(Arc::new(empty)),
            counters: Counters::default(),
            shared: Mutex::new(Shared {
                tracking: TrackingState::Empty,
                failure: None,
                intrinsics: None,
                received_through: None,
                has_sender: false,
                senders: 0,
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

    /// The newest snapshot.
    pub fn snapshot(&self) -> Arc<MapSnapshot> {
        self.snapshot.borrow().clone()
    }

    /// Events from now on.
    pub fn subscribe(&self) -> broadcast::Receiver<NumberedEvent> {
        self.events_out.subscribe()
    }

    /// The sequence of the newest accepted frame.
    pub fn received_through(&self) -> Option<u64> {
        self.shared().received_through
    }

    /// Frames waiting, and how many may wait.
    pub fn queue(&self) -> (usize, usize) {
        (self.queue_capacity - self.frame_slots.available_permits(), self.queue_capacity)
    }

    /// Becomes the map's one sender until the returned guard is dropped. Where its camera is, is not
    /// known from where the last one's was: poses that are not given are found in the map.
    ///
    /// # Errors
    /// [`MapError::Busy`] if there is one; [`MapError::OtherCamera`] if the map has frames of a
    /// different camera; [`MapError::Failed`] if it takes no more.
    pub fn claim(self: &Arc<Self>, intrinsics: Intrinsics) -> Result<SenderGuard, MapError> {
        let mut shared = self.shared();
        if let Some(reason) = &shared.failure {
            return Err(MapError::Failed { name: self.name.clone(), reason: reason.clone() });
        }
        if shared.has_sender {
            return Err(MapError::Busy { name: self.name.clone() });
        }
        if let Some(expected) = shared.intrinsics.filter(|expected| *expected != intrinsics) {
            return Err(MapError::OtherCamera {
                name: self.name.clone(),
                expected: Box::new(expected),
                found: Box::new(intrinsics),
            });
        }
        shared.has_sender = true;
        shared.senders += 1;
        Ok(SenderGuard { map: self.clone() })
    }

    /// Hands a frame to the mapper; waits while its queue is full. The receiver resolves when the
    /// frame was tracked, or is dropped if the mapper stopped first.
    ///
    /// # Errors
    /// [`MapError::Failed`] if the mapper has stopped.
    pub async fn submit(&self, frame: Frame) -> Result<oneshot::Receiver<FrameOutcome>, MapError> {
        let permit = self
            .frame_slots
            .clone()
            .acquire_owned()
            .await
            .expect("the semaphore of a map is never closed");
        let (reply, outcome) = oneshot::channel();
        let (sequence, intrinsics) = (frame.sequence, frame.intrinsics);
        let sender = self.shared().senders;
        self.counters.unsettled.fetch_add(1, Ordering::AcqRel);
        if self.events_in.send(Event::Frame { frame, sender, permit, reply }).await.is_err() {
            self.counters.unsettled.fetch_sub(1, Ordering::AcqRel);
            let reason = self.shared().failure.clone().unwrap_or_else(|| "it was stopped".into());
            return Err(MapError::Failed { name: self.name.clone(), reason });
        }
        self.counters.received.fetch_add(1, Ordering::Relaxed);
        let mut shared = self.shared();
        shared.received_through = Some(sequence);
        shared.intrinsics = Some(intrinsics);
        Ok(outcome)
    }

    /// Counts a frame that did not pass the checks.
    pub fn count_refused(&self) {
        self.counters.refused.fetch_add(1, Ordering::Relaxed);
    }

    /// Numbers for people and programs.
    pub fn status(&self) -> MapStatus {
        let (queue_depth, queue_capacity) = self.queue();
        let counters = &self.counters;
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let settled = counters.unsettled.load(Ordering::Acquire) == 0
            && !counters.working.load(Ordering::Acquire);
        let shared = self.shared();
        MapStatus {
            name: self.name.clone(),
            revision: self.snapshot.borrow().revision,
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
            failure: shared.failure.clone(),
        }
    }

    pub(super) fn control(&self) -> mpsc::Sender<Event> {
        self.events_in.clone()
    }

    /// The mapper's: a frame is done.
    pub(super) fn finish_frame(&self, outcome: &FrameOutcome) {
        self.shared().tracking = outcome.tracking;
        let counter = match outcome.tracking {
            TrackingState::Tracking => &self.counters.tracked,
            TrackingState::Lost | TrackingState::Empty => &self.counters.lost,
        };
        counter.fetch_add(1, Ordering::Relaxed);
        self.announce(MapEvent::Frame(outcome.clone()));
    }

    /// The mapper's: readers get a new snapshot.
    pub(super) fn publish(&self, snapshot: MapSnapshot) {
        let event = MapEvent::Revision {
            revision: snapshot.revision,
            gaussians: snapshot.gaussians.means.len(),
            keyframes: snapshot.keyframes.len(),
        };
        self.snapshot.send_replace(Arc::new(snapshot));
        self.announce(event);
    }

    /// Why the map takes no more frames, if so.
    pub fn failure(&self) -> Option<String> {
        self.shared().failure.clone()
    }

    /// The mapper's: the map takes no more frames.
    pub(super) fn fail(&self, reason: String) {
        self.shared().failure = Some(reason);
    }

    fn announce(&self, event: MapEvent) {
        let mut shared = self.shared();
        let id = shared.next_event;
        shared.next_event += 1;
        // Nobody listening is fine.
        let _ = self.events_out.send(NumberedEvent { id, event });
    }
}

/// Holds a map's one place for a sender.
pub struct SenderGuard {
    map: Arc<Map>,
}

impl SenderGuard {
    /// The map.
    pub fn map(&self) -> &Arc<Map> {
        &self.map
    }
}

impl Drop for SenderGuard {
    fn drop(&mut self) {
        self.map.shared().has_sender = false;
    }
}
