//! One gRPC stream of frames into one map.
//!
//! [`FrameStream::open`] connects and creates the map or resumes it. Frames go in through
//! [`FrameSender`]; the server acknowledges each one through [`Acks`]. The stream ends when every
//! sender is dropped and the last frame is acknowledged.

use super::connect::{Connection, connect};
use super::error::ClientError;
use super::options::{Encoder, Poses, StreamOptions};
use super::wire;
use crate::access::Access;
use crate::dataset::{Cameras, Dataset, Instance, RgbdFrame};
use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_proto::v1::{self, FrameAck, FrameMessage, FrameStatus, frame_message::Message};
use std::time::{Duration, Instant};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Streaming};

/// How long opening a map waits for a server that is loading it.
const LOADING: Duration = Duration::from_secs(600);
/// Between two tries meanwhile.
const RETRY: Duration = Duration::from_secs(1);

/// The map that a stream creates or resumes.
#[derive(Clone, Debug, PartialEq)]
pub struct MapSpec {
    /// The map's name.
    pub map: String,
    /// The cameras of every frame.
    pub cameras: Cameras,
    /// Metres per unit of depth.
    pub depth_unit_metres: f64,
    /// Where poses come from.
    pub poses: Poses,
    /// The text of each label from 1 on, if frames carry labels; else empty.
    pub label_texts: Vec<String>,
}

impl MapSpec {
    /// The map of a data set.
    pub(super) fn of(dataset: &dyn Dataset, options: &StreamOptions) -> Self {
        Self {
            map: options.map.clone(),
            cameras: dataset.cameras(),
            depth_unit_metres: dataset.depth_unit_metres(),
            poses: options.poses,
            label_texts: match (options.encoder, dataset.truth()) {
                (Encoder::Oracle, Some(truth)) => label_texts(truth.instances()),
                _ => Vec::new(),
            },
        }
    }
}

/// An open stream.
#[derive(Debug)]
pub struct FrameStream {
    /// Where frames go in.
    pub frames: FrameSender,
    /// Where acknowledgements come out, one for each frame.
    pub acks: Acks,
    /// The answer to the opening: `received_through` and `durable_through` say which frames the
    /// map has already.
    pub opened: FrameAck,
}

impl FrameStream {
    /// Connects to the server at `HOST:PORT`, `http://HOST:PORT` or `https://HOST:PORT` and opens the
    /// map; at most `queue` frames wait to be sent. Waits while the server loads the map.
    ///
    /// # Errors
    /// [`ClientError`] if the address is wrong, nothing listens there or the server refuses the map.
    pub async fn open(
        grpc: &str,
        access: &Access,
        spec: MapSpec,
        queue: usize,
    ) -> Result<Self, ClientError> {
        Self::over(connect(grpc, access).await?, grpc, spec, queue).await
    }

    /// The same over a connection, or to a service in this process; messages of errors call it `address`.
    ///
    /// # Errors
    /// [`ClientError`] if the server refuses the map.
    pub async fn over(
        mut client: MappingClient<Connection>,
        address: &str,
        spec: MapSpec,
        queue: usize,
    ) -> Result<Self, ClientError> {
        let began = Instant::now();
        loop {
            match Self::open_once(&mut client, address, spec.clone(), queue).await {
                Err(ClientError::Refused { code: Code::Unavailable, .. })
                    if began.elapsed() < LOADING =>
                {
                    tokio::time::sleep(RETRY).await;
                }
                opened => return opened,
            }
        }
    }

    async fn open_once(
        client: &mut MappingClient<Connection>,
        address: &str,
        spec: MapSpec,
        queue: usize,
    ) -> Result<Self, ClientError> {
        let (sender, outbound) = mpsc::channel(queue);
        let open = FrameMessage { message: Some(Message::Open(wire_spec(spec))) };
        sender.try_send(open).expect("the queue is new and holds a message");
        let failed = |status| ClientError::of_status(status, address);
        let call = client.stream_frames(ReceiverStream::new(outbound)).await;
        let mut acks =
            Acks { acks: call.map_err(failed)?.into_inner(), address: address.to_owned() };
        let opened = acks
            .next()
            .await?
            .filter(|ack| ack.status() == FrameStatus::Opened)
            .ok_or_else(|| ClientError::unanswered(address))?;
        Ok(Self { frames: FrameSender(sender), acks, opened })
    }
}

/// Looks for the server, and for a map that may be used; a map that is not there yet is no error.
///
/// # Errors
/// [`ClientError`] if the address is wrong, nothing listens there, or the caller is not known.
pub async fn find(grpc: &str, access: &Access, map: &str) -> Result<(), ClientError> {
    let mut client = connect(grpc, access).await?;
    match client.get_map(v1::GetMapRequest { name: map.to_owned() }).await {
        Ok(_) => Ok(()),
        // A robot's token may be for writing only.
        Err(status) if matches!(status.code(), Code::NotFound | Code::PermissionDenied) => Ok(()),
        Err(status) => Err(ClientError::of_status(status, grpc)),
    }
}

/// Sends the frames of an open stream.
#[derive(Clone, Debug)]
pub struct FrameSender(mpsc::Sender<FrameMessage>);

impl FrameSender {
    /// Sends a frame, waiting while the queue is full. Returns false if the stream has ended: the
    /// reason comes out of [`Acks::next`].
    pub async fn send(&self, frame: RgbdFrame) -> bool {
        self.0.send(message(wire::frame(frame))).await.is_ok()
    }

    /// The same from a thread that may block.
    pub(super) fn blocking_send(&self, frame: v1::Frame) -> bool {
        self.0.blocking_send(message(frame)).is_ok()
    }
}

fn message(frame: v1::Frame) -> FrameMessage {
    FrameMessage { message: Some(Message::Frame(frame)) }
}

/// The acknowledgements of an open stream.
#[derive(Debug)]
pub struct Acks {
    acks: Streaming<FrameAck>,
    address: String,
}

impl Acks {
    /// The next acknowledgement; none after the last.
    ///
    /// # Errors
    /// [`ClientError::Refused`] and [`ClientError::Broken`].
    pub async fn next(&mut self) -> Result<Option<FrameAck>, ClientError> {
        let failed = |status| ClientError::of_status(status, &self.address);
        self.acks.message().await.map_err(failed)
    }
}

fn wire_spec(spec: MapSpec) -> v1::OpenMap {
    let pose_source = match spec.poses {
        Poses::Given => v1::PoseSource::Given,
        Poses::Estimate => v1::PoseSource::Estimated,
    };
    let Cameras { color, depth, depth_range_metres, no_depth, up } = spec.cameras;
    let [min_depth_metres, max_depth_metres] = depth_range_metres.unwrap_or_default();
    v1::OpenMap {
        map: spec.map,
        intrinsics: Some(wire::intrinsics(&color.intrinsics)),
        distortion: wire::distortion(color.distortion),
        depth_camera: depth.map(wire::depth_camera),
        min_depth_metres,
        max_depth_metres,
        no_depth: no_depth.into_iter().map(u32::from).collect(),
        up: up.map(wire::vector),
        depth_unit_metres: spec.depth_unit_metres,
        pose_source: pose_source.into(),
        label_texts: spec.label_texts,
    }
}

/// The class of each instance id from 1 on: the masks' ids are the labels.
fn label_texts(instances: &[Instance]) -> Vec<String> {
    let most = instances.iter().map(|thing| usize::from(thing.id)).max().unwrap_or_default();
    let mut texts = vec![String::new(); most];
    for thing in instances.iter().filter(|thing| thing.id > 0) {
        texts[usize::from(thing.id) - 1].clone_from(&thing.class);
    }
    texts
}
