//! The newest events of each map that clients watch, bounded in number.
//!
//! Every client reads from the log at its own pace: a slow client does not delay the others.

use crate::pipeline::map::{Map, NumberedEvent};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, Weak};
use tokio::sync::{broadcast, watch};

/// The newest events of a map, in a ring buffer.
pub(super) struct EventLog {
    map: Weak<Map>,
    ring: Mutex<VecDeque<NumberedEvent>>,
    /// Id of the newest event; closed when the map is deleted.
    newest: watch::Receiver<u64>,
}

/// The event logs of the maps that clients have watched, by the maps' names.
pub(super) struct EventLogs {
    /// Events kept for each map.
    backlog: usize,
    logs: Mutex<BTreeMap<String, Arc<EventLog>>>,
}

impl EventLogs {
    pub(super) fn new(backlog: usize) -> Self {
        Self { backlog, logs: Mutex::default() }
    }

    /// The event log of a map; started when the first client watches the map.
    pub(super) fn of(&self, map: &Arc<Map>) -> Arc<EventLog> {
        let mut logs = self.logs.lock().expect("no thread panics while it holds the event logs");
        logs.retain(|_, log| log.map.strong_count() > 0);
        let this = Arc::downgrade(map);
        match logs.get(map.name()) {
            Some(log) if log.map.ptr_eq(&this) => log.clone(),
            _ => {
                let (newest_in, newest) = watch::channel(0);
                let log = Arc::new(EventLog { map: this, ring: Mutex::default(), newest });
                logs.insert(map.name().into(), log.clone());
                tokio::spawn(record(log.clone(), map.subscribe(), newest_in, self.backlog));
                log
            }
        }
    }
}

/// Copies events into the log until the map is deleted.
async fn record(
    log: Arc<EventLog>,
    mut events: broadcast::Receiver<NumberedEvent>,
    newest: watch::Sender<u64>,
    backlog: usize,
) {
    loop {
        match events.recv().await {
            Ok(event) => {
                let id = event.id;
                let mut ring = log.ring();
                if ring.len() == backlog {
                    ring.pop_front();
                }
                ring.push_back(event);
                drop(ring);
                newest.send_replace(id);
            }
            // Readers notice the gap in the ids.
            Err(broadcast::error::RecvError::Lagged(_)) => {}
            Err(broadcast::error::RecvError::Closed) => return,
        }
    }
}

impl EventLog {
    /// Id of the newest event, as it changes.
    pub(super) fn newest(&self) -> watch::Receiver<u64> {
        self.newest.clone()
    }

    fn ring(&self) -> std::sync::MutexGuard<'_, VecDeque<NumberedEvent>> {
        self.ring.lock().expect("no thread panics while it holds the events")
    }

    /// The first kept event with an id above `seen`.
    pub(super) fn after(&self, seen: u64) -> Option<NumberedEvent> {
        let ring = self.ring();
        let at = ring.partition_point(|event| event.id <= seen);
        ring.get(at).cloned()
    }
}

#[cfg(test)]
pub(super) mod samples {
    use super::*;
    use crate::pipeline::map::MapEvent;

    pub(in crate::http) fn numbered(id: u64) -> NumberedEvent {
        let event = MapEvent::Revision { revision: id, gaussians: 0, keyframes: 0 };
        NumberedEvent { id, event }
    }

    /// A log with these events.
    pub(in crate::http) fn log(
        ids: impl Iterator<Item = u64>,
        newest: watch::Receiver<u64>,
    ) -> Arc<EventLog> {
        let ring = Mutex::new(ids.map(numbered).collect());
        Arc::new(EventLog { map: Weak::new(), ring, newest })
    }
}

#[cfg(test)]
mod tests {
    use super::samples::{log, numbered};
    use super::*;

    #[tokio::test]
    async fn the_log_keeps_the_newest() {
        let (events, receiver) = broadcast::channel(16);
        let (newest_in, newest) = watch::channel(0);
        let log = log(0..0, newest);
        let recording = tokio::spawn(record(log.clone(), receiver, newest_in, 3));
        for id in 1..=5 {
            events.send(numbered(id)).unwrap();
        }
        drop(events);
        recording.await.unwrap();
        let ids: Vec<u64> = log.ring().iter().map(|event| event.id).collect();
        assert_eq!(ids, [3, 4, 5]);
        assert_eq!(*log.newest.borrow(), 5);
    }
}
