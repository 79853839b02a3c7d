//! Copying the state of a map, and going on from it.

use super::super::checkpoint::{Checkpoint, Progress};
use super::super::frame::TrackingState;
use super::{Map, MapError, Message, StreamGuard};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::oneshot;

impl Map {
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
