//! Accepting connections and serving their requests.

use super::config::ConnectionsConfig;
use super::peer::Peer;
use super::tls::Tls;
use super::watched::{Patience, Requests, Watched};
use crate::telemetry::{CONNECTIONS, CONNECTIONS_ENDED};
use axum::Router;
use axum::body::Body;
use axum::http::Request;
use hyper::body::Incoming;
use hyper::service::service_fn;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use std::error::Error;
use std::io::{self, ErrorKind};
use std::pin::pin;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio_rustls::TlsAcceptor;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tower::Service as _;

/// HTTP/2 flow-control window of a gRPC call, bytes: about one uncompressed frame.
const WINDOW_BYTES: u32 = 4 << 20;
/// Largest head of an HTTP/1 request, bytes.
const HEAD_BYTES: usize = 64 << 10;
/// Wait after the system has no place for another connection.
const PAUSE: Duration = Duration::from_secs(1);
/// Least time between log lines about refused connections.
const QUIET: Duration = Duration::from_secs(10);

/// What a port speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Protocol {
    /// HTTP/2 only.
    Grpc,
    /// HTTP/1.1 and HTTP/2.
    Http,
}

impl Protocol {
    fn name(self) -> &'static str {
        match self {
            Self::Grpc => "grpc",
            Self::Http => "http",
        }
    }
}

/// One port of the server.
pub(crate) struct Port {
    pub(crate) protocol: Protocol,
    pub(crate) listener: TcpListener,
    /// Answers the requests; each has its [`Peer`] in its extensions.
    pub(crate) router: Router,
    /// `None`: connections are not encrypted.
    pub(crate) tls: Option<Tls>,
    pub(crate) limits: ConnectionsConfig,
}

/// Serves the port until `stopping` is cancelled and every request has been answered.
pub(crate) async fn serve(port: Port, stopping: CancellationToken) {
    let Port { protocol, listener, router, tls, limits } = port;
    let places = Arc::new(Semaphore::new(limits.max));
    let connections = TaskTracker::new();
    let limits = Arc::new(limits);
    let mut last_refused: Option<Instant> = None;
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = stopping.cancelled() => break,
        };
        let (socket, address) = match accepted {
            Ok(accepted) => accepted,
            // The client was gone before it was accepted.
            Err(error) if error.kind() == ErrorKind::ConnectionAborted => continue,
            Err(error) => {
                tracing::error!(port = protocol.name(), %error, "cannot accept connections");
                tokio::time::sleep(PAUSE).await;
                continue;
            }
        };
        let Ok(place) = places.clone().try_acquire_owned() else {
            ended(protocol, "too_many");
            if last_refused.is_none_or(|last| last.elapsed() > QUIET) {
                last_refused = Some(Instant::now());
                let (port, max) = (protocol.name(), limits.max);
                tracing::warn!(port, max, %address, "connections are closed: connections.max are open");
            }
            continue;
        };
        let connection = Connection {
            protocol,
            router: router.clone(),
            limits: limits.clone(),
            requests: Arc::default(),
            stopping: stopping.clone(),
        };
        let tls = tls.clone();
        connections.spawn(async move {
            metrics::gauge!(CONNECTIONS, "port" => protocol.name()).increment(1.0);
            if let Err(error) = connection.run(socket, tls).await {
                let reason = reason(&*error);
                ended(protocol, reason);
                tracing::debug!(port = protocol.name(), %address, %error, reason, "a connection ended");
            }
            metrics::gauge!(CONNECTIONS, "port" => protocol.name()).decrement(1.0);
            drop(place);
        });
    }
    drop(listener);
    connections.close();
    connections.wait().await;
}

fn ended(protocol: Protocol, reason: &'static str) {
    metrics::counter!(CONNECTIONS_ENDED, "port" => protocol.name(), "reason" => reason)
        .increment(1);
}

/// Why a connection ended other than well, for the metrics.
fn reason(error: &(dyn Error + 'static)) -> &'static str {
    let mut causes = std::iter::successors(Some(error), |error| (**error).source());
    let timed_out = causes.any(|cause| {
        let of_socket = cause.downcast_ref::<io::Error>().map(io::Error::kind);
        let of_head = cause.downcast_ref::<hyper::Error>().is_some_and(hyper::Error::is_timeout);
        of_socket == Some(ErrorKind::TimedOut) || of_head
    });
    match error.downcast_ref::<Handshake>() {
        _ if timed_out => "timed_out",
        Some(_) => "handshake",
        None => "broken",
    }
}

/// A TLS handshake that failed.
#[derive(Debug, thiserror::Error)]
#[error("no TLS: {0}")]
struct Handshake(#[source] io::Error);

/// What the connections of a port share, and the requests of one of them.
struct Connection {
    protocol: Protocol,
    router: Router,
    limits: Arc<ConnectionsConfig>,
    requests: Arc<Requests>,
    stopping: CancellationToken,
}

type Ended = Result<(), Box<dyn Error + Send + Sync>>;

impl Connection {
    async fn run(self, socket: TcpStream, tls: Option<Tls>) -> Ended {
        socket.set_nodelay(true)?;
        let address = socket.peer_addr()?.ip();
        let socket = Watched::new(socket, Patience::of(&self.limits), self.requests.clone());
        let Some(tls) = tls else {
            return self.serve(socket, Peer::at(address)).await;
        };
        let acceptor = TlsAcceptor::from(tls.current(self.protocol == Protocol::Grpc));
        // The socket gives up on a handshake that takes too long.
        let stream = acceptor.accept(socket).await.map_err(Handshake)?;
        let peer = Peer::with_certificates(address, stream.get_ref().1.peer_certificates());
        self.serve(stream, peer).await
    }

    /// Answers the requests of the connection until it is closed or the server stops.
    async fn serve<S>(self, socket: S, peer: Peer) -> Ended
    where
        S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
    {
        let builder = builder(self.protocol, &self.limits);
        let Self { router, requests, stopping, .. } = self;
        let service = service_fn(move |request: Request<Incoming>| {
            let open = requests.begin();
            let mut request = request.map(Body::new);
            request.extensions_mut().insert(peer.clone());
            let answer = router.clone().call(request);
            async move {
                let answer = answer.await;
                drop(open);
                answer
            }
        });
        let mut connection = pin!(builder.serve_connection(TokioIo::new(socket), service));
        tokio::select! {
            ended = connection.as_mut() => return ended,
            () = stopping.cancelled() => connection.as_mut().graceful_shutdown(),
        }
        connection.await
    }
}

fn builder(protocol: Protocol, limits: &ConnectionsConfig) -> Builder<TokioExecutor> {
    let mut builder = Builder::new(TokioExecutor::new());
    builder
        .http1()
        .timer(TokioTimer::new())
        .max_buf_size(HEAD_BYTES)
        .header_read_timeout(Duration::from_secs(limits.header_seconds));
    builder
        .http2()
        .timer(TokioTimer::new())
        .max_concurrent_streams(limits.max_requests)
        .keep_alive_interval(Duration::from_secs(limits.keepalive_seconds))
        .keep_alive_timeout(Duration::from_secs(limits.keepalive_timeout_seconds));
    if protocol == Protocol::Http {
        return builder;
    }
    builder.http2().initial_stream_window_size(WINDOW_BYTES);
    builder.http2_only()
}
