//! Which worker has which map.
//!
//! A lease is an entry that its worker renews. If it is not renewed for `fleet.lease_seconds`, another worker
//! may take it: JetStream lets one of them. The revision of the entry at that time is the fencing token: each
//! owner has a greater one than all before.

use super::bus::{Bus, Failed, key};
use super::follow::{Seen, Table};
use async_nats::jetstream::kv::{CreateErrorKind, UpdateErrorKind};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// An entry.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Lease {
    pub worker: String,
    /// Where the worker's gRPC is.
    pub grpc: String,
    /// Where the worker's HTTP is.
    pub http: String,
    /// The fencing token; 0 in an entry that was not renewed yet, whose revision it is.
    token: u64,
    /// Whether the worker has loaded the map.
    pub is_ready: bool,
}

impl Seen<Lease> {
    /// The fencing token.
    pub(super) fn token(&self) -> u64 {
        if self.value.token == 0 { self.revision } else { self.value.token }
    }

    /// Whether it was not renewed for so long.
    pub(super) fn is_over(&self, lease: Duration) -> bool {
        self.since.elapsed() > lease
    }
}

/// A lease of this worker.
#[derive(Clone, Debug)]
pub(super) struct Held {
    pub map: String,
    pub token: u64,
    lease: Lease,
    revision: u64,
}

/// What became of a renewal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Renewed {
    Yes,
    /// Another worker has the map, or nobody.
    Lost,
    /// NATS does not answer.
    Unknown,
}

/// Takes a map if nobody has it, or if its lease is over. Returns nothing if another worker was faster.
///
/// # Errors
/// [`Failed`].
pub(super) async fn take(
    bus: &Bus,
    table: &Table<Lease>,
    map: &str,
    mine: &Lease,
) -> Result<Option<Held>, Failed> {
    let value = json(&Lease { token: 0, is_ready: false, ..mine.clone() });
    let revision = match table.get(map) {
        None => match bus.leases.create(key(map), value).await {
            Ok(revision) => revision,
            Err(error) if error.kind() == CreateErrorKind::AlreadyExists => return Ok(None),
            Err(error) => return Err(Failed::new("taking a lease", error)),
        },
        Some(seen) => match bus.leases.update(key(map), value, seen.revision).await {
            Ok(revision) => revision,
            Err(error) if error.kind() == UpdateErrorKind::WrongLastRevision => return Ok(None),
            Err(error) => return Err(Failed::new("taking a lease", error)),
        },
    };
    let lease = Lease { token: revision, is_ready: false, ..mine.clone() };
    Ok(Some(Held { map: map.to_owned(), token: revision, lease, revision }))
}

impl Held {
    /// Tells that this worker is there, and whether the map is loaded.
    pub(super) async fn renew(&mut self, bus: &Bus, is_ready: bool) -> Renewed {
        self.lease.is_ready = is_ready;
        match bus.leases.update(key(&self.map), json(&self.lease), self.revision).await {
            Ok(revision) => {
                self.revision = revision;
                Renewed::Yes
            }
            Err(error) if error.kind() == UpdateErrorKind::WrongLastRevision => {
                self.after_conflict(bus).await
            }
            Err(error) => {
                tracing::warn!(%error, map = self.map, "a lease is not renewed: trying again");
                Renewed::Unknown
            }
        }
    }

    /// A renewal whose answer was lost looks like a conflict too.
    async fn after_conflict(&mut self, bus: &Bus) -> Renewed {
        match bus.leases.entry(key(&self.map)).await {
            Ok(Some(entry)) => match serde_json::from_slice::<Lease>(&entry.value) {
                Ok(lease) if lease.token == self.token && lease.worker == self.lease.worker => {
                    self.revision = entry.revision;
                    Renewed::Yes
                }
                _ => Renewed::Lost,
            },
            Ok(None) => Renewed::Lost,
            Err(_) => Renewed::Unknown,
        }
    }

    /// Gives the map to whoever wants it. If this fails, the lease runs out.
    pub(super) async fn release(self, bus: &Bus) {
        let released = bus.leases.delete_expect_revision(key(&self.map), Some(self.revision)).await;
        if let Err(error) = released {
            tracing::info!(%error, map = self.map, "a lease was not released: it runs out");
        }
    }
}

impl Lease {
    /// A lease of a worker.
    pub(super) fn of(worker: &str, grpc: &str, http: &str) -> Self {
        let [worker, grpc, http] = [worker, grpc, http].map(str::to_owned);
        Self { worker, grpc, http, token: 0, is_ready: false }
    }
}

fn json(lease: &Lease) -> prost::bytes::Bytes {
    serde_json::to_vec(lease).expect("texts and numbers are JSON").into()
}
