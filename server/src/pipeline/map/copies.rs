//! The copy of a map that readers get, and whether another one is to be made.
//!
//! In: from the map's thread, that the map has changed, and copies. Out: to readers, the newest copy. Nothing
//! is copied while nobody reads: a reader says that a copy is wanted, and the thread makes it. Neither waits
//! for a lock of the other.

use super::super::snapshot::MapSnapshot;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::watch;

/// Between a map's thread and its readers.
pub(in super::super) struct Copies {
    newest: watch::Sender<Arc<MapSnapshot>>,
    /// Whether the map has changed since the newest copy.
    outdated: AtomicBool,
    /// Whether somebody has read since the thread last began to make a copy.
    wanted: AtomicBool,
}

/// What a reader is told.
pub(super) struct Told {
    /// The newest copy.
    pub snapshot: Arc<MapSnapshot>,
    /// Whether a newer one is to come.
    pub outdated: bool,
    /// Whether the reader is the first one to want it, so that the thread has to be told.
    pub is_first: bool,
}

// A reader first writes `wanted` and then reads `outdated`; the thread first writes `outdated` and then reads
// `wanted`. In the one order that all of these have, at least one of the two sees what the other has written,
// so that no reader waits for a copy that nobody makes.
const ORDER: Ordering = Ordering::SeqCst;

impl Copies {
    pub(super) fn new(empty: MapSnapshot) -> Self {
        Self {
            newest: watch::Sender::new(Arc::new(empty)),
            outdated: AtomicBool::new(false),
            wanted: AtomicBool::new(false),
        }
    }

    /// Called by readers: says that they read, and gives them the newest copy.
    pub(super) fn ask(&self) -> Told {
        let is_first = !self.wanted.swap(true, ORDER);
        let outdated = self.outdated.load(ORDER);
        Told { snapshot: self.newest(), outdated, is_first }
    }

    /// The newest copy, without saying that somebody reads.
    pub(in super::super) fn newest(&self) -> Arc<MapSnapshot> {
        self.newest.borrow().clone()
    }

    /// Called by the thread: the map has changed.
    pub(super) fn set_outdated(&self) {
        self.outdated.store(true, ORDER);
    }

    /// Called by the thread: whether the map has changed since the newest copy.
    pub(in super::super) fn is_outdated(&self) -> bool {
        self.outdated.load(ORDER)
    }

    /// Called by the thread: whether to make a copy, because the newest one is outdated and somebody reads.
    pub(in super::super) fn is_due(&self) -> bool {
        self.is_outdated() && self.wanted.load(ORDER)
    }

    /// Called by the thread when it begins to make a copy: readers from now on want the next one.
    pub(in super::super) fn begin(&self) {
        self.wanted.store(false, ORDER);
    }

    /// Called by the thread: the map as it is now.
    pub(super) fn put(&self, snapshot: MapSnapshot) {
        self.newest.send_replace(Arc::new(snapshot));
        self.outdated.store(false, ORDER);
    }
}
