//! A fleet: one NATS server, two workers and a gateway. Workers are killed, paused and stopped while a robot
//! sends frames; it sees a pause, and its map is the one that a single machine makes.

use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_proto::v1::{self, FrameAck, FrameStatus, frame_message::Message};
use lexsplat_tests::{Nats, Robot, ServerProcess, Signal};
use serde_json::Value;
use std::time::{Duration, Instant};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Status, Streaming};

const MAP: &str = "house.1";
const FRAMES: usize = 20;
/// How long a map may take to move to another worker.
const MOVES_WITHIN: Duration = Duration::from_secs(15);
/// How long anything else may take on a slow machine.
const PATIENCE: Duration = Duration::from_secs(240);
/// The same map, however fast frames come.
const PER_FRAME: (&str, &str) = ("LEXSPLAT__MAPPER__CLOCK", "per_frame");
const LEASE: (&str, &str) = ("LEXSPLAT__FLEET__LEASE_SECONDS", "4.0");

/// A fleet with two workers and a gateway.
struct Fleet {
    workers: Vec<Option<ServerProcess>>,
    gateway: ServerProcess,
    // Ends last.
    nats: Nats,
}

impl Fleet {
    fn start(settings: &[(&str, &str)]) -> Self {
        let nats = Nats::start();
        let settings = [&[PER_FRAME, LEASE], settings].concat();
        let worker = |name: &str| {
            let settings = [&settings[..], &[("LEXSPLAT__FLEET__NAME", name)]].concat();
            Some(nats.server("worker", &settings, &nats.log(name)))
        };
        let workers = vec![worker("a"), worker("b")];
        let gateway = nats.server("gateway", &settings, &nats.log("gateway"));
        Self { workers, gateway, nats }
    }

    fn worker(&self, at: usize) -> &ServerProcess {
        self.workers[at].as_ref().expect("it runs")
    }

    /// The worker that has the map.
    async fn owner(&self) -> usize {
        let began = Instant::now();
        loop {
            for (at, worker) in self.workers.iter().enumerate() {
                if let Some(worker) = worker
                    && names(&worker.http).await.iter().any(|name| name == MAP)
                {
                    return at;
                }
            }
            assert!(began.elapsed() < MOVES_WITHIN, "no worker has the map");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    /// The same where others may have copies of the map: the worker that wrote that it took it.
    async fn owner_of_lease(&self) -> usize {
        let took = |name: &str| self.log(name).contains("took a map");
        usize::from(!took("a"))
    }

    fn log(&self, name: &str) -> String {
        std::fs::read_to_string(self.nats.log(name)).expect("it wrote a log")
    }
}

/// Names of the maps of a server.
async fn names(http: &str) -> Vec<String> {
    let Ok(reply) = reqwest::get(format!("http://{http}/v1/maps")).await else { return Vec::new() };
    let listed: Value = reply.json().await.unwrap_or_default();
    let maps = listed["maps"].as_array().cloned().unwrap_or_default();
    maps.iter().filter_map(|map| map["name"].as_str().map(str::to_owned)).collect()
}

/// A robot's open stream.
struct Sender {
    frames: mpsc::Sender<v1::FrameMessage>,
    acks: Streaming<FrameAck>,
}

impl Sender {
    async fn open(grpc: &str, robot: &Robot) -> Result<(Self, FrameAck), Status> {
        let client = MappingClient::connect(format!("http://{grpc}")).await;
        let (frames, sent) = mpsc::channel(FRAMES + 1);
        frames.send(robot.open(MAP)).await.expect("there is room");
        let acks = client.expect("it listens").stream_frames(ReceiverStream::new(sent)).await?;
        let mut sender = Self { frames, acks: acks.into_inner() };
        let opened = sender.ack().await?;
        assert_eq!(opened.status(), FrameStatus::Opened);
        Ok((sender, opened))
    }

    async fn send(&self, robot: &Robot, frames: std::ops::Range<usize>) {
        for at in frames {
            let frame = v1::FrameMessage { message: Some(Message::Frame(robot.frame(at))) };
            self.frames.send(frame).await.expect("the stream is open");
        }
    }

    async fn ack(&mut self) -> Result<FrameAck, Status> {
        let ack = tokio::time::timeout(PATIENCE, self.acks.message()).await;
        ack.expect("in time").map(|ack| ack.expect("the stream is open"))
    }

    /// Expects the acknowledgements of these frames, in this order. They are durable.
    async fn durable(&mut self, frames: std::ops::Range<usize>) {
        for at in frames {
            let ack = self.acked(at).await;
            assert!(ack.durable_through >= Some(at as u64), "{ack:?}");
        }
    }

    /// Expects the acknowledgement of this frame.
    async fn acked(&mut self, at: usize) -> FrameAck {
        let ack = self.ack().await.expect("frames are acknowledged");
        assert_eq!((ack.sequence, ack.status()), (at as u64, FrameStatus::Tracked));
        assert!(ack.world_from_camera.is_some());
        ack
    }

    /// Ends the stream. Nothing may come any more.
    async fn end(mut self) {
        drop(self.frames);
        let rest = tokio::time::timeout(PATIENCE, self.acks.message()).await.expect("in time");
        assert_eq!(rest.expect("it ends well"), None);
    }
}

/// The Gaussians of the settled map with this many frames.
async fn splats(http: &str, frames: usize) -> Vec<u8> {
    let url = format!(
        "http://{http}/v1/maps/{MAP}/export/splats.ply?wait=settled&wait_seconds=240&min_sequence={}",
        frames - 1
    );
    let began = Instant::now();
    loop {
        let reply = reqwest::get(&url).await.expect("it answers");
        if reply.status() != 503 || began.elapsed() > PATIENCE {
            assert!(reply.status().is_success(), "{}", reply.text().await.unwrap_or_default());
            assert_eq!(reply.headers()["lexsplat-settled"], "true");
            return reply.bytes().await.expect("a file").to_vec();
        }
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
}

/// What one machine makes of the same frames.
async fn of_one_machine(robot: &Robot, frames: usize) -> Vec<u8> {
    let server = ServerProcess::start(&[PER_FRAME]);
    let (mut sender, _) = Sender::open(&server.grpc, robot).await.expect("it opens");
    sender.send(robot, 0..frames).await;
    for at in 0..frames {
        sender.acked(at).await;
    }
    sender.end().await;
    splats(&server.http, frames).await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_map_moves_from_a_killed_worker_and_is_the_one_of_a_single_machine() {
    let robot = Robot::new(7, FRAMES);
    let mut fleet = Fleet::start(&[]);
    let (mut sender, opened) = Sender::open(&fleet.gateway.grpc, &robot).await.expect("it opens");
    assert_eq!(opened.received_through, None);
    assert_eq!(opened.camera.map(|camera| camera.width), Some(320));
    sender.send(&robot, 0..8).await;
    sender.durable(0..5).await;
    let owner = fleet.owner().await;
    fleet.workers[owner] = None;
    let killed = Instant::now();
    sender.durable(5..8).await;
    sender.send(&robot, 8..9).await;
    sender.durable(8..9).await;
    let took = killed.elapsed();
    println!("moved in {took:.1?}");
    assert!(took < MOVES_WITHIN, "{took:?}");
    sender.send(&robot, 9..FRAMES).await;
    sender.durable(9..FRAMES).await;
    sender.end().await;
    let made = splats(&fleet.gateway.http, FRAMES).await;
    assert!(made == of_one_machine(&robot, FRAMES).await, "the maps differ");
    // The comparison sees that frames are missing.
    assert!(
        made != of_one_machine(&robot, FRAMES / 2).await,
        "half of the frames make the same map"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_paused_worker_that_comes_back_has_lost_the_map() {
    let robot = Robot::new(8, FRAMES);
    let fleet = Fleet::start(&[]);
    let (mut sender, _) = Sender::open(&fleet.gateway.grpc, &robot).await.expect("it opens");
    sender.send(&robot, 0..4).await;
    sender.durable(0..4).await;
    let owner = fleet.owner().await;
    fleet.worker(owner).signal(Signal::STOP);
    sender.send(&robot, 4..10).await;
    sender.durable(4..10).await;
    fleet.worker(owner).signal(Signal::CONT);
    sender.send(&robot, 10..FRAMES).await;
    sender.durable(10..FRAMES).await;
    sender.end().await;
    let began = Instant::now();
    while !names(&fleet.worker(owner).http).await.is_empty() {
        assert!(began.elapsed() < MOVES_WITHIN, "it still has the map");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    assert_eq!(fleet.owner().await, 1 - owner);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_that_stops_hands_its_map_over_in_a_checkpoint() {
    let robot = Robot::new(9, FRAMES);
    let trims = ("LEXSPLAT__FLEET__TRIM", "checkpoint");
    let mut fleet = Fleet::start(&[trims, ("LEXSPLAT__SERVER__CHECKPOINT_SECONDS", "1")]);
    let (mut sender, _) = Sender::open(&fleet.gateway.grpc, &robot).await.expect("it opens");
    let busy = Sender::open(&fleet.gateway.grpc, &robot).await.err().expect("it is refused");
    assert_eq!(busy.code(), Code::Aborted, "{busy}");
    sender.send(&robot, 0..12).await;
    sender.durable(0..12).await;
    let owner = fleet.owner().await;
    let mut stopped = fleet.workers[owner].take().expect("it runs");
    stopped.signal(Signal::TERM);
    stopped.ended();
    sender.send(&robot, 12..FRAMES).await;
    sender.durable(12..FRAMES).await;
    sender.end().await;
    let log = fleet.log(["a", "b"][1 - owner]);
    let loaded = log.lines().find(|line| line.contains("goes on from a checkpoint"));
    assert!(loaded.is_some_and(|line| line.contains("through=11")), "{log}");
    let made = splats(&fleet.gateway.http, FRAMES).await;
    assert!(made == of_one_machine(&robot, FRAMES).await, "the maps differ");
    let (mut again, opened) =
        Sender::open(&fleet.gateway.grpc, &robot).await.expect("it opens again");
    assert_eq!(opened.received_through, Some(FRAMES as u64 - 1));
    let http = format!("http://{}/v1/maps/{MAP}", fleet.gateway.http);
    let client = reqwest::Client::new();
    let deleted = client.delete(&http).send().await.expect("it answers");
    assert_eq!(deleted.status(), 204);
    assert_eq!(reqwest::get(&http).await.expect("it answers").status(), 404);
    let next = v1::Frame { sequence: FRAMES as u64, ..robot.frame(0) };
    let next = v1::FrameMessage { message: Some(Message::Frame(next)) };
    again.frames.send(next).await.expect("the stream is open");
    let gone = again.ack().await.expect_err("the map is gone");
    assert_eq!(gone.code(), Code::Aborted, "{gone}");
    // A new map of the same name has nothing of the old one.
    let (mut new, opened) = Sender::open(&fleet.gateway.grpc, &robot).await.expect("it opens");
    assert_eq!(opened.received_through, None);
    new.send(&robot, 0..3).await;
    new.durable(0..3).await;
    new.end().await;
}

/// Status and age of an answer of the gateway that may be so old.
async fn asked(gateway: &str, max_staleness: Option<&str>) -> (u16, Option<u64>) {
    let url = format!("http://{gateway}/v1/maps/{MAP}/export/trajectory.tum");
    let mut request = reqwest::Client::new().get(url);
    if let Some(seconds) = max_staleness {
        request = request.header("lexsplat-max-staleness", seconds);
    }
    let reply = request.send().await.expect("it answers");
    let age = reply.headers().get("lexsplat-age");
    let age = age.map(|age| age.to_str().expect("text").parse().expect("seconds"));
    (reply.status().as_u16(), age)
}

#[tokio::test(flavor = "multi_thread")]
async fn questions_that_may_be_answered_late_do_not_need_the_owner() {
    let robot = Robot::new(6, 8);
    let [every, wait] = ["CHECKPOINT_SECONDS", "LOADING_WAIT_SECONDS"]
        .map(|key| format!("LEXSPLAT__SERVER__{key}"));
    let mut fleet = Fleet::start(&[(every.as_str(), "1"), (wait.as_str(), "0")]);
    let (mut sender, _) = Sender::open(&fleet.gateway.grpc, &robot).await.expect("it opens");
    sender.send(&robot, 0..8).await;
    sender.durable(0..8).await;
    let gateway = fleet.gateway.http.clone();
    assert_eq!(asked(&gateway, Some("soon")).await, (400, None));
    let began = Instant::now();
    // Gateways hear with the next renewal that the owner has loaded the map.
    while asked(&gateway, None).await != (200, None) {
        assert!(began.elapsed() < PATIENCE, "the owner does not answer");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    let age = loop {
        assert!(began.elapsed() < PATIENCE, "no answer from a checkpoint");
        match asked(&gateway, Some("600")).await {
            (200, Some(age)) => break age,
            _ => tokio::time::sleep(Duration::from_millis(200)).await,
        }
    };
    assert!(age < 240, "{age} s");
    // Nothing is as new as that: the owner answers.
    assert_eq!(asked(&gateway, Some("0")).await, (200, None));
    let owner = fleet.owner_of_lease().await;
    fleet.workers[owner] = None;
    // At once: soon the other worker has the map.
    assert_eq!(asked(&gateway, None).await.0, 503);
    let mut answered = 0;
    for _ in 0..8 {
        answered += usize::from(matches!(asked(&gateway, Some("600")).await, (200, Some(_))));
    }
    assert!(answered > 0, "nobody answers");
}
