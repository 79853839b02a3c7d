//! The lexsplat server. Robots send RGB-D frames over gRPC, the server builds a map of 3D Gaussians
//! with language, and it answers questions in plain words over HTTP.
//!
//! [`serve`] runs the server. Its listeners are already bound and it stops when a future resolves,
//! so tests can use free ports and stop it at any time.

pub mod access;
mod check;
pub mod config;
mod export;
mod file_watch;
mod fleet;
mod http;
mod import;
mod ingest;
mod inspect;
mod maps;
mod net;
pub mod pipeline;
mod query_id;
mod store;
pub mod telemetry;
#[cfg(test)]
mod test_support;
mod web;

pub use config::Config;
pub use fleet::{BusError, FleetConfig, Role, Trim};
pub use inspect::inspect;

use access::{AccessConfig, EntriesError, Exposed, Gate};
use axum::Router;
use fleet::{Bus, Gateway, GatewayService, Worker};
use import::Imports;
use ingest::{IngestError, MappingService};
use maps::RecordedMaps;
use net::{Port, Protocol, Tls, TlsError};
use pipeline::engine::{Engine, StartError};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use store::{Store, StoreError};
use tokio::net::TcpListener;
use tokio::task::{JoinError, JoinSet};
use tokio_util::sync::CancellationToken;

/// A map that is asked for need not wait until another one has been rebuilt.
const MAPS_LOADED_AT_ONCE: usize = 2;

/// The bound listeners of the server.
pub struct Listeners {
    /// For gRPC.
    pub grpc: TcpListener,
    /// For HTTP.
    pub http: TcpListener,
}

/// Why the server did not start, or stopped by itself.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The GPU adapter, a network or a thread could not be started.
    #[error(transparent)]
    Start(#[from] StartError),
    /// The data directory cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The callers cannot be read.
    #[error(transparent)]
    Access(#[from] EntriesError),
    /// The server would be open to other machines.
    #[error(transparent)]
    Exposed(#[from] Exposed),
    /// The certificates cannot be used.
    #[error(transparent)]
    Tls(#[from] TlsError),
    /// A listener has no address.
    #[error("a listener failed")]
    Listener(#[from] std::io::Error),
    /// The gRPC interface does not start.
    #[error(transparent)]
    Ingest(#[from] IngestError),
    /// NATS cannot be used.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A part of the server panicked.
    #[error("{0} panicked: see the log")]
    Panicked(&'static str),
}

/// The report of a server that is ready.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Ready {
    /// Always "ready".
    pub event: &'static str,
    /// Address of the gRPC listener.
    pub grpc: SocketAddr,
    /// Address of the HTTP listener.
    pub http: SocketAddr,
    /// The GPU adapter.
    pub adapter: String,
    /// Name of the model bundle.
    pub bundle: String,
}

/// Serves `engine` until `shutdown` resolves, then waits for open calls to finish. With the role of a worker,
/// its maps are those that it has in the fleet.
///
/// HTTP and gRPC are served, and `on_ready` called, at once. Maps of the data directory are loaded
/// meanwhile, those first that are asked for; a call that needs one of them is told to wait.
///
/// # Errors
/// [`RunError`] if the data directory or NATS cannot be used, or a listener fails.
pub async fn serve(
    engine: Arc<Engine>,
    listeners: Listeners,
    config: Config,
    on_ready: impl FnOnce(&Ready),
    shutdown: impl Future<Output = ()>,
) -> Result<(), RunError> {
    let edge = Edge::new(&listeners, &config)?;
    let stopping = edge.stopping.clone();
    let _stop_on_return = stopping.clone().drop_guard();
    let is_worker = config.fleet.role == Role::Worker;
    let data_dir = config.server.data_dir.as_deref().filter(|_| !is_worker);
    let store = Store::open(data_dir, &config.recording)?;
    let patience = Duration::from_secs(config.server.loading_wait_seconds);
    let maps = RecordedMaps::new(engine.clone(), store).waiting(patience);
    let worker = match is_worker {
        true => Some(worker(engine.clone(), &config, edge.addresses, &stopping).await?),
        false => None,
    };
    let maps = match &worker {
        Some(worker) => maps.of_fleet(Arc::new(worker.copies())),
        None => maps,
    };
    maps.find_recordings()?;
    let gate = edge.gate.clone();
    let mut of_http = config.http.clone();
    of_http.hosts.extend(worker.as_ref().map(Worker::host));
    let service = MappingService::new(maps.clone(), gate.clone(), &config.ingest, stopping.clone());
    let kept_free = config.recording.low_bytes;
    let imports = Imports::new(maps.clone(), service.clone(), &config.imports, kept_free);
    let router = http::router(http::Context {
        maps: maps.clone(),
        imports,
        gate,
        config: of_http,
        body_limit: Duration::from_secs(config.connections.body_seconds),
        stopping: stopping.clone(),
    });
    let mut background = keep_maps(&maps, &config, &stopping);
    if let Some(worker) = worker {
        background.spawn(worker.run(stopping.clone()));
    }
    let ready = ready(engine.adapter(), engine.bundle(), edge.addresses);
    let running = edge.serve(listeners, [service.router().await?, router], &config);
    on_ready(&ready);
    let ended = running.until(shutdown).await;
    while background.join_next().await.is_some() {}
    maps::save_all(&maps).await;
    engine.shutdown().await;
    ended
}

/// Serves a gateway of a fleet until `shutdown` resolves, then waits for open calls to finish.
///
/// # Errors
/// [`RunError`] if NATS cannot be used or a listener fails.
pub async fn serve_gateway(
    listeners: Listeners,
    config: Config,
    on_ready: impl FnOnce(&Ready),
    shutdown: impl Future<Output = ()>,
) -> Result<(), RunError> {
    let edge = Edge::new(&listeners, &config)?;
    let stopping = edge.stopping.clone();
    let _stop_on_return = stopping.clone().drop_guard();
    let bus = Bus::connect(&config.fleet).await?;
    let patience = Duration::from_secs(config.server.loading_wait_seconds);
    let gateway = Gateway::new(bus, &config.fleet, patience, &stopping).await;
    tokio::spawn(gateway.clone().watch(stopping.clone()));
    let terms = ingest::Terms {
        config: Arc::new(config.ingest.clone()),
        limits: config.ingest.limits(),
        stopping: stopping.clone(),
    };
    let (service, gate) = (GatewayService::new(gateway.clone(), terms), edge.gate.clone());
    let grpc = ingest::router(service, gate.clone(), &config.ingest, stopping);
    let shell = http::Shell {
        gate,
        config: config.http.clone(),
        body_limit: Duration::from_secs(config.connections.body_seconds),
    };
    let router = fleet::http_router(gateway, shell);
    let ready = ready("none: a gateway", "none: a gateway", edge.addresses);
    let running = edge.serve(listeners, [grpc.await?, router], &config);
    on_ready(&ready);
    running.until(shutdown).await
}

/// The worker of a fleet, whose maps are in `engine`.
async fn worker(
    engine: Arc<Engine>,
    config: &Config,
    addresses: [SocketAddr; 2],
    stopping: &CancellationToken,
) -> Result<Worker, RunError> {
    let bus = Bus::connect(&config.fleet).await?;
    let every = Duration::from_secs(config.server.checkpoint_seconds);
    let limits = config.ingest.limits();
    Ok(Worker::new(bus, engine, &config.fleet, limits, every, addresses, stopping).await)
}

/// What is at the edge of every server: addresses, certificates, and who may call.
struct Edge {
    /// Of gRPC and HTTP.
    addresses: [SocketAddr; 2],
    tls: Option<Tls>,
    gate: Gate,
    stopping: CancellationToken,
}

impl Edge {
    fn new(listeners: &Listeners, config: &Config) -> Result<Self, RunError> {
        telemetry::recorder();
        let addresses = [listeners.grpc.local_addr()?, listeners.http.local_addr()?];
        let tls = config.server.tls.clone().map(Tls::new).transpose()?;
        let gate = gate(&config.access, &addresses, tls.is_some())?;
        net::raise_limit(config.connections.max);
        Ok(Self { addresses, tls, gate, stopping: CancellationToken::new() })
    }

    /// Serves gRPC and HTTP, and follows the files of tokens and certificates.
    fn serve(self, listeners: Listeners, [grpc, http]: [Router; 2], config: &Config) -> Running {
        let Self { tls, gate, stopping, .. } = self;
        follow_files(&gate, tls.as_ref(), &stopping);
        let port = |protocol, listener, router| {
            let limits = config.connections.clone();
            let port = Port { protocol, listener, router, tls: tls.clone(), limits };
            net::serve(port, stopping.clone())
        };
        let mut parts = JoinSet::new();
        parts.spawn(port(Protocol::Http, listeners.http, http));
        parts.spawn(port(Protocol::Grpc, listeners.grpc, grpc));
        let patience = Duration::from_secs(config.server.shutdown_seconds);
        Running { parts, stopping, patience }
    }
}

/// Both ports.
struct Running {
    parts: JoinSet<()>,
    stopping: CancellationToken,
    /// How long open calls may take to finish.
    patience: Duration,
}

impl Running {
    /// Serves until `shutdown` resolves or a part ends, then waits for open calls to finish.
    async fn until(mut self, shutdown: impl Future<Output = ()>) -> Result<(), RunError> {
        let first = tokio::select! {
            () = shutdown => None,
            ended = self.parts.join_next() => ended,
        };
        tracing::info!("stopping: waiting for open calls");
        self.stopping.cancel();
        let patience = self.patience;
        let ended = tokio::time::timeout(patience, all_ended(first, self.parts)).await;
        ended.unwrap_or_else(|_| {
            tracing::warn!(?patience, "some calls did not finish in time and were cut off");
            Ok(())
        })
    }
}

fn ready(adapter: &str, bundle: &str, [grpc, http]: [SocketAddr; 2]) -> Ready {
    let (adapter, bundle) = (adapter.into(), bundle.into());
    Ready { event: "ready", grpc, http, adapter, bundle }
}

/// Reads tokens and certificates again whenever their files change.
fn follow_files(gate: &Gate, tls: Option<&Tls>, stopping: &CancellationToken) {
    tokio::spawn(gate.clone().follow_file(stopping.clone()));
    if let Some(tls) = tls {
        tokio::spawn(tls.clone().follow_files(stopping.clone()));
    }
}

/// Reads who may call, and refuses or warns where others could listen or call.
fn gate(
    config: &AccessConfig,
    addresses: &[SocketAddr],
    is_encrypted: bool,
) -> Result<Gate, RunError> {
    if let Some(address) = access::exposed(config, addresses)? {
        tracing::warn!(
            %address,
            "nobody is asked who they are: everybody who can connect may read, write and delete all maps"
        );
    }
    if config.asks() && !is_encrypted && !addresses.iter().all(access::is_own_machine) {
        tracing::warn!(
            "tokens, frames and answers travel in plain text: set [server.tls], or put a proxy that speaks \
             TLS in front"
        );
    }
    Ok(Gate::new(config.clone())?)
}

/// Loads maps and writes checkpoints in the background, until the server stops.
fn keep_maps(maps: &RecordedMaps, config: &Config, stopping: &CancellationToken) -> JoinSet<()> {
    let mut background = JoinSet::new();
    for _ in 0..MAPS_LOADED_AT_ONCE {
        let limits = config.ingest.limits();
        background.spawn(maps::keep_loading(maps.clone(), limits, stopping.clone()));
    }
    let pause = Duration::from_secs(config.server.checkpoint_seconds);
    if !pause.is_zero() {
        background.spawn(maps::save_every(maps.clone(), pause, stopping.clone()));
    }
    background.spawn(maps::watch_room(maps.clone(), stopping.clone()));
    background
}

type Ended = Result<(), JoinError>;

/// Waits for all parts of the server; returns the first failure.
async fn all_ended(first: Option<Ended>, mut parts: JoinSet<()>) -> Result<(), RunError> {
    let mut ended: Vec<Ended> = first.into_iter().collect();
    while let Some(next) = parts.join_next().await {
        ended.push(next);
    }
    ended.into_iter().try_for_each(|part| part.map_err(|_| RunError::Panicked("a listener")))
}
