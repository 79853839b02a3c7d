//! What a reader gets of a map, and what it may wait for.

use super::super::snapshot::MapSnapshot;
use super::copies::Told;
use super::{Map, Message};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::Instant;

/// The longest time that a reader waits for a copy of the map as it is.
const COPY_PATIENCE: Duration = Duration::from_secs(30);

/// What a reader waits for, and how long at most. Afterwards it gets what there is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wait {
    /// Until the map has done all its work on the frames that it has received.
    pub settled: bool,
    /// Until it has also been refined.
    pub converged: bool,
    /// Until readers see the map after this frame.
    pub min_sequence: Option<u64>,
    /// How long.
    pub longest: Duration,
}

/// A snapshot, and whether it is the last one of the frames that were received.
#[derive(Clone)]
pub struct Reading {
    /// The newest snapshot.
    pub snapshot: Arc<MapSnapshot>,
    /// Whether no frame waited and no work was left when it was taken.
    pub settled: bool,
    /// Whether the map had been refined as well, or never is.
    pub converged: bool,
}

impl Reading {
    /// Whether this is what was waited for.
    pub(super) fn is_enough(&self, wait: &Wait) -> bool {
        let has_frame =
            wait.min_sequence.is_none_or(|wanted| self.snapshot.through >= Some(wanted));
        has_frame && (self.settled || !wait.settled) && (self.converged || !wait.converged)
    }
}

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
}
