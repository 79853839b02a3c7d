//! One `StreamFrames` call: frames in, acknowledgements out, in order.
//!
//! Two tasks. The reader takes a message, checks and decodes it off the async threads, writes it to
//! the map's log and hands it to the mapper; the acknowledger waits for each outcome in turn.
//! Between them is a bounded queue, and behind the acknowledger another: when the mapper's queue is
//! full, or the sender does not read its acknowledgements, the reader stops reading and HTTP/2 flow
//! control makes the sender wait.

use super::convert::{self, Opening, Refusal};
use super::{MappingService, status};
use crate::pipeline::frame::{FrameOutcome, TrackingState};
use crate::pipeline::map::{Map, SenderGuard};
use crate::store::Log;
use crate::telemetry::{DECODE_SECONDS, FRAME_SECONDS, REFUSED, STREAMS};
use lexsplat_proto::v1::{self, FrameAck, FrameStatus, frame_message::Message};
use nalgebra::Isometry3;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, oneshot};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Status, Streaming};

type Acks = mpsc::Sender<Result<FrameAck, Status>>;

/// What the acknowledger is told, in the order of the frames.
enum Pending {
    /// The answer to the opening message.
    Opened,
    /// Waits for the mapper.
    Accepted { sequence: u64, since: Instant, outcome: oneshot::Receiver<FrameOutcome> },
    /// Did not pass.
    Refused { sequence: u64, refusal: Refusal },
}

/// Starts both tasks; the stream ends when they have.
pub(super) fn start(
    service: MappingService,
    inbound: Streaming<v1::FrameMessage>,
) -> ReceiverStream<Result<FrameAck, Status>> {
    let (acks, stream) = mpsc::channel(service.config.ack_backlog);
    tokio::spawn(async move {
        metrics::gauge!(STREAMS).increment(1.0);
        if let Err(status) = converse(service, inbound, &acks).await {
            tracing::info!(code = ?status.code(), reason = status.message(), "a stream ended");
            // An error means that the sender has gone already.
            let _ = acks.send(Err(status)).await;
        }
        metrics::gauge!(STREAMS).decrement(1.0);
    });
    ReceiverStream::new(stream)
}

async fn converse(
    service: MappingService,
    mut inbound: Streaming<v1::FrameMessage>,
    acks: &Acks,
) -> Result<(), Status> {
    let (guard, opening, log) = open(&service, &mut inbound).await?;
    let (pending, waiting) = mpsc::channel(service.config.ack_backlog);
    let patience = Duration::from_secs(service.config.ack_seconds);
    let acknowledger = Acknowledger { map: guard.map().clone(), log: log.clone(), patience };
    let acknowledging = tokio::spawn(acknowledger.run(waiting, acks.clone()));
    let mut reader =
        Reader { newest: guard.map().received_through(), guard, opening, log, pending };
    let read = reader.run(&service, inbound).await;
    reader.write_out().await;
    // Gives the sender's place back and lets the acknowledger finish what is in hand.
    drop(reader);
    let acknowledged = acknowledging.await.map_err(|_| Status::internal("a stream panicked"))?;
    acknowledged.and(read)
}

/// Takes the opening message and the map's one place for a sender.
async fn open(
    service: &MappingService,
    inbound: &mut Streaming<v1::FrameMessage>,
) -> Result<(SenderGuard, Opening, Option<Arc<Log>>), Status> {
    let patience = Duration::from_secs(service.config.open_seconds);
    let first = tokio::select! {
        first = tokio::time::timeout(patience, inbound.message()) => first,
        () = service.stopping.cancelled() => return Err(stopping()),
    };
    let first = first.map_err(|_| {
        Status::deadline_exceeded(format!("no opening message within {patience:?}"))
    })??;
    let open = match first.and_then(|message| message.message) {
        Some(Message::Open(open)) => open,
        Some(Message::Frame(_)) => return Err(out_of_place("open", "a frame came before it")),
        None => return Err(out_of_place("open", "the stream is empty")),
    };
    let opening =
        convert::opening(&open, &service.limits).map_err(|refusal| status::refused(&refusal))?;
    let engine = service.engine.clone();
    let name = open.map.clone();
    // Making a map takes device memory and a thread.
    let map = tokio::task::spawn_blocking(move || engine.open(&name))
        .await
        .map_err(|_| Status::internal("opening the map panicked"))?
        .map_err(|error| status::of_map(&error, "map"))?;
    let guard = map.claim(opening.intrinsics).map_err(|error| status::of_map(&error, "map"))?;
    let log =
        service.store.log(&open).await.map_err(|error| Status::internal(error.to_string()))?;
    tracing::info!(map = map.name(), camera = ?opening.intrinsics, "a stream opened");
    Ok((guard, opening, log))
}

fn out_of_place(field: &str, reason: &str) -> Status {
    let message = format!("the first message opens the map and the rest are frames: {reason}");
    status::at_field(Code::InvalidArgument, &message, field, reason)
}

fn stopping() -> Status {
    Status::unavailable("the server is stopping; what was acknowledged is in the map")
}

fn unread() -> Status {
    Status::cancelled("the sender does not read its acknowledgements")
}

struct Reader {
    guard: SenderGuard,
    opening: Opening,
    log: Option<Arc<Log>>,
    newest: Option<u64>,
    pending: mpsc::Sender<Pending>,
}

impl Reader {
    /// Reads until the sender is done, the server stops or somebody fails.
    async fn run(
        &mut self,
        service: &MappingService,
        mut inbound: Streaming<v1::FrameMessage>,
    ) -> Result<(), Status> {
        self.tell(Pending::Opened).await?;
        loop {
            let message = tokio::select! {
                message = inbound.message() => message?,
                () = service.stopping.cancelled() => return Err(stopping()),
                () = self.pending.closed() => return Err(unread()),
            };
            let Some(message) = message else { return Ok(()) };
            let told = match message.message {
                Some(Message::Frame(frame)) => self.take(service, frame).await?,
                Some(Message::Open(_)) => return Err(out_of_place("open", "it came twice")),
                None => self.refuse(0, Refusal::new("message", "expected a frame, found nothing")),
            };
            self.tell(told).await?;
        }
    }

    async fn take(&mut self, service: &MappingService, wire: v1::Frame) -> Result<Pending, Status> {
        let started = Instant::now();
        let (opening, newest, limits) = (self.opening.clone(), self.newest, service.limits);
        let sequence = wire.sequence;
        let (wire, checked) = tokio::task::spawn_blocking(move || {
            let checked = convert::frame(&wire, &opening, newest, &limits);
            (wire, checked)
        })
        .await
        .map_err(|_| Status::internal(format!("decoding frame {sequence} panicked")))?;
        metrics::histogram!(DECODE_SECONDS).record(started.elapsed());
        let frame = match checked {
            Ok(frame) => frame,
            Err(refusal) => return Ok(self.refuse(sequence, refusal)),
        };
        if let Some(log) = &self.log {
            log.append(wire).await.map_err(|error| Status::internal(error.to_string()))?;
        }
        self.newest = Some(sequence);
        let since = Instant::now();
        let map = self.guard.map();
        let outcome = map.submit(frame).await.map_err(|error| status::of_map(&error, "map"))?;
        Ok(Pending::Accepted { sequence, since, outcome })
    }

    /// Waits until the log is written, so that the map's next sender finds it whole.
    async fn write_out(&self) {
        if let (Some(log), Some(newest)) = (&self.log, self.newest) {
            // A log that failed has nothing left to write.
            let _ = log.durable(newest).await;
        }
    }

    fn refuse(&self, sequence: u64, refusal: Refusal) -> Pending {
        self.guard.map().count_refused();
        metrics::counter!(REFUSED, "field" => refusal.field.clone()).increment(1);
        Pending::Refused { sequence, refusal }
    }

    async fn tell(&self, pending: Pending) -> Result<(), Status> {
        self.pending.send(pending).await.map_err(|_| unread())
    }
}

struct Acknowledger {
    map: Arc<Map>,
    log: Option<Arc<Log>>,
    patience: Duration,
}

impl Acknowledger {
    /// Answers in order until the reader is done.
    async fn run(self, mut waiting: mpsc::Receiver<Pending>, acks: Acks) -> Result<(), Status> {
        while let Some(pending) = waiting.recv().await {
            let ack = self.ack(pending).await?;
            let sent = tokio::time::timeout(self.patience, acks.send(Ok(ack))).await;
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
                received_through: self.map.received_through(),
                map_revision: self.map.status().revision,
                ..FrameAck::default()
            },
            Pending::Refused { sequence, refusal } => FrameAck {
                sequence,
                status: FrameStatus::Refused.into(),
                refused_field: refusal.field,
                refused_reason: refusal.reason,
                map_revision: self.map.status().revision,
                ..FrameAck::default()
            },
            Pending::Accepted { sequence, since, outcome } => {
                let outcome = outcome.await.map_err(|_| self.mapper_gone(sequence))?;
                metrics::histogram!(FRAME_SECONDS).record(since.elapsed());
                if let Some(log) = &self.log {
                    let failed =
                        |error: crate::store::StoreError| Status::internal(error.to_string());
                    log.durable(sequence).await.map_err(failed)?;
                }
                outcome_ack(&outcome)
            }
        };
        ack.durable_through = self.log.as_ref().and_then(|log| log.durable_through());
        let (depth, capacity) = self.map.queue();
        ack.queue_depth = u32::try_from(depth).unwrap_or(u32::MAX);
        ack.queue_capacity = u32::try_from(capacity).unwrap_or(u32::MAX);
        Ok(ack)
    }

    fn mapper_gone(&self, sequence: u64) -> Status {
        let reason = self.map.status().failure.unwrap_or_else(|| "it was stopped".into());
        Status::aborted(format!(
            "map {:?} ended before frame {sequence} was handled: {reason}",
            self.map.name()
        ))
    }
}

fn outcome_ack(outcome: &FrameOutcome) -> FrameAck {
    let status = match outcome.tracking {
        TrackingState::Tracking if outcome.relocalised => FrameStatus::Relocalised,
        TrackingState::Tracking => FrameStatus::Tracked,
        TrackingState::Lost | TrackingState::Empty => FrameStatus::Lost,
    };
    FrameAck {
        sequence: outcome.sequence,
        status: status.into(),
        world_from_camera: outcome.world_from_camera.as_ref().map(wire_pose),
        keyframe: outcome.keyframe,
        map_revision: outcome.revision,
        ..FrameAck::default()
    }
}

fn wire_pose(target_from_source: &Isometry3<f64>) -> v1::Pose {
    let (q, t) = (target_from_source.rotation, target_from_source.translation);
    v1::Pose {
        rotation: Some(v1::Quaternion { w: q.w, x: q.i, y: q.j, z: q.k }),
        translation_metres: Some(v1::Vector3 { x: t.x, y: t.y, z: t.z }),
    }
}
