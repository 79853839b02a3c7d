//! A socket that gives up on a silent peer.

use super::config::ConnectionsConfig;
use std::io::{self, ErrorKind};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Instant, Sleep, sleep};

/// The requests of one connection.
#[derive(Debug, Default)]
pub(super) struct Requests {
    open: AtomicUsize,
    begun: AtomicUsize,
}

/// A request that is not answered yet; dropping it ends it.
pub(super) struct OpenRequest(Arc<Requests>);

impl Requests {
    pub(super) fn begin(self: &Arc<Self>) -> OpenRequest {
        self.begun.fetch_add(1, Ordering::Relaxed);
        self.open.fetch_add(1, Ordering::Relaxed);
        OpenRequest(self.clone())
    }
}

impl Drop for OpenRequest {
    fn drop(&mut self) {
        self.0.open.fetch_sub(1, Ordering::Relaxed);
    }
}

/// How long a peer may be silent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patience {
    /// From the start to the head of the first request.
    pub(super) first_request: Duration,
    /// Between bytes while no request is open.
    pub(super) idle: Duration,
    /// Without taking any of what it is sent.
    pub(super) write: Duration,
}

impl Patience {
    pub(super) fn of(limits: &ConnectionsConfig) -> Self {
        Self {
            first_request: Duration::from_secs(limits.header_seconds),
            idle: Duration::from_secs(limits.idle_seconds),
            write: Duration::from_secs(limits.write_seconds),
        }
    }
}

/// A socket. Reading fails when the first request takes too long, or when nothing was sent or
/// received for long and no request is open; writing fails when the peer takes nothing for long.
pub(super) struct Watched<S> {
    socket: S,
    requests: Arc<Requests>,
    patience: Patience,
    since: Instant,
    /// When bytes were last sent or received.
    active: Instant,
    /// When to look at the time again while reading.
    look: Pin<Box<Sleep>>,
    /// When writing fails; none while the peer takes what it is sent.
    stalled: Option<Pin<Box<Sleep>>>,
}

impl<S> Watched<S> {
    pub(super) fn new(socket: S, patience: Patience, requests: Arc<Requests>) -> Self {
        let now = Instant::now();
        let look = Box::pin(sleep(patience.first_request.min(patience.idle)));
        Self { socket, requests, patience, since: now, active: now, look, stalled: None }
    }

    /// When the peer has been silent for too long, if nothing happens until then.
    fn deadline(&self) -> Instant {
        match self.requests.begun.load(Ordering::Relaxed) {
            0 => self.since + self.patience.first_request,
            _ => self.active + self.patience.idle,
        }
    }

    /// Ready when the peer has been silent for too long.
    fn poll_silence(&mut self, context: &mut Context<'_>) -> Poll<()> {
        loop {
            if self.look.as_mut().poll(context).is_pending() {
                return Poll::Pending;
            }
            let (now, deadline) = (Instant::now(), self.deadline());
            let is_open = self.requests.open.load(Ordering::Relaxed) > 0;
            if now >= deadline && !is_open {
                return Poll::Ready(());
            }
            // While a request is open, look again later.
            let next = if is_open { deadline.max(now + self.patience.idle) } else { deadline };
            self.look.as_mut().reset(next);
        }
    }

    /// Notes whether the peer takes what it is sent.
    fn written(
        &mut self,
        context: &mut Context<'_>,
        written: Poll<io::Result<usize>>,
    ) -> Poll<io::Result<usize>> {
        if written.is_ready() {
            self.stalled = None;
            self.active = Instant::now();
            return written;
        }
        let write = self.patience.write;
        let stalled = self.stalled.get_or_insert_with(|| Box::pin(sleep(write)));
        stalled.as_mut().poll(context).map(|()| Err(timed_out("the other side takes nothing")))
    }
}

fn timed_out(reason: &str) -> io::Error {
    io::Error::new(ErrorKind::TimedOut, reason)
}

impl<S: AsyncRead + Unpin> AsyncRead for Watched<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let read = Pin::new(&mut self.socket).poll_read(context, buffer);
        if read.is_ready() {
            self.active = Instant::now();
            return read;
        }
        self.poll_silence(context).map(|()| Err(timed_out("the other side is silent")))
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Watched<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.socket).poll_write(context, bytes);
        self.written(context, written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.socket).poll_write_vectored(context, parts);
        self.written(context, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.socket.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.socket).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.socket).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, DuplexStream, duplex};
    use tokio::task::JoinHandle;

    const SHORT: Duration = Duration::from_millis(200);
    const LONG: Duration = Duration::from_secs(3600);

    /// What a reader says when it has read everything.
    type Reading = JoinHandle<ErrorKind>;

    fn read(patience: Patience, requests: &Arc<Requests>) -> (DuplexStream, Reading) {
        let (client, socket) = duplex(64);
        let mut watched = Watched::new(socket, patience, requests.clone());
        let reading = tokio::spawn(async move {
            let mut byte = [0];
            loop {
                if let Err(error) = watched.read_exact(&mut byte).await {
                    return error.kind();
                }
            }
        });
        (client, reading)
    }

    #[tokio::test]
    async fn single_bytes_do_not_move_the_deadline_of_the_first_request() {
        let patience = Patience { first_request: SHORT, idle: LONG, write: LONG };
        let (mut client, reading) = read(patience, &Arc::default());
        while client.write_all(b"x").await.is_ok() {
            tokio::time::sleep(SHORT / 20).await;
        }
        assert_eq!(reading.await.unwrap(), ErrorKind::TimedOut);
    }

    #[tokio::test]
    async fn a_silent_peer_is_given_up_unless_a_request_is_open() {
        let patience = Patience { first_request: LONG, idle: SHORT, write: LONG };
        let requests = Arc::new(Requests::default());
        let open = requests.begin();
        let (client, reading) = read(patience, &requests);
        // Negative control: the answer takes long, and nobody is given up meanwhile.
        tokio::time::sleep(4 * SHORT).await;
        assert!(!reading.is_finished());
        drop(open);
        assert_eq!(reading.await.unwrap(), ErrorKind::TimedOut);
        drop(client);
    }

    #[tokio::test]
    async fn a_peer_that_takes_nothing_is_given_up() {
        let patience = Patience { first_request: LONG, idle: LONG, write: SHORT };
        let (mut client, socket) = duplex(64);
        let mut watched = Watched::new(socket, patience, Arc::default());
        let error = watched.write_all(&[0; 128]).await.unwrap_err();
        assert_eq!(error.kind(), ErrorKind::TimedOut);
        // Negative control: what was taken is no reason.
        client.read_exact(&mut [0; 64]).await.unwrap();
        watched.write_all(&[0; 64]).await.unwrap();
    }
}
