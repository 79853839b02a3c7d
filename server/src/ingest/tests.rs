//! Tests of streams and calls over a real socket, with a real pipeline.

use super::{IngestConfig, MappingService};
use crate::access::{AccessConfig, Gate};
use crate::maps::{RecordedMaps, load_all};
use crate::net::{self, ConnectionsConfig, Port, Protocol};
use crate::store::{RecordingConfig, Store};
use crate::test_support::{config, engine, frame, open_message};
use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_proto::v1::{self, FrameAck, FrameStatus, OpenMap, frame_message::Message};
use std::path::Path;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;
use tonic::transport::Channel;
use tonic::{Code, Status, Streaming};

struct Server {
    client: MappingClient<Channel>,
    stopping: CancellationToken,
    serving: tokio::task::JoinHandle<()>,
}

impl Server {
    async fn start(data_dir: Option<&Path>) -> Self {
        Self::start_with(data_dir, RecordingConfig::default()).await
    }

    async fn start_with(data_dir: Option<&Path>, room: RecordingConfig) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let stopping = CancellationToken::new();
        let store = Store::open(data_dir, &room).unwrap();
        // A short limit, so that the test of a sender that does not read is fast.
        let config = IngestConfig { ack_seconds: 1, ..config().ingest };
        let maps = RecordedMaps::new(engine(), store);
        let gate = Gate::new(AccessConfig::default()).unwrap();
        let service = MappingService::new(maps, gate, &config, stopping.clone());
        let port = Port {
            protocol: Protocol::Grpc,
            listener,
            router: service.router().await.unwrap(),
            tls: None,
            limits: ConnectionsConfig::default(),
        };
        let serving = tokio::spawn(net::serve(port, stopping.clone()));
        let client = MappingClient::connect(format!("http://{address}")).await.unwrap();
        Self { client, stopping, serving }
    }

    /// Stops the server; its maps stay in the engine.
    async fn stop(self) {
        self.stopping.cancel();
        drop(self.client);
        self.serving.await.unwrap();
    }

    async fn stream(&self) -> Stream {
        let (frames, outbound) = mpsc::channel(4);
        let outbound = ReceiverStream::new(outbound);
        let acks = self.client.clone().stream_frames(outbound).await.unwrap().into_inner();
        Stream { frames, acks }
    }

    /// A stream whose opening message was accepted.
    async fn opened(&self, map: &str) -> (Stream, FrameAck) {
        let mut stream = self.stream().await;
        stream.send(Message::Open(open_message(map))).await;
        let ack = stream.ack().await.unwrap();
        assert_eq!(ack.status(), FrameStatus::Opened);
        (stream, ack)
    }
}

struct Stream {
    frames: mpsc::Sender<v1::FrameMessage>,
    acks: Streaming<FrameAck>,
}

impl Stream {
    async fn send(&self, message: Message) {
        self.frames.send(v1::FrameMessage { message: Some(message) }).await.unwrap();
    }

    async fn ack(&mut self) -> Result<FrameAck, Status> {
        self.acks.message().await.map(|ack| ack.expect("the stream goes on"))
    }

    /// Closes the stream and waits until the server has closed it.
    async fn finish(mut self) {
        drop(self.frames);
        assert!(self.acks.message().await.unwrap().is_none());
    }
}

#[tokio::test]
async fn frames_are_acknowledged_in_order_and_bad_ones_do_not_end_the_stream() {
    let server = Server::start(None).await;
    let (mut stream, opened) = server.opened("ingest-order").await;
    assert_eq!((opened.received_through, opened.durable_through), (None, None));
    let unrigid = v1::Pose {
        rotation: Some(v1::Quaternion { w: 3.0, ..Default::default() }),
        ..frame(0).world_from_camera.unwrap()
    };
    stream.send(Message::Frame(frame(3))).await;
    stream.send(Message::Frame(v1::Frame { world_from_camera: Some(unrigid), ..frame(4) })).await;
    stream.send(Message::Frame(frame(3))).await;
    stream.send(Message::Frame(frame(5))).await;
    let mut found = Vec::new();
    for _ in 0..4 {
        let ack = stream.ack().await.unwrap();
        assert_eq!(ack.durable_through, None, "nothing is durable without a data directory");
        found.push((ack.sequence, ack.status(), ack.refused_field));
    }
    let tracked = |sequence| (sequence, FrameStatus::Tracked, String::new());
    let refused = |sequence, field: &str| (sequence, FrameStatus::Refused, field.to_owned());
    let expected =
        [tracked(3), refused(4, "world_from_camera.rotation"), refused(3, "sequence"), tracked(5)];
    assert_eq!(found, expected);
    stream.finish().await;
    let status = engine().map("ingest-order").unwrap().status();
    assert_eq!((status.frames_received, status.frames_refused), (2, 2));
    let (stream, again) = server.opened("ingest-order").await;
    assert_eq!(again.received_through, Some(5));
    stream.finish().await;
}

#[tokio::test]
async fn a_stream_must_open_properly() {
    let server = Server::start(None).await;
    let refusal = async |first: Message| {
        let mut stream = server.stream().await;
        stream.send(first).await;
        stream.ack().await.unwrap_err()
    };
    assert_eq!(refusal(Message::Frame(frame(1))).await.code(), Code::InvalidArgument);
    let status = refusal(Message::Open(open_message("no/name"))).await;
    assert_eq!(status.code(), Code::InvalidArgument);
    let open = OpenMap { intrinsics: None, ..open_message("ingest-open") };
    let status = refusal(Message::Open(open)).await;
    assert_eq!(status.code(), Code::InvalidArgument);
    assert!(status.message().contains("intrinsics") && !status.details().is_empty(), "{status}");
    let open = OpenMap { pose_source: 9, ..open_message("ingest-open") };
    let status = refusal(Message::Open(open)).await;
    assert_eq!(status.code(), Code::InvalidArgument);
    assert!(status.message().contains("POSE_SOURCE_ESTIMATED"), "{status}");
    let (mut stream, _) = server.opened("ingest-open").await;
    stream.send(Message::Open(open_message("ingest-open"))).await;
    assert_eq!(stream.ack().await.unwrap_err().code(), Code::InvalidArgument);
}

#[tokio::test]
async fn a_map_has_one_sender_and_a_broken_connection_frees_it() {
    let server = Server::start(None).await;
    let (first, _) = server.opened("ingest-busy").await;
    let mut second = server.stream().await;
    second.send(Message::Open(open_message("ingest-busy"))).await;
    assert_eq!(second.ack().await.unwrap_err().code(), Code::Aborted);
    drop(first);
    for _ in 0..100 {
        let mut third = server.stream().await;
        third.send(Message::Open(open_message("ingest-busy"))).await;
        if third.ack().await.is_ok() {
            return;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    panic!("the map was not freed for another sender");
}

#[tokio::test]
async fn a_sender_that_reads_no_acknowledgements_waits_and_is_cut_off() {
    /// More acknowledgements (about 100 bytes each) than the HTTP/2 windows (2 MiB) and queues hold.
    const FRAMES: u64 = 100_000;
    let server = Server::start(None).await;
    let (stream, _) = server.opened("ingest-deaf").await;
    let sent = async {
        for sequence in 0..FRAMES {
            let message = Some(Message::Frame(v1::Frame { sequence, ..Default::default() }));
            if stream.frames.send(v1::FrameMessage { message }).await.is_err() {
                return sequence;
            }
        }
        FRAMES
    };
    let sent = tokio::time::timeout(Duration::from_secs(60), sent)
        .await
        .expect("the server cuts the stream off");
    assert!(sent < FRAMES, "the server read all frames although no acknowledgement was read");
    let (next, _) = server.opened("ingest-deaf").await;
    next.finish().await;
}

#[tokio::test]
async fn a_stopping_server_acknowledges_accepted_frames() {
    let server = Server::start(None).await;
    let (mut stream, _) = server.opened("ingest-stop").await;
    stream.send(Message::Frame(frame(1))).await;
    assert_eq!(stream.ack().await.unwrap().status(), FrameStatus::Tracked);
    server.stopping.cancel();
    assert_eq!(stream.ack().await.unwrap_err().code(), Code::Unavailable);
}

#[tokio::test]
async fn durable_frames_come_back_after_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(Some(folder.path())).await;
    let (mut stream, opened) = server.opened("ingest-durable").await;
    assert_eq!(opened.durable_through, None);
    for sequence in 1..=3 {
        stream.send(Message::Frame(frame(sequence))).await;
        let ack = stream.ack().await.unwrap();
        assert!(ack.durable_through.is_some_and(|through| through >= sequence), "{ack:?}");
    }
    stream.finish().await;
    assert!(
        Store::open(Some(folder.path()), &RecordingConfig::default()).is_err(),
        "the directory has an owner"
    );
    server.stop().await;
    // As after a restart: the map does not exist any more, its recording does.
    engine().delete("ingest-durable").await.unwrap();
    {
        let store = Store::open(Some(folder.path()), &RecordingConfig::default()).unwrap();
        let maps = RecordedMaps::new(engine(), store);
        load_all(&maps, &config().ingest.limits()).await.unwrap();
    }
    let server = Server::start(Some(folder.path())).await;
    let map = engine().map("ingest-durable").unwrap();
    assert_eq!((map.received_through(), map.status().frames_received), (Some(3), 3));
    let (stream, opened) = server.opened("ingest-durable").await;
    assert_eq!((opened.received_through, opened.durable_through), (Some(3), Some(3)));
    stream.finish().await;
    let name = "ingest-durable".to_owned();
    server.client.clone().delete_map(v1::DeleteMapRequest { name }).await.unwrap();
    assert!(!folder.path().join("ingest-durable.map").exists(), "the recording was removed, too");
}

#[tokio::test]
async fn a_quota_ends_streams_until_there_is_room_again() {
    let folder = tempfile::tempdir().unwrap();
    let quota = RecordingConfig { max_bytes: 40_000, ..RecordingConfig::default() };
    let server = Server::start_with(Some(folder.path()), quota).await;
    let (mut stream, _) = server.opened("ingest-full").await;
    let mut durable = None;
    let mut sequence = 0;
    let refused = loop {
        // Whoever has ended the stream does not read the frame.
        let message = v1::FrameMessage { message: Some(Message::Frame(frame(sequence))) };
        let _ = stream.frames.send(message).await;
        match stream.ack().await {
            Ok(ack) => durable = ack.durable_through,
            Err(status) => break status,
        }
        sequence += 1;
        assert!(sequence < 100, "the quota holds at once");
    };
    assert_eq!(refused.code(), Code::Unavailable);
    assert!(durable.is_some(), "there was room for some frames");
    assert!(refused.message().contains("recording.max_bytes"), "{refused}");
    let (stream, opened) = server.opened("ingest-full").await;
    assert_eq!(opened.received_through, durable, "the refused frame is not in the map");
    assert_eq!(opened.durable_through, durable);
    drop(stream);
    let name = "ingest-full".to_owned();
    server.client.clone().delete_map(v1::DeleteMapRequest { name }).await.unwrap();
    let (mut stream, _) = server.opened("ingest-roomy").await;
    stream.send(Message::Frame(frame(0))).await;
    assert_eq!(stream.ack().await.unwrap().durable_through, Some(0));
    stream.finish().await;
    let name = "ingest-roomy".to_owned();
    server.client.clone().delete_map(v1::DeleteMapRequest { name }).await.unwrap();
    server.stop().await;
}

#[tokio::test]
async fn maps_and_questions_work_over_grpc() {
    let server = Server::start(None).await;
    let mut client = server.client.clone();
    let name = "ingest-calls".to_owned();
    let request = v1::CreateMapRequest { name: name.clone() };
    assert_eq!(
        client.create_map(request.clone()).await.unwrap().into_inner().tracking_state,
        "empty"
    );
    assert_eq!(client.create_map(request).await.unwrap_err().code(), Code::AlreadyExists);
    let nowhere = v1::GetMapRequest { name: "nowhere".into() };
    assert_eq!(client.get_map(nowhere).await.unwrap_err().code(), Code::NotFound);
    let listed = client.list_maps(v1::ListMapsRequest::default()).await.unwrap().into_inner();
    assert!(listed.maps.iter().any(|map| map.name == name));
    assert_eq!(listed.next, None);
    let before = v1::ListMapsRequest { limit: Some(1), after: Some("ingest-call".into()) };
    let page = client.list_maps(before).await.unwrap().into_inner();
    assert_eq!(page.maps[0].name, name);
    assert!(page.next.is_none_or(|next| next == name));
    let none = v1::ListMapsRequest { limit: Some(0), after: None };
    assert_eq!(client.list_maps(none).await.unwrap_err().code(), Code::InvalidArgument);
    let question = v1::QueryRequest { map: name.clone(), text: "cup".into(), ..Default::default() };
    assert!(!client.query(question.clone()).await.unwrap().into_inner().present);
    let several = v1::QueryRequest {
        text: String::new(),
        texts: vec!["cup".into(), "sofa".into()],
        ..question.clone()
    };
    let found = client.query(several.clone()).await.unwrap().into_inner().segmentation.unwrap();
    assert_eq!(found.legend[1].text, "sofa");
    assert_eq!(found.points.unwrap().count, 0, "the map is empty");
    let both = v1::QueryRequest { text: "cup".into(), ..several };
    assert_eq!(client.query(both).await.unwrap_err().code(), Code::InvalidArgument);
    let upside_down = v1::Bounds {
        min_metres: Some(v1::Vector3 { x: 1.0, ..Default::default() }),
        max_metres: None,
    };
    let nowhere = v1::QueryRequest { within: Some(upside_down), ..question.clone() };
    let status = client.query(nowhere).await.unwrap_err();
    assert!(status.message().starts_with("within.max_metres: "), "{status}");
    let bad = v1::QueryRequest { threshold: Some(3.0), ..question };
    let status = client.query(bad).await.unwrap_err();
    assert_eq!(status.code(), Code::InvalidArgument);
    assert!(status.message().starts_with("threshold: "), "{status}");
    let export = |format: &str| v1::ExportRequest {
        map: name.clone(),
        format: format.into(),
        ..Default::default()
    };
    let mut chunks = client.export_map(export("splats.ply")).await.unwrap().into_inner();
    assert!(chunks.message().await.unwrap().unwrap().data.starts_with(b"ply\n"));
    let code = async |format: &str| {
        server.client.clone().export_map(export(format)).await.unwrap_err().code()
    };
    let mut chunks = client.export_map(export("mesh.ply")).await.unwrap().into_inner();
    let mesh = chunks.message().await.unwrap().unwrap().data;
    assert!(String::from_utf8_lossy(&mesh).contains("element face 0\n"), "the map is empty");
    let tiny = v1::ExportRequest { voxel_metres: Some(1e-6), ..export("mesh.ply") };
    assert_eq!(client.export_map(tiny).await.unwrap_err().code(), Code::InvalidArgument);
    let worded = v1::ExportRequest { text: "cup".into(), ..export("splats.ply") };
    assert_eq!(client.export_map(worded).await.unwrap_err().code(), Code::InvalidArgument);
    assert_eq!(code("mesh.obj").await, Code::InvalidArgument);
}
