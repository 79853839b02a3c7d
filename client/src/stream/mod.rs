//! **Streaming** a data set to a server over gRPC.
//!
//! In: a [`Dataset`], where to and how ([`StreamOptions`]). Out: frames on the wire, [`Progress`] per
//! acknowledgement and a [`Summary`]. Frames that the map has seen already are not sent again. A
//! blocking thread reads or renders ahead of a bounded queue; when the server is busy, flow control
//! fills the queue and the thread waits. Nothing is dropped and nothing is decoded here.

mod error;
mod producer;

pub use error::ClientError;

use crate::dataset::{Dataset, Instance};
use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_proto::v1::{self, FrameAck, FrameMessage, FrameStatus, frame_message::Message};
use producer::Producer;
pub(crate) use producer::wire;
use serde::Serialize;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Streaming;
use tonic::transport::Endpoint;

/// Frames read ahead of the wire.
const READ_AHEAD: usize = 4;
/// Refusals that a summary tells in full.
const TOLD_REFUSALS: usize = 5;
const CONNECT_WITHIN: Duration = Duration::from_secs(5);

/// Where the poses of the map come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Poses {
    /// From the data set
    #[default]
    Given,
    /// The server tracks the camera itself; the data set only says where the first frame is
    #[value(alias = "estimated")]
    Estimate,
}

/// Where the map's language comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Encoder {
    /// The server's networks look at each keyframe
    #[default]
    Bundle,
    /// The data set's masks: each pixel's language is the name of its class
    Oracle,
}

/// Where to stream to, and how.
#[derive(Clone, Debug)]
pub struct StreamOptions {
    /// The server's gRPC address, `HOST:PORT`.
    pub grpc: String,
    /// The map to make or go on with.
    pub map: String,
    /// Where poses come from.
    pub poses: Poses,
    /// Where language comes from.
    pub encoder: Encoder,
    /// Every so many frames one is held out: tracked, and never a keyframe. `None`: none is.
    pub hold_out_every: Option<NonZeroUsize>,
    /// Whether frames are sent at the pace of their timestamps, not as fast as the server takes them.
    pub realtime: bool,
}

/// How far a stream is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Frames acknowledged in this stream.
    pub acknowledged: u64,
    /// Frames to send in this stream.
    pub total: u64,
    /// What became of the last one; `Opened` before the first.
    pub status: FrameStatus,
    /// Frames waiting in the map's queue.
    pub queue_depth: u32,
    /// Frames that fit in the map's queue.
    pub queue_capacity: u32,
    /// Frames acknowledged per second since the stream opened.
    pub frames_per_second: f64,
}

/// A frame that the server did not take.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Refusal {
    /// The frame.
    pub sequence: u64,
    /// The field at fault.
    pub field: String,
    /// What is wrong with it.
    pub reason: String,
}

/// What became of a stream.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// The map.
    pub map: String,
    /// Frames that were not sent because the map has seen them.
    pub resumed_past: u64,
    /// Frames sent and acknowledged.
    pub sent: u64,
    /// Of those: frames whose pose is known.
    pub tracked: u64,
    /// Of those: frames whose pose is not known.
    pub lost: u64,
    /// Of those: frames that did not pass the server's checks.
    pub refused: u64,
    /// The first refused frames, with reasons.
    pub refusals: Vec<Refusal>,
    /// Numbers of the frames that became keyframes.
    pub keyframes: Vec<u64>,
    /// From the stream's opening to its last acknowledgement.
    pub seconds: f64,
    /// Frames sent per second.
    pub frames_per_second: f64,
    /// Frames up to this number survive a crash of the server; absent: none does.
    pub durable_through: Option<u64>,
    /// The map's revision after the last frame.
    pub map_revision: u64,
}

/// Streams what the map has not seen yet, and waits for every acknowledgement.
///
/// # Errors
/// [`ClientError`]. Frames acknowledged before are in the map: the same call goes on after them.
pub async fn stream(
    dataset: Arc<dyn Dataset>,
    options: &StreamOptions,
    mut on_progress: impl FnMut(&Progress),
) -> Result<Summary, ClientError> {
    if options.encoder == Encoder::Oracle && dataset.truth().is_none() {
        return Err(ClientError::NoMasks { dataset: dataset.name().to_owned() });
    }
    let (frames, outbound) = mpsc::channel(READ_AHEAD);
    let mut client = connect(&options.grpc).await?;
    let open = FrameMessage { message: Some(Message::Open(opening(&*dataset, options))) };
    frames.try_send(open).expect("the queue is new and holds more than one message");
    let broken = |status| ClientError::of_status(status, &options.grpc);
    let call = client.stream_frames(ReceiverStream::new(outbound)).await;
    let mut acks = call.map_err(broken)?.into_inner();
    let opened = acks.message().await.map_err(broken)?;
    let opened = opened
        .filter(|ack| ack.status() == FrameStatus::Opened)
        .ok_or_else(|| ClientError::unanswered(&options.grpc))?;

    let seen = opened.received_through.max(opened.durable_through);
    let is_new = |index: &usize| seen.is_none_or(|seen| dataset.sequence(*index) > seen);
    let indices: Vec<usize> = (0..dataset.len()).filter(is_new).collect();
    let mut tally = Tally::new(&options.map, &opened, dataset.len(), indices.len());
    on_progress(&tally.progress(&opened));
    let producer = Producer {
        dataset,
        indices,
        needs_poses: options.poses == Poses::Given,
        realtime: options.realtime,
        labels: options.encoder == Encoder::Oracle,
        hold_out_every: options.hold_out_every,
        frames,
    };
    let producing = tokio::task::spawn_blocking(move || producer.run());
    drain(&mut acks, &mut tally, &mut on_progress).await.map_err(broken)?;
    producing.await.map_err(|_| ClientError::Panicked)??;
    if tally.summary.sent < tally.total {
        return Err(ClientError::unanswered(&options.grpc));
    }
    Ok(tally.summary)
}

/// A client of the server at `HOST:PORT`.
pub(crate) async fn connect(
    address: &str,
) -> Result<MappingClient<tonic::transport::Channel>, ClientError> {
    let bad = || ClientError::Address { found: address.into() };
    let (_, port) = address.rsplit_once(':').ok_or_else(bad)?;
    port.parse::<u16>().map_err(|_| bad())?;
    let uri = if address.contains("://") { address.into() } else { format!("http://{address}") };
    let endpoint = Endpoint::from_shared(uri).map_err(|_| bad())?.connect_timeout(CONNECT_WITHIN);
    let channel = endpoint.connect().await;
    Ok(MappingClient::new(channel.map_err(|_| ClientError::NoServer { address: address.into() })?))
}

/// The message that opens the map.
pub(crate) fn opening(dataset: &dyn Dataset, options: &StreamOptions) -> v1::OpenMap {
    let camera = dataset.intrinsics();
    let pose_source = match options.poses {
        Poses::Given => v1::PoseSource::Given,
        Poses::Estimate => v1::PoseSource::Estimated,
    };
    v1::OpenMap {
        map: options.map.clone(),
        intrinsics: Some(v1::Intrinsics {
            width: camera.width,
            height: camera.height,
            fx: camera.fx,
            fy: camera.fy,
            cx: camera.cx,
            cy: camera.cy,
        }),
        depth_unit_metres: dataset.depth_unit_metres(),
        pose_source: pose_source.into(),
        label_texts: match (options.encoder, dataset.truth()) {
            (Encoder::Oracle, Some(truth)) => label_texts(truth.instances()),
            _ => Vec::new(),
        },
    }
}

/// Labels are the masks' own instances, and stand for their classes.
fn label_texts(instances: &[Instance]) -> Vec<String> {
    let most = instances.iter().map(|thing| usize::from(thing.id)).max().unwrap_or_default();
    let mut texts = vec![String::new(); most];
    for thing in instances.iter().filter(|thing| thing.id > 0) {
        texts[usize::from(thing.id) - 1].clone_from(&thing.class);
    }
    texts
}

/// Counts acknowledgements until the server is done.
async fn drain(
    acks: &mut Streaming<FrameAck>,
    tally: &mut Tally,
    on_progress: &mut impl FnMut(&Progress),
) -> Result<(), tonic::Status> {
    while let Some(ack) = acks.message().await? {
        tally.count(&ack);
        on_progress(&tally.progress(&ack));
    }
    Ok(())
}

/// A summary in the making.
struct Tally {
    summary: Summary,
    total: u64,
    started: Instant,
}

impl Tally {
    fn new(map: &str, opened: &FrameAck, all: usize, to_send: usize) -> Self {
        let summary = Summary {
            map: map.into(),
            resumed_past: (all - to_send) as u64,
            durable_through: opened.durable_through,
            map_revision: opened.map_revision,
            ..Summary::default()
        };
        Self { summary, total: to_send as u64, started: Instant::now() }
    }

    fn count(&mut self, ack: &FrameAck) {
        let summary = &mut self.summary;
        summary.sent += 1;
        match ack.status() {
            FrameStatus::Tracked | FrameStatus::Relocalised => summary.tracked += 1,
            FrameStatus::Refused => {
                summary.refused += 1;
                if summary.refusals.len() < TOLD_REFUSALS {
                    summary.refusals.push(Refusal {
                        sequence: ack.sequence,
                        field: ack.refused_field.clone(),
                        reason: ack.refused_reason.clone(),
                    });
                }
            }
            FrameStatus::Lost | FrameStatus::Opened | FrameStatus::Unspecified => summary.lost += 1,
        }
        if ack.keyframe {
            summary.keyframes.push(ack.sequence);
        }
        summary.durable_through = ack.durable_through.max(summary.durable_through);
        summary.map_revision = ack.map_revision;
        summary.seconds = self.started.elapsed().as_secs_f64();
        summary.frames_per_second = summary.sent as f64 / summary.seconds.max(f64::MIN_POSITIVE);
    }

    fn progress(&self, ack: &FrameAck) -> Progress {
        Progress {
            acknowledged: self.summary.sent,
            total: self.total,
            status: ack.status(),
            queue_depth: ack.queue_depth,
            queue_capacity: ack.queue_capacity,
            frames_per_second: self.summary.frames_per_second,
        }
    }
}

#[cfg(test)]
mod tests;
