//! lexsplat's server: robots stream RGB-D to it over gRPC, it builds a map of 3D Gaussians with
//! language in it, and answers questions in plain words over HTTP.
//!
//! [`run`] is the whole server: it takes listeners that are bound already and any future as the sign to
//! stop, so that tests bind port 0 and stop when they like.

mod check;
pub mod config;
mod export;
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

/// Where the server listens: bound already.
pub struct Listeners {
    /// For robots.
    pub grpc: TcpListener,
    /// For questions.
    pub http: TcpListener,
}

/// Why the server does not start, or stopped by itself.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// No adapter, no networks, no thread.
    #[error(transparent)]
    Start(#[from] StartError),
    /// The data directory cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A listener failed.
    #[error("a listener failed")]
    Listener(#[from] std::io::Error),
    /// gRPC failed.
    #[error(transparent)]
    Ingest(#[from] IngestError),
    /// A part of the server panicked.
    #[error("{0} panicked: the log says where")]
    Panicked(&'static str),
}

/// What a started server says of itself.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Ready {
    /// Always "ready".
    pub event: &'static str,
    /// Where gRPC listens.
    pub grpc: SocketAddr,
    /// Where HTTP listens.
    pub http: SocketAddr,
    /// What renders.
    pub adapter: String,
    /// The networks.
    pub bundle: String,
}

/// Serves `engine` until `shutdown` resolves; calls `on_ready` when the kept maps are rebuilt and
/// robots are let in.
///
/// # Errors
/// [`RunError`].
pub async fn serve(
    engine: Arc<Engine>,
    listeners: Listeners,
    config: Config,
    on_ready: impl FnOnce(&Ready),
    shutdown: impl Future<Output = ()>,
) -> Result<(), RunError> {
    telemetry::recorder();
    let store = Store::open(config.server.data_dir.as_deref())?;
    let maps = RecordedMaps::new(engine.clone(), store);
    let stopping = CancellationToken::new();
    let _stop_on_return = stopping.clone().drop_guard();
    let ready = Ready {
        event: "ready",
        grpc: listeners.grpc.local_addr()?,
        http: listeners.http.local_addr()?,
        adapter: engine.adapter().into(),
        bundle: engine.bundle().into(),
    };
    let (is_ready, ready_state) = watch::channel(false);
    let router = http::router(http::Context {
        maps: maps.clone(),
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
        let service = MappingService::new(maps, &config.ingest, stopping.clone());
        parts.spawn(async move { service.serve(listeners.grpc).await.map_err(RunError::from) });
        is_ready.send_replace(true);
        on_ready(&ready);
        tokio::select! {
            () = &mut shutdown => {}
            ended = parts.join_next() => first = ended,
        }
    }
    tracing::info!("stopping: open calls may finish");
    stopping.cancel();
    let patience = Duration::from_secs(config.server.shutdown_seconds);
    let ended = tokio::time::timeout(patience, all_ended(first, parts)).await;
    engine.shutdown().await;
    ended.unwrap_or_else(|_| {
        tracing::warn!(?patience, "calls were still open and were cut off");
        Ok(())
    })
}

type Ended = Result<Result<(), RunError>, JoinError>;

/// Waits for the parts of the server; the first failure, if one failed.
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
