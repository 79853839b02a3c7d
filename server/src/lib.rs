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
mod http;
mod ingest;
mod maps;
pub mod pipeline;
mod query_id;
mod store;
pub mod telemetry;
#[cfg(test)]
mod test_support;
mod web;

pub use config::Config;

use access::{EntriesError, Exposed, Gate};
use ingest::{IngestError, MappingService};
use maps::RecordedMaps;
use pipeline::engine::{Engine, StartError};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use store::{Store, StoreError};
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::task::{JoinError, JoinSet};
use tokio_util::sync::CancellationToken;

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
    /// A listener failed.
    #[error("a listener failed")]
    Listener(#[from] std::io::Error),
    /// The gRPC server failed.
    #[error(transparent)]
    Ingest(#[from] IngestError),
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

/// Serves `engine` until `shutdown` resolves, then waits for open calls to finish.
///
/// HTTP is served at once. gRPC is served, and `on_ready` called, when the maps have been rebuilt
/// from their recordings.
///
/// # Errors
/// [`RunError`] if the data directory cannot be used or a listener fails.
pub async fn serve(
    engine: Arc<Engine>,
    listeners: Listeners,
    config: Config,
    on_ready: impl FnOnce(&Ready),
    shutdown: impl Future<Output = ()>,
) -> Result<(), RunError> {
    telemetry::recorder();
    let addresses = [listeners.grpc.local_addr()?, listeners.http.local_addr()?];
    if let Some(address) = access::exposed(&config.access, &addresses)? {
        tracing::warn!(
            %address,
            "nobody is asked who they are: everybody who can connect may read, write and delete all maps"
        );
    }
    let gate = Gate::new(config.access.clone())?;
    let store = Store::open(config.server.data_dir.as_deref())?;
    let maps = RecordedMaps::new(engine.clone(), store);
    let stopping = CancellationToken::new();
    let _stop_on_return = stopping.clone().drop_guard();
    let ready = Ready {
        event: "ready",
        grpc: addresses[0],
        http: addresses[1],
        adapter: engine.adapter().into(),
        bundle: engine.bundle().into(),
    };
    let (is_ready, ready_state) = watch::channel(false);
    tokio::spawn(gate.clone().follow_file(stopping.clone()));
    let router = http::router(http::Context {
        maps: maps.clone(),
        gate: gate.clone(),
        config: config.http.clone(),
        ready: ready_state,
        stopping: stopping.clone(),
    });
    let http_stop = stopping.clone().cancelled_owned();
    let mut parts = JoinSet::new();
    parts.spawn(async move {
        let served = axum::serve(listeners.http, router).with_graceful_shutdown(http_stop).await;
        served.map_err(RunError::from)
    });
    tokio::pin!(shutdown);
    let limits = config.ingest.limits();
    let rebuilt = tokio::select! {
        rebuilt = maps::replay(&maps, &limits) => rebuilt.map(|()| true)?,
        () = &mut shutdown => false,
    };
    let mut first = None;
    if rebuilt {
        let service = MappingService::new(maps, gate, &config.ingest, stopping.clone());
        parts.spawn(async move { service.serve(listeners.grpc).await.map_err(RunError::from) });
        is_ready.send_replace(true);
        on_ready(&ready);
        tokio::select! {
            () = &mut shutdown => {}
            ended = parts.join_next() => first = ended,
        }
    }
    tracing::info!("stopping: waiting for open calls");
    stopping.cancel();
    let patience = Duration::from_secs(config.server.shutdown_seconds);
    let ended = tokio::time::timeout(patience, all_ended(first, parts)).await;
    engine.shutdown().await;
    ended.unwrap_or_else(|_| {
        tracing::warn!(?patience, "some calls did not finish in time and were cut off");
        Ok(())
    })
}

type Ended = Result<Result<(), RunError>, JoinError>;

/// Waits for all parts of the server; returns the first failure.
async fn all_ended(
    first: Option<Ended>,
    mut parts: JoinSet<Result<(), RunError>>,
) -> Result<(), RunError> {
    let mut ended: Vec<Ended> = first.into_iter().collect();
    while let Some(next) = parts.join_next().await {
        ended.push(next);
    }
    ended.into_iter().try_for_each(|part| part.map_err(|_| RunError::Panicked("a listener"))?)
}
