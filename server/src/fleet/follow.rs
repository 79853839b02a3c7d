//! Following a bucket: its entries as they are now, each with the time since when it is unchanged.
//!
//! Times are taken by this machine's monotonic clock. No clock of another machine, and no time of day,
//! matters.

use super::bus::map_of;
use async_nats::jetstream::kv::{Entry, Operation, Store};
use futures::StreamExt as _;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

/// Between two tries to follow a bucket.
const AGAIN: Duration = Duration::from_millis(500);

/// An entry as it was last heard of.
#[derive(Clone, Debug)]
pub(super) struct Seen<T> {
    pub value: T,
    pub revision: u64,
    /// When this machine heard of the revision.
    pub since: Instant,
}

/// The entries of a bucket, by map or worker. Cheap to clone.
#[derive(Clone)]
pub(super) struct Table<T> {
    entries: Arc<Mutex<BTreeMap<String, Seen<T>>>>,
    changes: watch::Sender<u64>,
    counts: fn(&T) -> bool,
}

impl<T: DeserializeOwned + Clone + Send + 'static> Table<T> {
    /// Follows a bucket until `stopping` is cancelled. Returns when the table has all that is there now.
    pub(super) async fn follow(store: Store, stopping: CancellationToken) -> Self {
        Self::follow_those(store, |_| true, stopping).await
    }

    /// The same with those entries only that `counts` accepts.
    pub(super) async fn follow_those(
        store: Store,
        counts: fn(&T) -> bool,
        stopping: CancellationToken,
    ) -> Self {
        let table = Self { entries: Arc::default(), changes: watch::Sender::new(0), counts };
        let (following, ready) = (table.clone(), Arc::new(tokio::sync::Notify::new()));
        let told = ready.clone();
        tokio::spawn(async move {
            tokio::select! {
                () = following.keep_following(&store, &told) => {}
                () = stopping.cancelled() => {}
            }
        });
        ready.notified().await;
        table
    }

    async fn keep_following(&self, store: &Store, ready: &tokio::sync::Notify) {
        loop {
            match store.watch_with_history(">").await {
                Ok(mut watch) => {
                    if is_empty(store).await {
                        ready.notify_one();
                    }
                    while let Some(entry) = watch.next().await {
                        match entry {
                            Ok(entry) => {
                                let is_all = entry.delta == 0;
                                self.note(entry);
                                if is_all {
                                    ready.notify_one();
                                }
                            }
                            Err(error) => {
                                tracing::warn!(%error, bucket = store.name, "following again");
                                break;
                            }
                        }
                    }
                }
                Err(error) => tracing::warn!(%error, bucket = store.name, "cannot follow a bucket"),
            }
            tokio::time::sleep(AGAIN).await;
        }
    }

    fn note(&self, entry: Entry) {
        let (key, revision) = (map_of(&entry.key), entry.revision);
        let mut entries = self.locked();
        match (&entry.operation, entries.get(&key)) {
            // Told again.
            (_, Some(known)) if known.revision >= revision => return,
            (Operation::Put, _) => match serde_json::from_slice(&entry.value) {
                Ok(value) if (self.counts)(&value) => {
                    let since = Instant::now();
                    entries.insert(key, Seen { value, revision, since });
                }
                Ok(_) => drop(entries.remove(&key)),
                Err(error) => tracing::error!(%error, key, "an entry cannot be read"),
            },
            (Operation::Delete | Operation::Purge, _) => {
                entries.remove(&key);
            }
        }
        drop(entries);
        self.changes.send_modify(|count| *count += 1);
    }
}

/// Whether a bucket has nothing to tell at first.
async fn is_empty(store: &Store) -> bool {
    store.status().await.is_ok_and(|status| status.values() == 0)
}

impl<T: Clone> Table<T> {
    fn locked(&self) -> MutexGuard<'_, BTreeMap<String, Seen<T>>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn get(&self, key: &str) -> Option<Seen<T>> {
        self.locked().get(key).cloned()
    }

    /// All entries, by key.
    pub(super) fn all(&self) -> Vec<(String, Seen<T>)> {
        self.locked().iter().map(|(key, seen)| (key.clone(), seen.clone())).collect()
    }

    /// Resolves at each change.
    pub(super) fn changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
    }
}
