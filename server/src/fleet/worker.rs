//! A worker: takes maps that nobody has, and has them until it stops or loses them.

use super::bus::Bus;
use super::config::FleetConfig;
use super::copies::Copies;
use super::follow::{Seen, Table};
use super::leases::{self, Held, Lease, Renewed};
use super::pump::{self, Progress, PumpError};
use super::registry::{self, MapEntry};
use super::saver::Terms;
use crate::check::Limits;
use crate::pipeline::engine::Engine;
use crate::telemetry::{
    FLEET_CHECKPOINT_FAILURES, FLEET_LEASES_LOST, FLEET_MAPS_OWNED, FLEET_TAKEOVERS,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// In a lease's time, a worker renews it so many times.
const RENEWALS: u32 = 3;
/// A worker that is not heard of for so many leases is gone.
const GONE_AFTER: u32 = 3;
/// The most steps of a quarter of a lease that a worker leaves to better placed ones.
const MOST_STEPS: u32 = 4;
/// For how many leases a worker leaves a map alone that it could not load.
const LEFT_ALONE: u32 = 12;

/// What a worker tells of itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Announcement {
    /// Where its gRPC is.
    pub grpc: String,
    /// Where its HTTP is.
    pub http: String,
    /// Of what decides what a map becomes; checkpoints go from one worker to another if it is equal.
    pub fingerprint: String,
    /// Maps that it has.
    maps: usize,
    /// The most maps that it may have.
    max_maps: usize,
    /// Memory of its maps on the device and the host, bytes.
    bytes: u64,
}

/// A map that this worker has.
struct Owned {
    held: Held,
    progress: Arc<Progress>,
    pump: JoinHandle<Result<(), PumpError>>,
}

/// A worker of a fleet.
pub(crate) struct Worker {
    terms: Terms,
    name: String,
    lease: Lease,
    lease_time: Duration,
    leases: Table<Lease>,
    maps: Table<MapEntry>,
    workers: Table<Announcement>,
    owned: BTreeMap<String, Owned>,
    /// Since when maps are free, as this worker sees it.
    free_since: BTreeMap<String, Instant>,
    /// Until when maps are left alone.
    left_alone: BTreeMap<String, Instant>,
}

impl Worker {
    /// A worker that listens on these addresses, for gRPC and HTTP.
    pub(crate) async fn new(
        bus: Bus,
        engine: Arc<Engine>,
        config: &FleetConfig,
        limits: Limits,
        checkpoint_every: Duration,
        addresses: [SocketAddr; 2],
        stopping: &CancellationToken,
    ) -> Self {
        let name = config.name.clone().unwrap_or_else(own_name);
        let [grpc, http] = reached_at(config, addresses);
        let following = stopping.clone();
        let known = registry::follow(&bus, following.clone()).await;
        let copies = Copies::new(bus.clone(), engine.clone(), known.clone());
        Self {
            lease: Lease::of(&name, &grpc, &http),
            lease_time: Duration::from_secs_f64(config.lease_seconds),
            leases: Table::follow(bus.leases.clone(), following.clone()).await,
            maps: known,
            workers: Table::follow(bus.workers.clone(), following).await,
            terms: Terms { bus, engine, limits, checkpoint_every, trim: config.trim, copies },
            name,
            owned: BTreeMap::new(),
            free_since: BTreeMap::new(),
            left_alone: BTreeMap::new(),
        }
    }

    /// Maps of other workers that can be read here.
    pub(crate) fn copies(&self) -> Copies {
        self.terms.copies.clone()
    }

    /// The name under which gateways reach its HTTP.
    pub(crate) fn host(&self) -> String {
        let http = &self.lease.http;
        http.rsplit_once(':').map_or(http.as_str(), |(host, _)| host).to_owned()
    }

    /// Works until `stopping` is cancelled; then writes checkpoints and gives the maps to others.
    pub(crate) async fn run(mut self, stopping: CancellationToken) {
        tracing::info!(worker = self.name, "a worker of the fleet");
        for counter in [FLEET_TAKEOVERS, FLEET_LEASES_LOST, FLEET_CHECKPOINT_FAILURES] {
            metrics::counter!(counter).increment(0);
        }
        let mut tick = tokio::time::interval(self.lease_time / RENEWALS);
        tick.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let (mut leases, mut maps) = (self.leases.changes(), self.maps.changes());
        while !stopping.is_cancelled() {
            tokio::select! {
                () = stopping.cancelled() => break,
                _ = tick.tick() => {
                    self.renew().await;
                    self.announce().await;
                    self.terms.copies.tidy().await;
                }
                _ = leases.changed() => {}
                _ = maps.changed() => {}
            }
            self.give_up().await;
            self.take().await;
        }
        self.stop().await;
    }

    async fn renew(&mut self) {
        let bus = &self.terms.bus;
        let renewed = self.owned.values_mut().map(|owned| async move {
            let is_ready = owned.progress.is_ready.load(Ordering::Relaxed);
            if owned.held.renew(bus, is_ready).await == Renewed::Lost {
                tracing::warn!(map = owned.held.map, token = owned.held.token, "lost a map");
                metrics::counter!(FLEET_LEASES_LOST).increment(1);
                owned.progress.lost.cancel();
            }
        });
        futures::future::join_all(renewed).await;
    }

    async fn announce(&self) {
        let value = serde_json::to_vec(&self.announcement()).expect("texts and numbers are JSON");
        let told = self.terms.bus.workers.put(&self.name, value.into());
        // Leases have to be renewed in time.
        match tokio::time::timeout(self.lease_time / RENEWALS, told).await {
            Ok(Ok(_)) => {}
            _ => tracing::warn!("the fleet was not told of this worker: trying again"),
        }
    }

    fn announcement(&self) -> Announcement {
        let statuses = self.terms.engine.maps().into_iter().map(|map| map.status());
        Announcement {
            grpc: self.lease.grpc.clone(),
            http: self.lease.http.clone(),
            fingerprint: self.terms.engine.fingerprint().to_owned(),
            maps: self.owned.len(),
            max_maps: self.terms.engine.max_maps(),
            bytes: statuses.map(|status| status.gpu_bytes + status.keyframe_bytes).sum(),
        }
    }

    /// Ends the pumps of maps that were lost or deleted, and forgets those that ended.
    async fn give_up(&mut self) {
        for (map, owned) in &self.owned {
            let is_other = self.leases.get(map).is_some_and(|seen| seen.token() > owned.held.token);
            let id = owned.progress.id.get();
            let is_there = |seen: Seen<MapEntry>| id.is_none_or(|id| *id == seen.value.id);
            if is_other || !self.maps.get(map).is_some_and(is_there) {
                owned.progress.lost.cancel();
            }
        }
        let ended = self.owned.iter().filter(|(_, owned)| owned.pump.is_finished());
        let ended: Vec<String> = ended.map(|(map, _)| map.clone()).collect();
        for map in ended {
            let Some(owned) = self.owned.remove(&map) else { continue };
            match owned.pump.await {
                Ok(Ok(())) => tracing::info!(map, "gave a map up"),
                Ok(Err(error)) => {
                    tracing::error!(map, %error, "gave a map up");
                    let leases = if error.is_passing() { 1 } else { LEFT_ALONE };
                    let until = Instant::now() + self.lease_time * leases;
                    self.left_alone.insert(map.clone(), until);
                }
                Err(_) => tracing::error!(map, "the thread of a map's log panicked"),
            }
            owned.held.release(&self.terms.bus).await;
        }
        metrics::gauge!(FLEET_MAPS_OWNED).set(self.owned.len() as f64);
    }

    /// Takes the maps that are free and that no better placed worker has taken.
    async fn take(&mut self) {
        for (map, seen) in self.maps.all() {
            if self.owned.contains_key(&map) || !self.is_my_turn(&map, &seen.value) {
                continue;
            }
            match leases::take(&self.terms.bus, &self.leases, &map, &self.lease).await {
                Ok(Some(held)) => self.begin(held),
                Ok(None) => {}
                Err(error) => tracing::warn!(%error, map, "a map was not taken: trying again"),
            }
        }
    }

    fn begin(&mut self, held: Held) {
        metrics::counter!(FLEET_TAKEOVERS).increment(1);
        let progress = Arc::<Progress>::default();
        let (terms, map, token) = (self.terms.clone(), held.map.clone(), held.token);
        let pump = tokio::spawn(pump::run(terms, map.clone(), token, progress.clone()));
        self.free_since.remove(&map);
        self.owned.insert(map, Owned { held, progress, pump });
        metrics::gauge!(FLEET_MAPS_OWNED).set(self.owned.len() as f64);
    }

    /// Whether a map is free for so long that all better placed workers could have taken it.
    fn is_my_turn(&mut self, map: &str, entry: &MapEntry) -> bool {
        if self.leases.get(map).is_some_and(|seen| !seen.is_over(self.lease_time)) {
            self.free_since.remove(map);
            return false;
        }
        let since = *self.free_since.entry(map.to_owned()).or_insert_with(Instant::now);
        if self.owned.len() >= self.terms.engine.max_maps()
            || self.left_alone.get(map).is_some_and(|until| *until > Instant::now())
        {
            return false;
        }
        since.elapsed() >= self.lease_time / 4 * self.better_placed(entry).min(MOST_STEPS)
    }

    /// Number of workers that should rather have a map: those with the same fingerprint as its checkpoint,
    /// with fewer maps, and with less in memory.
    fn better_placed(&self, entry: &MapEntry) -> u32 {
        let made_by = entry.checkpoint.as_ref().map(|saved| saved.fingerprint.as_str());
        let rank = |name: &str, worker: &Announcement| {
            let is_foreign = made_by.is_some_and(|made_by| made_by != worker.fingerprint);
            (is_foreign, worker.maps, worker.bytes, name.to_owned())
        };
        let mine = rank(&self.name, &self.announcement());
        let is_better = |(name, worker): &(String, Seen<Announcement>)| {
            *name != self.name
                && !worker.is_gone(self.lease_time)
                && worker.value.maps < worker.value.max_maps
                && rank(name, &worker.value) < mine
        };
        u32::try_from(self.workers.all().iter().filter(|worker| is_better(worker)).count())
            .unwrap_or(u32::MAX)
    }

    /// Writes checkpoints, and gives all maps to others.
    async fn stop(mut self) {
        let bus = self.terms.bus.clone();
        // Others need not wait until it is clear that it is gone.
        if let Err(error) = bus.workers.delete(&self.name).await {
            tracing::info!(%error, "the fleet was not told that this worker stops");
        }
        self.owned.values().for_each(|owned| owned.progress.stop.cancel());
        let mut tick = tokio::time::interval(self.lease_time / RENEWALS);
        while !self.owned.is_empty() {
            tick.tick().await;
            self.renew().await;
            self.give_up().await;
        }
    }
}

impl Seen<Announcement> {
    /// Whether the worker was not heard of for long.
    pub(super) fn is_gone(&self, lease_time: Duration) -> bool {
        self.since.elapsed() > lease_time * GONE_AFTER
    }
}

/// Where gateways reach a worker. One that listens on all addresses is called by the name of its host.
fn reached_at(config: &FleetConfig, [grpc, http]: [SocketAddr; 2]) -> [String; 2] {
    let own = |address: SocketAddr| match address.ip().is_unspecified() {
        true => format!("{}:{}", host(), address.port()),
        false => address.to_string(),
    };
    [
        config.grpc.clone().unwrap_or_else(|| own(grpc)),
        config.http.clone().unwrap_or_else(|| own(http)),
    ]
}

fn host() -> String {
    rustix::system::uname().nodename().to_string_lossy().into_owned()
}

/// Name of the host, with the number of the process.
fn own_name() -> String {
    let host: String = host()
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '-' })
        .collect();
    format!("{host}-{}", std::process::id())
}
