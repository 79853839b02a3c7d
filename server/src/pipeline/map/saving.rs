//! Copying a map for readers, and its whole state; and going on from that.

use super::super::checkpoint::{Checkpoint, Progress};
use super::super::frame::TrackingState;
use super::super::snapshot::MapSnapshot;
use super::copies::Told;
use super::{Map, MapError, Message, Reading, StreamGuard, Wait};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::time::Instant;

/// The longest time that a reader waits for a copy of the map as it is.
const COPY_PATIENCE: Duration = Duration::from_secs(30);

impl Map {
    /// The map as it is now.
    pub async fn snapshot(&self) -> Arc<MapSnapshot> {
        self.read(&Wait::default()).await.snapshot
    }

    /// A copy of the map, once it is what `wait` asks for or the time is over. If the newest copy is
    /// outdated the thread makes another one, between two steps; with the clock `per_frame` when the map is
    /// idle. A map that has failed is not waited for.
    pub async fn read(&self, wait: &Wait) -> Reading {
        let began = Instant::now();
        if wait.converged {
            // An error means that the thread has stopped, or that its queue is full for so long.
            let refine = self.messages.send(Message::Refine);
            let _ = tokio::time::timeout_at(began + wait.longest, refine).await;
        }
        loop {
            let progressed = self.progressed.notified();
            tokio::pin!(progressed);
            progressed.as_mut().enable();
            // In this order: the last copy of a settled map has all of it.
            let settled = self.is_settled();
            let converged = settled && self.shared().refinement.is_done();
            let Told { snapshot, outdated, is_first } = self.copies.ask();
            if outdated && is_first {
                // A thread that has no room for messages looks by itself after each of them.
                let _ = self.messages.try_send(Message::CopyWanted);
            }
            let [settled, converged] = [settled, converged].map(|done| done && !outdated);
            let reading = Reading { snapshot, settled, converged };
            let has_ended = self.messages.is_closed() || self.failure().is_some();
            if has_ended || !outdated && reading.is_enough(wait) {
                return reading;
            }
            let patience = if outdated { wait.longest.max(COPY_PATIENCE) } else { wait.longest };
            if tokio::time::timeout_at(began + patience, progressed).await.is_err() {
                return reading;
            }
        }
    }

    /// As [`Map::claim`], to go on with the last stream: the camera is where it was.
    ///
    /// # Errors
    /// As [`Map::claim`].
    pub fn reclaim(self: &Arc<Self>) -> Result<StreamGuard, MapError> {
        let guard = self.claim()?;
        let mut shared = self.shared();
        shared.streams = shared.streams.saturating_sub(1);
        drop(shared);
        Ok(guard)
    }

    /// Copies the whole state of the map, from which it can be continued exactly. With the clock `per_frame`
    /// this waits for the steps and the language of the last frame.
    ///
    /// # Errors
    /// The reason, if the map has failed or was stopped.
    pub async fn save(&self) -> Result<Checkpoint, String> {
        let (reply, saved) = oneshot::channel();
        let stopped = || self.failure().unwrap_or_else(|| "it was stopped".into());
        self.messages.send(Message::Save(reply)).await.map_err(|_| stopped())?;
        saved.await.map_err(|_| stopped())?
    }

    /// Called by the map's thread: adds what is only known here to how far the map has come.
    pub(in super::super) fn save_progress(&self, progress: &mut Progress) {
        let shared = self.shared();
        progress.input_warnings.clone_from(&shared.input_warnings);
        progress.next_event = shared.next_event;
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        progress.frames_tracked = read(&self.counters.tracked);
        progress.frames_lost = read(&self.counters.lost);
        progress.frames_refused = read(&self.counters.refused);
    }

    /// Puts back what [`Map::save_progress`] and the thread saved, before the first frame.
    pub(in super::super) fn restore_progress(&self, progress: Progress, tracking: TrackingState) {
        let Progress { through, stream, times, input_warnings, next_event, .. } = progress;
        let Progress { frames_tracked, frames_lost, frames_refused, .. } = progress;
        let write = |counter: &AtomicU64, value| counter.store(value, Ordering::Relaxed);
        write(&self.counters.received, frames_tracked + frames_lost);
        write(&self.counters.tracked, frames_tracked);
        write(&self.counters.lost, frames_lost);
        write(&self.counters.refused, frames_refused);
        let mut shared = self.shared();
        shared.tracking = tracking;
        shared.input_warnings = input_warnings;
        shared.received_through = through;
        shared.streams = stream;
        shared.times = times;
        shared.next_event = next_event;
    }
}
