//! One `StreamFrames` call: frames in, acknowledgements out, in the same order.
//!
//! Two tasks serve a stream. The reader takes a message, checks and decodes it on a blocking
//! thread, and hands it to the destination. The acknowledger waits for the
//! acknowledgement of each frame and sends it. The queues between the tasks are bounded:
//! when the mapper's queue is full, or the sender does not read its acknowledgements, the reader
//! stops reading, and HTTP/2 flow control makes the sender wait.

use super::config::IngestConfig;
use super::destination::{Acked, Destination, Destinations};
use super::guard::permit;
use super::status;
use crate::access::Caller;
use crate::check::{self, Limits, Opening, Refusal};
use crate::pipeline::frame::Intrinsics;
use crate::telemetry::{DECODE_SECONDS, FRAME_SECONDS, REFUSED, STREAMS};
use lexsplat_proto::v1::{self, FrameAck, FrameStatus, frame_message::Message};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;
use tonic::{Code, Status, Streaming};

type Acks = mpsc::Sender<Result<FrameAck, Status>>;

/// How long the last acknowledgements of a stream that broke off may take.
const LAST_ACKS: Duration = Duration::from_secs(20);

/// The rules of all streams.
#[derive(Clone)]
pub(crate) struct Terms {
    pub(crate) config: Arc<IngestConfig>,
    pub(crate) limits: Limits,
    /// Cancelled when the server stops.
    pub(crate) stopping: CancellationToken,
}

/// A message from the reader to the acknowledger, in the order of the frames.
enum Pending {
    /// The answer to the opening message.
    Opened,
    /// A frame that the mapper has or will get.
    Accepted { since: Instant, acked: Acked },
    /// A frame that did not pass the checks.
    Refused { sequence: u64, refusal: Refusal },
}

/// Starts both tasks; the returned stream ends when they have ended.
pub(crate) fn start<D: Destinations>(
    terms: Terms,
    destinations: D,
    caller: Caller,
    inbound: Streaming<v1::FrameMessage>,
) -> ReceiverStream<Result<FrameAck, Status>> {
    let (acks, stream) = mpsc::channel(terms.config.ack_backlog);
    tokio::spawn(async move {
        metrics::gauge!(STREAMS).increment(1.0);
        if let Err(status) = converse(terms, destinations, caller, inbound, &acks).await {
            tracing::info!(code = ?status.code(), reason = status.message(), "a stream ended");
            // If this fails, the sender has disconnected.
            let _ = acks.send(Err(status)).await;
        }
        metrics::gauge!(STREAMS).decrement(1.0);
    });
    ReceiverStream::new(stream)
}

async fn converse<D: Destinations>(
    terms: Terms,
    destinations: D,
    caller: Caller,
    mut inbound: Streaming<v1::FrameMessage>,
    acks: &Acks,
) -> Result<(), Status> {
    let (destination, opening) = open(&terms, &destinations, &caller, &mut inbound).await?;
    let (pending, waiting) = mpsc::channel(terms.config.ack_backlog);
    let acknowledger = Acknowledger {
        camera: opening.registration.camera(),
        received_through: destination.received_through(),
        complete: destination.completer(),
        ack_timeout: Duration::from_secs(terms.config.ack_seconds),
    };
    let acknowledging = tokio::spawn(acknowledger.run(waiting, acks.clone()));
    let newest = destination.received_through();
    let mut reader = Reader { caller, destination, opening, newest, pending };
    let read = reader.run(&terms, inbound).await;
    reader.destination.end().await;
    // Frees the map for another sender and lets the acknowledger finish its queue.
    drop(reader);
    let acknowledging = async move {
        let ended = acknowledging.await;
        ended.map_err(|_| Status::internal("a stream panicked"))?
    };
    match read {
        Ok(()) => acknowledging.await,
        // In a fleet nobody may have the map for now.
        Err(error) => match tokio::time::timeout(LAST_ACKS, acknowledging).await {
            Ok(acknowledged) => acknowledged.and(Err(error)),
            Err(_) => Err(error),
        },
    }
}

/// Reads the opening message and opens the map that it names.
async fn open<D: Destinations>(
    terms: &Terms,
    destinations: &D,
    caller: &Caller,
    inbound: &mut Streaming<v1::FrameMessage>,
) -> Result<(D::One, Opening), Status> {
    let limit = Duration::from_secs(terms.config.open_seconds);
    let first = tokio::select! {
        first = tokio::time::timeout(limit, inbound.message()) => first,
        () = terms.stopping.cancelled() => return Err(stopping()),
    };
    let first = first
        .map_err(|_| Status::deadline_exceeded(format!("no opening message within {limit:?}")))??;
    let open = match first.and_then(|message| message.message) {
        Some(Message::Open(open)) => open,
        Some(Message::Frame(_)) => return Err(out_of_place("open", "a frame came first")),
        None => return Err(out_of_place("open", "the stream is empty")),
    };
    permit(caller, &open.map, "map")?;
    let opening =
        check::opening(&open, &terms.limits).map_err(|refusal| status::refused(&refusal))?;
    let destination = destinations.destination(&open).await?;
    tracing::info!(map = open.map, caller = caller.name(), camera = ?opening.registration.camera(), "a stream opened");
    Ok((destination, opening))
}

fn out_of_place(field: &str, reason: &str) -> Status {
    let message = format!("expected one opening message, then frames: {reason}");
    status::at_field(Code::InvalidArgument, &message, field, reason)
}

fn stopping() -> Status {
    Status::unavailable("the server is stopping; acknowledged frames are in the map")
}

fn withdrawn() -> Status {
    Status::unauthenticated("the caller's token was withdrawn or its rights were changed")
}

fn unread() -> Status {
    Status::cancelled("the sender does not read its acknowledgements")
}

struct Reader<D> {
    caller: Caller,
    destination: D,
    opening: Opening,
    /// Sequence of the last accepted frame.
    newest: Option<u64>,
    pending: mpsc::Sender<Pending>,
}

impl<D: Destination> Reader<D> {
    /// Reads until the sender ends the stream, the server stops or an error occurs.
    async fn run(
        &mut self,
        terms: &Terms,
        mut inbound: Streaming<v1::FrameMessage>,
    ) -> Result<(), Status> {
        self.tell(Pending::Opened).await?;
        loop {
            let message = tokio::select! {
                message = inbound.message() => message?,
                () = terms.stopping.cancelled() => return Err(stopping()),
                () = self.caller.withdrawn() => return Err(withdrawn()),
                () = self.pending.closed() => return Err(unread()),
            };
            let Some(message) = message else { return Ok(()) };
            let told = match message.message {
                Some(Message::Frame(frame)) => self.accept(terms, frame).await?,
                Some(Message::Open(_)) => {
                    return Err(out_of_place("open", "a second opening message came"));
                }
                None => self.refuse(0, Refusal::new("message", "expected a frame, found nothing")),
            };
            self.tell(told).await?;
        }
    }

    /// Checks a frame and hands it to the destination.
    async fn accept(&mut self, terms: &Terms, wire: v1::Frame) -> Result<Pending, Status> {
        let started = Instant::now();
        let (opening, newest, limits) = (self.opening.clone(), self.newest, terms.limits);
        let sequence = wire.sequence;
        let (wire, checked) = tokio::task::spawn_blocking(move || {
            let checked = D::check(&wire, &opening, newest, &limits);
            (wire, checked)
        })
        .await
        .map_err(|_| Status::internal(format!("decoding frame {sequence} panicked")))?;
        metrics::histogram!(DECODE_SECONDS).record(started.elapsed());
        let checked = match checked {
            Ok(checked) => checked,
            Err(refusal) => return Ok(self.refuse(sequence, refusal)),
        };
        let (kept, since) = self.destination.keep(wire, checked).await?;
        self.newest = Some(sequence);
        Ok(Pending::Accepted { since, acked: kept })
    }

    fn refuse(&self, sequence: u64, refusal: Refusal) -> Pending {
        self.destination.count_refused();
        metrics::counter!(REFUSED, "field" => refusal.field.clone()).increment(1);
        Pending::Refused { sequence, refusal }
    }

    async fn tell(&self, pending: Pending) -> Result<(), Status> {
        self.pending.send(pending).await.map_err(|_| unread())
    }
}

struct Acknowledger {
    /// The pinhole camera of the frames.
    camera: Intrinsics,
    /// Newest frame that the map had when the stream was opened.
    received_through: Option<u64>,
    complete: Box<dyn Fn(&mut FrameAck) + Send + Sync>,
    /// How long the sender may take to read an acknowledgement.
    ack_timeout: Duration,
}

impl Acknowledger {
    /// Sends acknowledgements until the reader has ended.
    async fn run(self, mut waiting: mpsc::Receiver<Pending>, acks: Acks) -> Result<(), Status> {
        while let Some(pending) = waiting.recv().await {
            // The frame may wait for long; a sender that is gone must not keep others from the map.
            let ack = tokio::select! {
                ack = self.ack(pending) => ack?,
                () = acks.closed() => return Err(unread()),
            };
            let sent = tokio::time::timeout(self.ack_timeout, acks.send(Ok(ack))).await;
            if !matches!(sent, Ok(Ok(()))) {
                return Err(unread());
            }
        }
        Ok(())
    }

    async fn ack(&self, pending: Pending) -> Result<FrameAck, Status> {
        let mut ack = match pending {
            Pending::Opened => FrameAck {
                status: FrameStatus::Opened.into(),
                received_through: self.received_through,
                camera: Some(wire_camera(&self.camera)),
                ..FrameAck::default()
            },
            Pending::Refused { sequence, refusal } => refused_ack(sequence, refusal),
            Pending::Accepted { since, acked } => {
                let ack = acked.await?;
                metrics::histogram!(FRAME_SECONDS).record(since.elapsed());
                ack
            }
        };
        (self.complete)(&mut ack);
        Ok(ack)
    }
}

/// The acknowledgement of a frame that did not pass the checks.
pub(crate) fn refused_ack(sequence: u64, refusal: Refusal) -> FrameAck {
    FrameAck {
        sequence,
        status: FrameStatus::Refused.into(),
        refused_field: refusal.field,
        refused_reason: refusal.reason,
        ..FrameAck::default()
    }
}

fn wire_camera(camera: &Intrinsics) -> v1::Intrinsics {
    let Intrinsics { width, height, fx, fy, cx, cy } = *camera;
    v1::Intrinsics { width, height, fx, fy, cx, cy }
}
