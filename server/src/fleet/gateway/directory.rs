//! Which worker to ask about a map.

use super::super::bus::Bus;
use super::super::follow::{Seen, Table};
use super::super::leases::Lease;
use super::super::registry::{self, MapEntry};
use super::super::worker::Announcement;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;
use tonic::transport::{Channel, Endpoint};

/// Between two looks for a worker.
const LOOK_AGAIN: Duration = Duration::from_millis(50);
/// How long a connection to a worker may take.
const CONNECT: Duration = Duration::from_secs(3);

/// Between two looks whether a worker is alive, and how long it may take to say so.
const ALIVE: Duration = Duration::from_secs(5);

/// Why no worker can be asked.
#[derive(Debug, thiserror::Error)]
pub(super) enum NoWorker {
    #[error("there is no map {map:?}")]
    NoMap { map: String },
    #[error("map {map:?} is being loaded by a worker. Try again in a few seconds")]
    Loading { map: String },
    #[error("no worker has map {map:?} yet: one will, or the fleet needs more workers")]
    Nobody { map: String },
}

/// A worker that is asked about a map.
#[derive(Clone, Debug)]
pub(super) struct Asked {
    /// Where its gRPC is.
    pub grpc: String,
    /// Where its HTTP is.
    pub http: String,
    /// How old the checkpoint is that it answers from; `None` if it is the owner.
    pub age: Option<Duration>,
}

/// The maps and the workers that have them. Cheap to clone.
#[derive(Clone)]
pub(super) struct Directory {
    maps: Table<MapEntry>,
    leases: Table<Lease>,
    workers: Table<Announcement>,
    /// Counts the questions that may be answered by several workers: they take turns.
    turn: Arc<AtomicUsize>,
    lease_time: Duration,
    /// How long callers wait for a worker.
    wait: Duration,
    channels: Arc<Mutex<BTreeMap<String, Channel>>>,
}

impl Directory {
    pub(super) async fn new(
        bus: &Bus,
        lease_time: Duration,
        wait: Duration,
        stopping: &CancellationToken,
    ) -> Self {
        Self {
            maps: registry::follow(bus, stopping.clone()).await,
            leases: Table::follow(bus.leases.clone(), stopping.clone()).await,
            workers: Table::follow(bus.workers.clone(), stopping.clone()).await,
            turn: Arc::default(),
            lease_time,
            wait,
            channels: Arc::default(),
        }
    }

    /// Names of all maps.
    pub(super) fn maps(&self) -> Vec<String> {
        self.maps.all().into_iter().map(|(map, _)| map).collect()
    }

    /// Number of maps that no worker has.
    pub(super) fn unowned(&self) -> usize {
        let has_worker = |map: &String| self.lease(map).is_some();
        self.maps().iter().filter(|map| !has_worker(map)).count()
    }

    fn lease(&self, map: &str) -> Option<Lease> {
        let seen = self.leases.get(map)?;
        (!seen.is_over(self.lease_time)).then_some(seen.value)
    }

    /// The worker that has loaded a map.
    ///
    /// # Errors
    /// [`NoWorker`].
    pub(super) fn worker(&self, map: &str) -> Result<Lease, NoWorker> {
        let map_name = || map.to_owned();
        if self.maps.get(map).is_none() {
            return Err(NoWorker::NoMap { map: map_name() });
        }
        match self.lease(map) {
            Some(lease) if lease.is_ready => Ok(lease),
            Some(_) => Err(NoWorker::Loading { map: map_name() }),
            None => Err(NoWorker::Nobody { map: map_name() }),
        }
    }

    /// The same; waits for it, but not for long.
    ///
    /// # Errors
    /// [`NoWorker`].
    pub(super) async fn worker_soon(&self, map: &str) -> Result<Lease, NoWorker> {
        let began = Instant::now();
        loop {
            match self.worker(map) {
                Err(NoWorker::Loading { .. } | NoWorker::Nobody { .. })
                    if began.elapsed() < self.wait =>
                {
                    tokio::time::sleep(LOOK_AGAIN).await;
                }
                found => return found,
            }
        }
    }

    /// The worker to ask about a map, whose answer may be this old. Without a limit it is the owner. Waits
    /// for one, but not for long.
    ///
    /// # Errors
    /// [`NoWorker`].
    pub(super) async fn asked(
        &self,
        map: &str,
        max_staleness: Option<Duration>,
    ) -> Result<Asked, NoWorker> {
        let readers = max_staleness.map(|most| self.readers(map, most)).unwrap_or_default();
        let owner = match readers.is_empty() {
            true => self.worker_soon(map).await,
            false => self.worker(map),
        };
        let owner = owner.map(|Lease { grpc, http, .. }| Asked { grpc, http, age: None });
        let mut all: Vec<Asked> = owner.as_ref().ok().into_iter().cloned().collect();
        all.extend(readers.into_iter().filter(|reader| {
            owner.as_ref().is_ok_and(|owner| owner.http != reader.http) || owner.is_err()
        }));
        if all.is_empty() {
            return owner;
        }
        let turn = self.turn.fetch_add(1, Ordering::Relaxed) % all.len();
        Ok(all.swap_remove(turn))
    }

    /// Workers that can load the newest checkpoint of a map, if it is at most so old.
    fn readers(&self, map: &str, most: Duration) -> Vec<Asked> {
        let saved = self.maps.get(map).and_then(|seen| seen.value.checkpoint);
        let Some(saved) = saved.filter(|saved| saved.age() <= most) else { return Vec::new() };
        let workers = self.workers.all().into_iter().filter(|(_, seen)| {
            !seen.is_gone(self.lease_time) && seen.value.fingerprint == saved.fingerprint
        });
        let asked = |(_, seen): (String, Seen<Announcement>)| {
            let Announcement { grpc, http, .. } = seen.value;
            Asked { grpc, http, age: Some(saved.age()) }
        };
        workers.map(asked).collect()
    }

    /// Whether the worker with this HTTP address has a map itself.
    pub(super) fn is_owner(&self, http: &str, map: &str) -> bool {
        self.lease(map).is_some_and(|lease| lease.http == http)
    }

    /// Addresses of gRPC and HTTP of all workers that have maps.
    pub(super) fn workers(&self) -> BTreeSet<(String, String)> {
        let leases = self.leases.all().into_iter();
        let living = leases.filter(|(_, seen)| !seen.is_over(self.lease_time));
        living.map(|(_, seen)| (seen.value.grpc, seen.value.http)).collect()
    }

    /// A connection to the gRPC of a worker.
    ///
    /// # Errors
    /// The reason why its address is none.
    pub(super) fn channel(&self, grpc: &str) -> Result<Channel, tonic::transport::Error> {
        let mut channels = self.channels.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(channel) = channels.get(grpc) {
            return Ok(channel.clone());
        }
        let endpoint = Endpoint::from_shared(format!("http://{grpc}"))?;
        let endpoint = endpoint.connect_timeout(CONNECT).keep_alive_while_idle(true);
        // Who does not answer is gone: questions must not wait for it.
        let endpoint = endpoint.http2_keep_alive_interval(ALIVE).keep_alive_timeout(ALIVE);
        let channel = endpoint.connect_lazy();
        channels.insert(grpc.to_owned(), channel.clone());
        Ok(channel)
    }
}
