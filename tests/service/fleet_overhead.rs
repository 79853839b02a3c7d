//! `make bench-fleet`: what a fleet costs for each frame, against one machine that records its frames. Both
//! make the same map of the same frames, in turns.

use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_proto::v1::{self, frame_message::Message};
use lexsplat_synthetic::Camera;
use lexsplat_tests::{Nats, Robot, ServerProcess};
use std::time::{Duration, Instant};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;

const FRAMES: usize = 40;
const ROUNDS: usize = 3;
/// A frame is sent when the one before is acknowledged, so latencies have no queue in them; not sooner than
/// this.
const PAUSE: Duration = Duration::from_millis(200);
const SETTINGS: [(&str, &str); 2] =
    [("LEXSPLAT__MAPPER__CLOCK", "per_frame"), ("LEXSPLAT__SERVER__CHECKPOINT_SECONDS", "0")];

/// What a run took, by part: a name, and seconds of processor time for each frame.
struct Run {
    parts: Vec<(&'static str, f64)>,
    /// From a frame's sending to its acknowledgement.
    latencies: Vec<Duration>,
}

impl Run {
    fn median(&self) -> Duration {
        let mut sorted = self.latencies.clone();
        sorted.sort();
        sorted[sorted.len() / 2]
    }

    fn total(&self) -> f64 {
        self.parts.iter().map(|(_, seconds)| seconds).sum()
    }

    fn print(&self, name: &str) {
        let parts: Vec<String> = self
            .parts
            .iter()
            .map(|(part, seconds)| format!("{part} {:.1} ms", seconds * 1e3))
            .collect();
        let slowest = self.latencies.iter().max().copied().unwrap_or_default();
        println!(
            "{name}: processor time a frame {:.1} ms ({}), latency median {:.1?}, slowest {slowest:.1?}",
            self.total() * 1e3,
            parts.join(", "),
            self.median()
        );
    }
}

/// Sends the frames one by one. Returns the latencies of all but the first.
async fn drive(grpc: &str, robot: &Robot) -> Vec<Duration> {
    let mut client = MappingClient::connect(format!("http://{grpc}")).await.expect("it listens");
    let (frames, sent) = mpsc::channel(2);
    frames.send(robot.open("bench")).await.expect("there is room");
    let acks = client.stream_frames(ReceiverStream::new(sent)).await.expect("it opens");
    let mut acks = acks.into_inner();
    acks.message().await.expect("it is open");
    let mut latencies = Vec::new();
    for at in 0..FRAMES {
        let frame = v1::FrameMessage { message: Some(Message::Frame(robot.frame(at))) };
        let began = Instant::now();
        frames.send(frame).await.expect("the stream is open");
        let ack = acks.message().await.expect("it is acknowledged").expect("the stream is open");
        assert!(ack.durable_through >= Some(at as u64), "{ack:?}");
        latencies.push(began.elapsed());
        tokio::time::sleep_until((began + PAUSE).into()).await;
    }
    latencies.split_off(1)
}

/// Waits until the map has nothing left to do, which takes the same processor time everywhere.
async fn settle(http: &str) {
    let url =
        format!("http://{http}/v1/maps/bench/export/trajectory.tum?wait=settled&wait_seconds=300");
    let reply = reqwest::get(url).await.expect("it answers");
    assert_eq!(reply.headers()["lexsplat-settled"], "true");
}

fn share(after: Duration, before: Duration) -> f64 {
    (after - before).as_secs_f64() / FRAMES as f64
}

async fn one_machine(robot: &Robot) -> Run {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let data = ("LEXSPLAT__SERVER__DATA_DIR", folder.path().to_str().expect("a plain path"));
    let server = ServerProcess::start(&[&SETTINGS[..], &[data]].concat());
    let before = server.processor_time();
    let latencies = drive(&server.grpc, robot).await;
    settle(&server.http).await;
    Run { parts: vec![("server", share(server.processor_time(), before))], latencies }
}

async fn fleet(robot: &Robot) -> Run {
    let nats = Nats::start();
    let worker = nats.server("worker", &SETTINGS, &nats.log("worker"));
    let gateway = nats.server("gateway", &SETTINGS, &nats.log("gateway"));
    let times = || [worker.processor_time(), gateway.processor_time(), nats.processor_time()];
    let before = times();
    let latencies = drive(&gateway.grpc, robot).await;
    settle(&gateway.http).await;
    let after = times();
    let parts = ["worker", "gateway", "NATS"].into_iter().zip(after).zip(before);
    let parts = parts.map(|((part, after), before)| (part, share(after, before))).collect();
    Run { parts, latencies }
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "measures: make bench-fleet"]
async fn a_fleet_against_one_machine() {
    let robot = Robot::with(7, FRAMES, Camera::new(600, 340));
    let bytes: usize =
        (0..FRAMES).map(|at| robot.frame(at)).map(|f| f.color.len() + f.depth.len()).sum();
    println!("{FRAMES} frames of 600x340, {} kB each", bytes / FRAMES / 1000);
    for round in 0..ROUNDS {
        println!("round {round}");
        let alone = one_machine(&robot).await;
        alone.print("one machine");
        let many = fleet(&robot).await;
        many.print("fleet");
        println!(
            "ratio: processor time {:.3}, latency {:.3}",
            many.total() / alone.total(),
            many.median().as_secs_f64() / alone.median().as_secs_f64()
        );
    }
}
