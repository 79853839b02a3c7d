//! Frames of a robot on their way into the log.

use super::super::acks::{self, Waiting};
use super::super::bus::Bus;
use super::super::log::{Record, WriteError, Writer};
use super::super::registry;
use super::state::Gateway;
use crate::check::{self, Limits, Opening, Refusal};
use crate::ingest::{Acked, Destination, Destinations, of_map};
use crate::pipeline::engine::check_name;
use crate::pipeline::map::MapError;
use futures::StreamExt as _;
use lexsplat_proto::v1::{self, FrameAck};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::task::AbortHandle;
use tonic::Status;

/// How long a gateway may take to say that it has a stream of a map.
const ASK: Duration = Duration::from_secs(1);
/// How long the end of a stream may take.
const END: Duration = Duration::from_secs(3);
/// No frame yet.
const NONE: u64 = u64::MAX;

/// A stream of frames into the log.
pub(crate) struct LogStream {
    map: String,
    writer: Writer,
    /// Whether the log may have more than is known.
    is_broken: bool,
    /// Sequence of the newest frame of the log, or [`NONE`].
    durable: Arc<AtomicU64>,
    waiting: Waiting,
    acks: Arc<Task>,
    /// Tells other gateways that the map has a sender.
    _writing: Task,
}

/// A task that ends with this, and what it leaves is removed.
struct Task {
    handle: AbortHandle,
    end: Mutex<Option<Box<dyn FnOnce() + Send>>>,
}

impl Task {
    fn new(
        task: impl Future<Output = ()> + Send + 'static,
        end: impl FnOnce() + Send + 'static,
    ) -> Self {
        let handle = tokio::spawn(task).abort_handle();
        Self { handle, end: Mutex::new(Some(Box::new(end))) }
    }
}

impl Drop for Task {
    fn drop(&mut self) {
        self.handle.abort();
        let end = self.end.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        end.into_iter().for_each(|end| end());
    }
}

impl Destinations for Gateway {
    type One = LogStream;

    async fn destination(&self, open: &v1::OpenMap) -> Result<LogStream, Status> {
        let (bus, map) = (&self.bus, &open.map);
        check_name(map).map_err(|error| of_map(&error, "map"))?;
        registry::ensure(bus, map).await.map_err(|error| unavailable(&error))?;
        let known = registry::find(bus, map).await.map_err(|error| unavailable(&error))?;
        let Some((entry, _)) = known else {
            return Err(unavailable(&"the map was deleted just now"));
        };
        if has_sender(bus, map).await {
            return Err(of_map(&MapError::Busy { name: map.clone() }, "map"));
        }
        let acks = bus.client.subscribe(bus.acks_of(map)).await;
        let acks = acks.map_err(|error| unavailable(&error))?;
        let asked = bus.client.subscribe(bus.writing_of(map)).await;
        let mut asked = asked.map_err(|error| unavailable(&error))?;
        let writer = Writer::open(bus, open).await.map_err(|error| refused(map, &error))?;
        let client = bus.client.clone();
        let writing = Task::new(
            async move {
                while let Some(message) = asked.next().await {
                    let Some(reply) = message.reply else { continue };
                    // If this fails, whoever asked takes the map, and this stream ends.
                    let _ = client.publish(reply, "busy".into()).await;
                }
            },
            || {},
        );
        let (waiting, stream) = (self.waiting.clone(), writer.stream().to_owned());
        let forget = {
            let (waiting, stream) = (waiting.clone(), stream.clone());
            move || waiting.forget(&stream)
        };
        let (bus, told, patience) = (bus.clone(), waiting.clone(), self.patience);
        let receive = acks::receive(bus, (map.clone(), entry), stream, told, acks, patience);
        Ok(LogStream {
            map: map.clone(),
            durable: Arc::new(AtomicU64::new(writer.through().unwrap_or(NONE))),
            writer,
            is_broken: false,
            waiting,
            acks: Arc::new(Task::new(receive, forget)),
            _writing: writing,
        })
    }
}

/// Whether another stream of the map is open, here or at another gateway.
async fn has_sender(bus: &Bus, map: &str) -> bool {
    let asked = bus.client.request(bus.writing_of(map), "".into());
    matches!(tokio::time::timeout(ASK, asked).await, Ok(Ok(_)))
}

impl Destination for LogStream {
    type Checked = ();

    fn received_through(&self) -> Option<u64> {
        self.writer.through()
    }

    fn check(
        wire: &v1::Frame,
        opening: &Opening,
        newest: Option<u64>,
        limits: &Limits,
    ) -> Result<(), Refusal> {
        check::frame(wire, opening, newest, limits).map(drop)
    }

    /// Appends a frame to the log. Its acknowledgement comes from the map's worker.
    async fn keep(&mut self, wire: v1::Frame, (): ()) -> Result<(Acked, Instant), Status> {
        let (sequence, since) = (wire.sequence, Instant::now());
        let acked = self.waiting.add(self.writer.stream(), sequence);
        self.is_broken = true;
        let written = self.writer.write(&Record::Frame(wire)).await;
        written.map_err(|error| refused(&self.map, &error))?;
        self.is_broken = false;
        self.durable.store(sequence, Ordering::Relaxed);
        // Acknowledgements are received as long as one is waited for.
        let (receiving, map) = (self.acks.clone(), self.map.clone());
        let acked = async move {
            let acked = acked.await;
            drop(receiving);
            acked.map_err(|_| Status::aborted(format!("map {map:?} was deleted meanwhile")))
        };
        Ok((Box::pin(acked), since))
    }

    fn count_refused(&self) {}

    fn completer(&self) -> Box<dyn Fn(&mut FrameAck) + Send + Sync> {
        let durable = self.durable.clone();
        Box::new(move |ack| {
            let through = durable.load(Ordering::Relaxed);
            ack.durable_through = (through != NONE).then_some(through);
        })
    }

    async fn end(&mut self) {
        if self.is_broken {
            return;
        }
        // Without it the worker sees the end when the next stream is opened.
        match tokio::time::timeout(END, self.writer.write(&Record::Close)).await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => {
                tracing::info!(map = self.map, %error, "the log has no end of a stream")
            }
            Err(_) => tracing::info!(map = self.map, "the log has no end of a stream"),
        }
    }
}

fn refused(map: &str, error: &WriteError) -> Status {
    match error {
        WriteError::Taken => Status::aborted(format!("map {map:?}: {error}")),
        WriteError::Unavailable(_) => unavailable(error),
    }
}

fn unavailable(error: &dyn std::fmt::Display) -> Status {
    Status::unavailable(format!("{error}: try again; acknowledged frames are kept"))
}
