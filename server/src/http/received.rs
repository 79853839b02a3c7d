//! Bodies of requests that are files: read part by part, on a thread that may block.

use super::error::Problem;
use super::pace::Pace;
use axum::body::{Body, BodyDataStream, Bytes};
use futures::StreamExt as _;
use std::io::{Error, Read, Result};
use std::time::Duration;
use tokio::sync::mpsc;

/// Parts that may wait for the reader.
const BACKLOG: usize = 4;
/// What is read of a file after it was refused, at most.
const DRAINED_BYTES: usize = 64 << 20;
const DRAINED_WITHIN: Duration = Duration::from_secs(10);

/// A file that is being received. Reading it blocks.
pub(super) struct Received {
    parts: mpsc::Receiver<Result<Bytes>>,
    left: Bytes,
}

impl Read for Received {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        while self.left.is_empty() {
            let Some(part) = self.parts.blocking_recv() else { return Ok(0) };
            self.left = part?;
        }
        let part = self.left.split_to(buffer.len().min(self.left.len()));
        buffer[..part.len()].copy_from_slice(&part);
        Ok(part.len())
    }
}

/// Hands the body of a request to `take`. Once it is refused, the rest is read and forgotten: a client that is
/// still sending would not see the answer. `most`: how long a client that sends nothing is waited for.
///
/// # Errors
/// Those of `take`.
pub(super) async fn with_received<T>(
    body: Body,
    most: Duration,
    take: impl AsyncFnOnce(Received) -> std::result::Result<T, Problem>,
) -> std::result::Result<T, Problem> {
    let (parts, received) = mpsc::channel(BACKLOG);
    let receiving = tokio::spawn(receive(body.into_data_stream(), Pace::new(most), parts));
    let taken = take(Received { parts: received, left: Bytes::new() }).await;
    if taken.is_err() {
        let _ = tokio::time::timeout(DRAINED_WITHIN, receiving).await;
    }
    taken
}

async fn receive(mut body: BodyDataStream, mut pace: Pace, parts: mpsc::Sender<Result<Bytes>>) {
    let mut unwanted = 0;
    loop {
        let part = match pace.wait(body.next()).await {
            Ok(Some(part)) => part.map_err(Error::other),
            Ok(None) => return,
            Err(too_slow) => Err(too_slow),
        };
        let (bytes, is_broken) = (part.as_ref().map_or(0, Bytes::len), part.is_err());
        pace.moved(bytes);
        if parts.send(part).await.is_err() {
            unwanted += bytes;
        }
        if is_broken || unwanted > DRAINED_BYTES {
            return;
        }
    }
}
