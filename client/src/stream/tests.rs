//! Streams to a small stand-in for the server, over a real socket.

use crate::access::Access;
use crate::dataset::{
    Color, ColorFormat, Dataset, DatasetError, Depth, DepthFormat, FrameExtras, Intrinsics,
    RgbdFrame,
};
use crate::stream::{
    ClientError, Encoder, FrameAck, FrameStatus, InputWarning, LeftOut, Poses, Refusal,
    StreamOptions, Summary, stream,
};
use lexsplat_proto::v1::mapping_server::{Mapping, MappingServer};
use lexsplat_proto::v1::{self, FrameMessage, frame_message::Message};
use nalgebra::Isometry3;
use std::sync::{Arc, Mutex};
use tokio::net::TcpListener;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::server::TcpIncoming;
use tonic::{Code, Request, Response, Status, Streaming};

/// Frames with these numbers, 100 ms apart; reading number 13 fails, number 14 has no pose.
struct Numbers(Vec<u64>);

impl Dataset for Numbers {
    fn name(&self) -> &str {
        "numbers"
    }

    fn len(&self) -> usize {
        self.0.len()
    }

    fn intrinsics(&self) -> Intrinsics {
        Intrinsics { width: 2, height: 1, fx: 3.0, fy: 4.0, cx: 0.5, cy: 0.0 }
    }

    fn depth_unit_metres(&self) -> f64 {
        0.25
    }

    fn sequence(&self, index: usize) -> u64 {
        self.0[index]
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        let sequence = self.0[index];
        if sequence == 13 {
            return Err(DatasetError::content("13".as_ref(), "unreadable"));
        }
        Ok(RgbdFrame {
            sequence,
            timestamp_nanos: 5_000_000_000 + sequence * 100_000_000,
            color: Color { format: ColorFormat::Rgb8, bytes: vec![1; 6] },
            depth: Depth { format: DepthFormat::U16, bytes: vec![2; 4] },
            world_from_camera: (sequence != 14)
                .then(|| Isometry3::translation(sequence as f64, 0.0, 0.0)),
            extras: FrameExtras::default(),
        })
    }
}

/// Answers every frame; refuses number 3, makes even ones keyframes, hangs up at number 66.
#[derive(Clone, Default)]
struct StandIn {
    received_through: Option<u64>,
    durable_through: Option<u64>,
    opened: Arc<Mutex<Option<v1::OpenMap>>>,
    frames: Arc<Mutex<Vec<v1::Frame>>>,
}

impl StandIn {
    fn answer(&self, message: Message) -> Result<FrameAck, Status> {
        let frame = match message {
            Message::Open(open) if open.pose_source() == v1::PoseSource::Estimated => {
                return Err(Status::unimplemented("pose_source: not there yet"));
            }
            Message::Open(open) => {
                *self.opened.lock().unwrap() = Some(open);
                return Ok(FrameAck {
                    status: FrameStatus::Opened.into(),
                    received_through: self.received_through,
                    durable_through: self.durable_through,
                    ..FrameAck::default()
                });
            }
            Message::Frame(frame) => frame,
        };
        let sequence = frame.sequence;
        self.frames.lock().unwrap().push(frame);
        let refused = sequence == 3;
        let status = if refused { FrameStatus::Refused } else { FrameStatus::Tracked };
        let told = |text: &str| if refused { text.to_owned() } else { String::new() };
        Ok(FrameAck {
            sequence,
            status: status.into(),
            refused_field: told("depth"),
            refused_reason: told("expected another"),
            durable_through: Some(sequence.min(5)),
            keyframe: !refused && sequence.is_multiple_of(2),
            map_revision: 10 + sequence,
            queue_depth: 1,
            queue_capacity: 4,
            input_warnings: (sequence == 4).then(inverted).into_iter().collect(),
            ..FrameAck::default()
        })
    }
}

/// What the stand-in says of frame 4.
fn inverted() -> v1::InputWarning {
    let problem = v1::InputProblem::InvertedPoses.into();
    v1::InputWarning { problem, message: "send the inverse".into() }
}

#[tonic::async_trait]
impl Mapping for StandIn {
    type StreamFramesStream = ReceiverStream<Result<FrameAck, Status>>;
    type QueryChunksStream = ReceiverStream<Result<v1::Chunk, Status>>;
    type ExportMapStream = ReceiverStream<Result<v1::Chunk, Status>>;

    async fn stream_frames(
        &self,
        request: Request<Streaming<FrameMessage>>,
    ) -> Result<Response<Self::StreamFramesStream>, Status> {
        let (acks, outbound) = mpsc::channel(2);
        let (this, mut inbound) = (self.clone(), request.into_inner());
        tokio::spawn(async move {
            while let Ok(Some(FrameMessage { message: Some(message) })) = inbound.message().await {
                if matches!(&message, Message::Frame(frame) if frame.sequence == 66) {
                    return;
                }
                if acks.send(this.answer(message)).await.is_err() {
                    return;
                }
            }
        });
        Ok(Response::new(ReceiverStream::new(outbound)))
    }

    async fn query(
        &self,
        _: Request<v1::QueryRequest>,
    ) -> Result<Response<v1::QueryResponse>, Status> {
        Err(Status::unimplemented("query"))
    }

    async fn query_chunks(
        &self,
        _: Request<v1::QueryRequest>,
    ) -> Result<Response<Self::QueryChunksStream>, Status> {
        Err(Status::unimplemented("query_chunks"))
    }

    async fn create_map(
        &self,
        _: Request<v1::CreateMapRequest>,
    ) -> Result<Response<v1::MapStatus>, Status> {
        Err(Status::unimplemented("create_map"))
    }

    async fn get_map(
        &self,
        _: Request<v1::GetMapRequest>,
    ) -> Result<Response<v1::MapStatus>, Status> {
        Err(Status::unimplemented("get_map"))
    }

    async fn list_maps(
        &self,
        _: Request<v1::ListMapsRequest>,
    ) -> Result<Response<v1::ListMapsResponse>, Status> {
        Err(Status::unimplemented("list_maps"))
    }

    async fn rename_map(
        &self,
        _: Request<v1::RenameMapRequest>,
    ) -> Result<Response<v1::RenameMapResponse>, Status> {
        Err(Status::unimplemented("rename_map"))
    }

    async fn delete_map(
        &self,
        _: Request<v1::DeleteMapRequest>,
    ) -> Result<Response<v1::DeleteMapResponse>, Status> {
        Err(Status::unimplemented("delete_map"))
    }

    async fn export_map(
        &self,
        _: Request<v1::ExportRequest>,
    ) -> Result<Response<Self::ExportMapStream>, Status> {
        Err(Status::unimplemented("export_map"))
    }
}

async fn serve(service: StandIn) -> StreamOptions {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let grpc = listener.local_addr().unwrap().to_string();
    let server = tonic::transport::Server::builder().add_service(MappingServer::new(service));
    tokio::spawn(server.serve_with_incoming(TcpIncoming::from(listener)));
    StreamOptions {
        access: Access::default(),
        grpc,
        map: "m".into(),
        poses: Poses::Given,
        encoder: Encoder::Bundle,
        hold_out_every: None,
        realtime: false,
    }
}

async fn send(
    numbers: impl IntoIterator<Item = u64>,
    options: &StreamOptions,
) -> Result<Summary, ClientError> {
    stream(Arc::new(Numbers(numbers.into_iter().collect())), options, |_| ()).await
}

#[tokio::test]
async fn all_frames_are_sent_in_order_and_counted() {
    let service = StandIn::default();
    let options = serve(service.clone()).await;
    let mut seen = Vec::new();
    let dataset = Arc::new(Numbers((0..12).collect()));
    let summary = stream(dataset, &options, |progress| seen.push(progress.clone())).await.unwrap();
    let counts = (summary.sent, summary.tracked, summary.lost, summary.refused);
    assert_eq!((counts, summary.resumed_past), ((12, 11, 0, 1), 0));
    let refusal = Refusal { sequence: 3, field: "depth".into(), reason: "expected another".into() };
    assert_eq!(summary.refusals, [refusal]);
    let warning =
        InputWarning { sequence: 4, problem: "inverted_poses".into(), message: inverted().message };
    let told: Vec<_> = seen.iter().flat_map(|progress| progress.input_warnings.clone()).collect();
    assert_eq!((&summary.input_warnings[..], &told), (&[warning.clone()][..], &vec![warning]));
    assert_eq!(summary.keyframes, [0, 2, 4, 6, 8, 10]);
    assert_eq!((summary.durable_through, summary.map_revision), (Some(5), 21));
    assert!(summary.seconds > 0.0 && summary.frames_per_second > 0.0, "{summary:?}");
    assert_eq!((seen.len(), seen[0].status, seen[0].total), (13, FrameStatus::Opened, 12));
    assert_eq!((seen[12].acknowledged, seen[12].queue_depth), (12, 1));

    let open = service.opened.lock().unwrap().take().unwrap();
    let camera = open.intrinsics.unwrap();
    assert_eq!((open.map.as_str(), open.depth_unit_metres), ("m", 0.25));
    assert_eq!((camera.width, camera.fy, camera.cx), (2, 4.0, 0.5));
    let frames = service.frames.lock().unwrap();
    assert!(frames.iter().map(|frame| frame.sequence).eq(0..12));
    let pose = frames[7].world_from_camera.unwrap();
    assert_eq!((pose.rotation.unwrap().w, pose.translation_metres.unwrap().x), (1.0, 7.0));
}

#[tokio::test]
async fn frames_that_the_map_has_are_not_sent_again() {
    let service = StandIn { received_through: Some(6), ..StandIn::default() };
    let summary = send([0, 4, 6, 7, 9], &serve(service.clone()).await).await.unwrap();
    assert_eq!((summary.resumed_past, summary.sent), (3, 2));
    let sequences: Vec<u64> =
        service.frames.lock().unwrap().iter().map(|frame| frame.sequence).collect();
    assert_eq!(sequences, [7, 9]);
    let durable = StandIn { durable_through: Some(9), ..StandIn::default() };
    let summary = send([0, 9], &serve(durable).await).await.unwrap();
    let told = (summary.resumed_past, summary.sent, summary.durable_through);
    assert_eq!(told, (2, 0, Some(9)));
}

#[tokio::test]
async fn frames_that_cannot_be_read_are_left_out_and_told_of() {
    let service = StandIn::default();
    let options = serve(service.clone()).await;
    let summary = send([11, 12, 13, 14, 15], &options).await.unwrap();
    assert_eq!((summary.sent, summary.left_out, summary.left_out_frames.len()), (3, 2, 2));
    let LeftOut { sequence, reason } = &summary.left_out_frames[0];
    assert_eq!((*sequence, reason.as_str()), (13, "13: unreadable"));
    assert!(summary.left_out_frames[1].reason.contains("frame 14 has no pose"));
    let numbers = || service.frames.lock().unwrap().iter().map(|f| f.sequence).collect::<Vec<_>>();
    assert_eq!(numbers(), [11, 12, 15]);
    // A map that has the good frames is not an error, although nothing is left to send.
    let there = StandIn { received_through: Some(12), ..StandIn::default() };
    let summary = send([11, 12, 13], &serve(there).await).await.unwrap();
    assert_eq!((summary.sent, summary.resumed_past, summary.left_out), (0, 2, 1));
}

#[tokio::test]
async fn realtime_keeps_the_pace_of_the_timestamps() {
    let options = serve(StandIn::default()).await;
    let slow = StreamOptions { realtime: true, ..options.clone() };
    assert!(send(0..4, &slow).await.unwrap().seconds >= 0.3);
    assert!(send(0..4, &options).await.unwrap().seconds < 0.3);
}

#[tokio::test]
async fn errors_say_what_to_do() {
    let options = serve(StandIn::default()).await;
    let error = async |numbers: Vec<u64>, options: &StreamOptions| {
        send(numbers, options).await.unwrap_err()
    };
    let estimate = StreamOptions { poses: Poses::Estimate, ..options.clone() };
    let refused = error(vec![1], &estimate).await;
    assert!(matches!(&refused, ClientError::Refused { code: Code::Unimplemented, .. }));
    assert!(refused.to_string().ends_with("pose_source: not there yet"), "{refused}");
    assert!(matches!(error(vec![13], &options).await, ClientError::Dataset(_)));
    assert!(matches!(error(vec![14], &options).await, ClientError::NoPose { sequence: 14 }));
    assert!(matches!(error(vec![65, 66, 67], &options).await, ClientError::Broken { .. }));
    let at = |grpc: &str| StreamOptions { grpc: grpc.into(), ..options.clone() };
    for address in ["nowhere", "localhost:http", "a b:1", ""] {
        assert!(matches!(error(vec![1], &at(address)).await, ClientError::Address { .. }));
    }
    let encrypted = error(vec![1], &at(&format!("HTTPS://{}", options.grpc))).await;
    assert!(matches!(encrypted, ClientError::Tls { .. }), "it is not sent in plain text");
    // A port that was free a moment ago.
    let free = TcpListener::bind("127.0.0.1:0").await.unwrap().local_addr().unwrap().to_string();
    let found = error(vec![1], &at(&free)).await.to_string();
    assert_eq!(found, format!("no server at {free}: start lexsplat-server"));
}
