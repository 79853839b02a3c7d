//! One `StreamFrames` call: frames in, acknowledgements out, in the same order.
//!
//! Two tasks serve a stream. The reader takes a message, checks and decodes it on a blocking
//! thread, records it and gives it to the mapper. The acknowledger waits for the
//! outcome of each frame and sends the acknowledgement. The queues between the tasks are bounded:
//! when the mapper's queue is full, or the sender does not read its acknowledgements, the reader
//! stops reading, and HTTP/2 flow control makes the sender wait.

use super::context::Context;
use super::guard::permit;
use super::maps::wire_warnings;
use super::status;
use crate::access::Caller;
use crate::check::{self, Opening, Refusal};
use crate::maps::Recording;
use crate::pipeline::frame::{FrameOutcome, Intrinsics, TrackingState};
use crate::pipeline::map::Map;
use crate::telemetry::{
    DECODE_SECONDS, FRAME_SECONDS, REFUSED, REGISTRATION_SECONDS, STREAMS, timed,
};
use lexsplat_proto::v1::{self, FrameAck, FrameStatus, frame_message::Message};
use nalgebra::{Isometry3, Matrix6};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, oneshot};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Status, Streaming};

type Acks = mpsc::Sender<Result<FrameAck, Status>>;

/// A message from the reader to the acknowledger, in the order of the frames.
enum Pending {
    /// The answer to the opening message.
    Opened,
    /// A frame that the mapper has or will get.
    Accepted { sequence: u64, since: Instant, outcome: oneshot::Receiver<FrameOutcome> },
    /// A frame that did not pass the checks.
    Refused { sequence: u64, refusal: Refusal },
}

/// Starts both tasks; the returned stream ends when they have ended.
pub(super) fn start(
    context: Context,
    caller: Caller,
    inbound: Streaming<v1::FrameMessage>,
) -> ReceiverStream<Result<FrameAck, Status>> {
    let (acks, stream) = mpsc::channel(context.config.ack_backlog);
    tokio::spawn(async move {
        metrics::gauge!(STREAMS).increment(1.0);
        if let Err(status) = converse(context, caller, inbound, &acks).await {
            tracing::info!(code = ?status.code(), reason = status.message(), "a stream ended");
            // If this fails, the sender has disconnected.
            let _ = acks.send(Err(status)).await;
        }
        metrics::gauge!(STREAMS).decrement(1.0);
    });
    ReceiverStream::new(stream)
}

async fn converse(
    context: Context,
    caller: Caller,
    mut inbound: Streaming<v1::FrameMessage>,
    acks: &Acks,
) -> Result<(), Status> {
    let (recording, opening) = open(&context, &caller, &mut inbound).await?;
    let (pending, waiting) = mpsc::channel(context.config.ack_backlog);
    let acknowledger = Acknowledger {
        camera: opening.registration.camera(),
        map: recording.map().clone(),
        is_recorded: recording.is_recorded(),
        ack_timeout: Duration::from_secs(context.config.ack_seconds),
    };
    let acknowledging = tokio::spawn(acknowledger.run(waiting, acks.clone()));
    let newest = recording.map().received_through();
    let mut reader = Reader { caller, recording, opening, newest, pending };
    let read = reader.run(&context, inbound).await;
    reader.recording.finish().await;
    // Frees the map for another sender and lets the acknowledger finish its queue.
    drop(reader);
    let acknowledged = acknowledging.await.map_err(|_| Status::internal("a stream panicked"))?;
    acknowledged.and(read)
}

/// Reads the opening message and opens the map that it names.
async fn open(
    context: &Context,
    caller: &Caller,
    inbound: &mut Streaming<v1::FrameMessage>,
) -> Result<(Recording, Opening), Status> {
    let limit = Duration::from_secs(context.config.open_seconds);
    let first = tokio::select! {
        first = tokio::time::timeout(limit, inbound.message()) => first,
        () = context.stopping.cancelled() => return Err(stopping()),
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
        check::opening(&open, &context.limits).map_err(|refusal| status::refused(&refusal))?;
    let recording =
        context.maps.open(&open).await.map_err(|error| status::of_maps(&error, "map"))?;
    tracing::info!(map = open.map, caller = caller.name(), camera = ?opening.registration.camera(), "a stream opened");
    Ok((recording, opening))
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

struct Reader {
    caller: Caller,
    recording: Recording,
    opening: Opening,
    /// Sequence of the last accepted frame.
    newest: Option<u64>,
    pending: mpsc::Sender<Pending>,
}

impl Reader {
    /// Reads until the sender ends the stream, the server stops or an error occurs.
    async fn run(
        &mut self,
        context: &Context,
        mut inbound: Streaming<v1::FrameMessage>,
    ) -> Result<(), Status> {
        self.tell(Pending::Opened).await?;
        loop {
            let message = tokio::select! {
                message = inbound.message() => message?,
                () = context.stopping.cancelled() => return Err(stopping()),
                () = self.caller.withdrawn() => return Err(withdrawn()),
                () = self.pending.closed() => return Err(unread()),
            };
            let Some(message) = message else { return Ok(()) };
            let told = match message.message {
                Some(Message::Frame(frame)) => self.accept(context, frame).await?,
                Some(Message::Open(_)) => {
                    return Err(out_of_place("open", "a second opening message came"));
                }
                None => self.refuse(0, Refusal::new("message", "expected a frame, found nothing")),
            };
            self.tell(told).await?;
        }
    }

    /// Checks and records a frame, then gives it to the mapper.
    async fn accept(&mut self, context: &Context, wire: v1::Frame) -> Result<Pending, Status> {
        let started = Instant::now();
        let (opening, newest, limits) = (self.opening.clone(), self.newest, context.limits);
        let sequence = wire.sequence;
        let (wire, checked) = tokio::task::spawn_blocking(move || {
            let checked = check::frame(&wire, &opening, newest, &limits);
            let register = |raw| timed(REGISTRATION_SECONDS, || check::registered(raw, &opening));
            (wire, checked.and_then(register))
        })
        .await
        .map_err(|_| Status::internal(format!("decoding frame {sequence} panicked")))?;
        metrics::histogram!(DECODE_SECONDS).record(started.elapsed());
        let frame = match checked {
            Ok(frame) => frame,
            Err(refusal) => return Ok(self.refuse(sequence, refusal)),
        };
        self.recording.record(wire).await.map_err(|error| {
            tracing::error!(%error, sequence, "a frame cannot be recorded");
            let reason = error.reason();
            Status::unavailable(format!(
                "frame {sequence} is not in the map, because it cannot be recorded: {reason}"
            ))
        })?;
        self.newest = Some(sequence);
        let since = Instant::now();
        let map = self.recording.map();
        let outcome = map.submit(frame).await.map_err(|error| status::of_map(&error, "map"))?;
        Ok(Pending::Accepted { sequence, since, outcome })
    }

    fn refuse(&self, sequence: u64, refusal: Refusal) -> Pending {
        self.recording.map().count_refused();
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
    map: Arc<Map>,
    /// Whether every frame that the map received is on disk.
    is_recorded: bool,
    /// How long the sender may take to read an acknowledgement.
    ack_timeout: Duration,
}

impl Acknowledger {
    /// Sends acknowledgements until the reader has ended.
    async fn run(self, mut waiting: mpsc::Receiver<Pending>, acks: Acks) -> Result<(), Status> {
        while let Some(pending) = waiting.recv().await {
            let ack = self.ack(pending).await?;
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
                received_through: self.map.received_through(),
                map_revision: self.map.status().revision,
                camera: Some(wire_camera(&self.camera)),
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
                outcome_ack(outcome)
            }
        };
        // Frames are recorded before the map gets them.
        ack.durable_through = self.map.received_through().filter(|_| self.is_recorded);
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

fn outcome_ack(outcome: FrameOutcome) -> FrameAck {
    let status = match outcome.tracking {
        TrackingState::Tracking if outcome.relocalised => FrameStatus::Relocalised,
        TrackingState::Tracking => FrameStatus::Tracked,
        TrackingState::Lost | TrackingState::Empty => FrameStatus::Lost,
    };
    FrameAck {
        sequence: outcome.sequence,
        status: status.into(),
        world_from_camera: outcome.world_from_camera.as_ref().map(wire_pose),
        pose_covariance: outcome.covariance.map(row_major).unwrap_or_default(),
        keyframe: outcome.keyframe,
        map_revision: outcome.revision,
        input_warnings: wire_warnings(outcome.input_warnings),
        ..FrameAck::default()
    }
}

fn row_major(covariance: Matrix6<f64>) -> Vec<f64> {
    covariance.transpose().as_slice().to_vec()
}

fn wire_camera(camera: &Intrinsics) -> v1::Intrinsics {
    let Intrinsics { width, height, fx, fy, cx, cy } = *camera;
    v1::Intrinsics { width, height, fx, fy, cx, cy }
}

fn wire_pose(target_from_source: &Isometry3<f64>) -> v1::Pose {
    let (q, t) = (target_from_source.rotation, target_from_source.translation);
    v1::Pose {
        rotation: Some(v1::Quaternion { w: q.w, x: q.i, y: q.j, z: q.k }),
        translation_metres: Some(v1::Vector3 { x: t.x, y: t.y, z: t.z }),
    }
}
