//! `make soak-fleet`: three NATS servers, three workers and two gateways, while eight robots send frames
//! slowly and something fails every few seconds, and two clocks are wrong by an hour. At the end each map has
//! each frame once, no frame that was durable is missing, and no map had two owners.
//!
//! `FAULTS` says how many things fail (200), `SEED` which. With `LEXSPLAT_UNFENCED`, a build of the server
//! without the check of fencing tokens, the checker must find what that lets through.

use crate::fleet_logs::{self, Findings};
use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_proto::v1::{FrameMessage, FrameStatus, frame_message::Message};
use lexsplat_tests::wall;
use lexsplat_tests::{Cluster, Link, Passing, ServerProcess, Signal, free_port, program, root};
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use serde_json::Value;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio_stream::wrappers::ReceiverStream;

const ROBOTS: usize = 8;
const WORKERS: usize = 3;
const GATEWAYS: usize = 2;
const NODES: usize = 3;
/// Between two frames of a robot.
const PAUSE: Duration = Duration::from_millis(500);
/// Between two faults, milliseconds.
const APART: std::ops::Range<u64> = 500..4000;
/// How long a fault lasts, milliseconds.
const LASTS: std::ops::Range<u64> = 500..12_000;
/// How long all may take to be well again when nothing fails any more.
const RECOVERY: Duration = Duration::from_secs(240);
/// A connection whose acknowledgements do not come for so long is given up.
const SILENCE: Duration = Duration::from_secs(40);
const SLOW_BYTES: u32 = 100_000;

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// What robots and the test tell each other.
#[derive(Default)]
struct Shared {
    /// Addresses of the gateways that run, or nothing.
    gateways: [std::sync::Mutex<Option<String>>; GATEWAYS],
    /// Whether robots come to an end.
    is_ending: AtomicBool,
    /// Frames that were acknowledged.
    acked: AtomicU64,
    /// Connections that ended with an error.
    broken: AtomicU64,
}

/// A robot: sends frames, connects again when something fails, and goes on behind what the map has.
struct Robot {
    map: String,
    shared: Arc<Shared>,
    /// The newest frame that was said to be durable.
    durable: Option<u64>,
    /// The newest frame that was acknowledged.
    acked: Option<u64>,
}

impl Robot {
    /// Ends when all its frames are acknowledged and it is told to end. Returns the number of frames.
    async fn drive(mut self, at: usize) -> u64 {
        let mut turn = at;
        loop {
            turn += 1;
            let gateway = self.shared.gateways[turn % GATEWAYS].lock().expect("no panic").clone();
            if let Some(gateway) = gateway
                && self.stream(&gateway).await.is_ok_and(|is_done| is_done)
            {
                return self.acked.map_or(0, |newest| newest + 1);
            }
            self.shared.broken.fetch_add(1, Ordering::Relaxed);
            tokio::time::sleep(Duration::from_millis(300)).await;
        }
    }

    /// One connection. Returns whether it came to its end.
    async fn stream(&mut self, gateway: &str) -> Result<bool, Box<dyn std::error::Error>> {
        let connect = MappingClient::connect(format!("http://{gateway}"));
        let mut client = tokio::time::timeout(SILENCE, connect).await??;
        let (frames, sent) = mpsc::channel(2);
        frames.send(wall::open(&self.map)).await?;
        let acks = client.stream_frames(ReceiverStream::new(sent));
        let mut acks = tokio::time::timeout(SILENCE, acks).await??.into_inner();
        let opened = tokio::time::timeout(SILENCE, acks.message()).await??;
        let opened = opened.ok_or("no answer")?;
        assert!(
            opened.received_through >= self.durable,
            "{}: durable frames are gone: {:?}, but {:?} was acknowledged as durable",
            self.map,
            opened.received_through,
            self.durable
        );
        let mut expected = opened.received_through.map_or(0, |through| through + 1);
        let (shared, first) = (self.shared.clone(), expected);
        let sending = tokio::spawn(async move {
            let mut next = first;
            while !shared.is_ending.load(Ordering::Relaxed) {
                let message = FrameMessage { message: Some(Message::Frame(wall::frame(next))) };
                if frames.send(message).await.is_err() {
                    return;
                }
                next += 1;
                tokio::time::sleep(PAUSE).await;
            }
        });
        let ended = loop {
            match tokio::time::timeout(SILENCE, acks.message()).await {
                Ok(Ok(Some(ack))) => {
                    assert_eq!(
                        ack.sequence, expected,
                        "{}: acknowledgements out of order",
                        self.map
                    );
                    assert_eq!(ack.status(), FrameStatus::Tracked, "{ack:?}");
                    assert!(ack.durable_through >= Some(ack.sequence), "{ack:?}");
                    (self.durable, self.acked) = (ack.durable_through, Some(ack.sequence));
                    self.shared.acked.fetch_add(1, Ordering::Relaxed);
                    expected += 1;
                }
                // All that was sent is acknowledged.
                Ok(Ok(None)) => break Ok(true),
                Ok(Err(error)) => break Err(error.into()),
                Err(silence) => break Err(silence.into()),
            }
        };
        sending.abort();
        ended
    }
}

/// Something that fails, and what ends it.
#[derive(Clone, Copy, Debug)]
enum Fault {
    KillWorker(usize),
    PauseWorker(usize),
    KillGateway(usize),
    KillNode(usize),
    PauseNode(usize),
    /// Between a server (workers first, then gateways) and a NATS node.
    CutServer(usize, usize),
    /// A server from all NATS nodes.
    Isolate(usize),
    /// Between two NATS nodes.
    CutNodes(usize, usize),
    /// Between a worker and all gateways.
    CutWorker(usize),
    /// A server that gets through slowly, its checkpoints above all.
    Slow(usize),
    /// No room for checkpoints.
    FullStore,
}

impl Fault {
    fn random(random: &mut ChaCha8Rng) -> Self {
        let mut one_of = |count: usize| random.random_range(0..count);
        let servers = WORKERS + GATEWAYS;
        match one_of(22) {
            0..=3 => Self::KillWorker(one_of(WORKERS)),
            4..=7 => Self::PauseWorker(one_of(WORKERS)),
            8..=9 => Self::KillGateway(one_of(GATEWAYS)),
            10..=11 => Self::KillNode(one_of(NODES)),
            12 => Self::PauseNode(one_of(NODES)),
            13..=14 => Self::CutServer(one_of(servers), one_of(NODES)),
            15..=16 => Self::Isolate(one_of(servers)),
            17 => Self::CutNodes(0, 1 + one_of(NODES - 1)),
            18 => Self::CutNodes(1, 2),
            19 => Self::CutWorker(one_of(WORKERS)),
            20 => Self::Slow(one_of(servers)),
            _ => Self::FullStore,
        }
    }
}

/// The whole fleet.
struct Fleet {
    cluster: Cluster,
    /// Workers first, then gateways.
    servers: Vec<Option<ServerProcess>>,
    /// Those that are being started. One that is cut off from NATS gives up, and is started again.
    starting: Vec<Option<JoinHandle<ServerProcess>>>,
    /// From each server to each NATS node.
    to_nats: Vec<Vec<Link>>,
    /// From gateways to the gRPC and HTTP of each worker.
    to_worker: Vec<[Link; 2]>,
    ports: Vec<[String; 2]>,
    program: PathBuf,
    shared: Arc<Shared>,
}

impl Fleet {
    async fn start(program: PathBuf, shared: Arc<Shared>) -> Self {
        let cluster = Cluster::start().await;
        let (mut to_nats, mut to_worker, mut ports) = (Vec::new(), Vec::new(), Vec::new());
        for server in 0..WORKERS + GATEWAYS {
            let mut links = Vec::new();
            for node in 0..NODES {
                links.push(Link::to(&cluster.address(node)).await);
            }
            to_nats.push(links);
            let own = [free_address(), free_address()];
            if server < WORKERS {
                to_worker.push([Link::to(&own[0]).await, Link::to(&own[1]).await]);
            }
            ports.push(own);
        }
        let servers = (0..WORKERS + GATEWAYS).map(|_| None).collect();
        let starting = (0..WORKERS + GATEWAYS).map(|_| None).collect();
        let mut fleet =
            Self { cluster, servers, starting, to_nats, to_worker, ports, program, shared };
        (0..WORKERS + GATEWAYS).for_each(|server| fleet.start_server(server));
        fleet
    }

    /// Takes in servers that have started, and starts those again that gave up.
    async fn take_started(&mut self) {
        for server in 0..WORKERS + GATEWAYS {
            let is_over = |starting: &mut JoinHandle<_>| starting.is_finished();
            let Some(started) = self.starting[server].take_if(is_over) else { continue };
            match started.await {
                Ok(started) => {
                    self.servers[server] = Some(started);
                    if server >= WORKERS {
                        self.tell_gateway(server, Some(self.ports[server][0].clone()));
                    }
                }
                Err(_) => self.start_server(server),
            }
        }
    }

    /// Starts a server that does not run.
    fn start_server(&mut self, server: usize) {
        if self.servers[server].is_some() || self.starting[server].is_some() {
            return;
        }
        let urls: Vec<String> =
            self.to_nats[server].iter().map(|link| format!("nats://{}", link.address)).collect();
        let (nats, name) = (format!("{urls:?}"), name(server));
        let role = if server < WORKERS { "worker" } else { "gateway" };
        let mut settings = vec![
            ("LEXSPLAT__FLEET__ROLE", role.to_owned()),
            ("LEXSPLAT__FLEET__NATS", nats),
            ("LEXSPLAT__FLEET__NAME", name.clone()),
            ("LEXSPLAT__FLEET__REPLICAS", "3".into()),
            ("LEXSPLAT__FLEET__LEASE_SECONDS", "3.0".into()),
            ("LEXSPLAT__FLEET__TRIM", "checkpoint".into()),
            ("LEXSPLAT__SERVER__CHECKPOINT_SECONDS", "5".into()),
            ("LEXSPLAT__SERVER__GRPC", self.ports[server][0].clone()),
            ("LEXSPLAT__SERVER__HTTP", self.ports[server][1].clone()),
            ("LEXSPLAT__MAPPER__MAX_GAUSSIANS", "500".into()),
            ("LEXSPLAT__MAPPER__STEPS_PER_KEYFRAME", "1".into()),
            ("LEXSPLAT__TELEMETRY__JSON", "true".into()),
            (
                "LEXSPLAT__TELEMETRY__FILTER",
                "warn,lexsplat_server=info,lexsplat_server::fleet=debug".into(),
            ),
        ];
        if let Some([grpc, http]) = self.to_worker.get(server) {
            settings.push(("LEXSPLAT__FLEET__GRPC", grpc.address.clone()));
            settings.push(("LEXSPLAT__FLEET__HTTP", http.address.clone()));
        }
        let (log, program) = (self.cluster.log(&name), self.program.clone());
        self.starting[server] = Some(tokio::task::spawn_blocking(move || {
            let settings: Vec<(&str, &str)> =
                settings.iter().map(|(key, value)| (*key, value.as_str())).collect();
            ServerProcess::logging_of(with_clock(program, server), &settings, &log)
        }));
    }

    fn tell_gateway(&self, server: usize, address: Option<String>) {
        *self.shared.gateways[server - WORKERS].lock().expect("no panic") = address;
    }

    fn signal(&self, server: usize, signal: Signal) {
        if let Some(server) = &self.servers[server] {
            server.signal(signal);
        }
    }

    /// The limit on the bytes of checkpoints; none: -1.
    async fn limit_store(&self, bytes: i64) {
        for node in 0..NODES {
            let Ok(client) = async_nats::connect(self.cluster.address(node)).await else {
                continue;
            };
            let jetstream = async_nats::jetstream::new(client);
            let Ok(stream) = jetstream.get_stream("OBJ_lexsplat-checkpoints").await else {
                continue;
            };
            let mut config = stream.cached_info().config.clone();
            config.max_bytes = bytes;
            if jetstream.update_stream(config).await.is_ok() {
                return;
            }
        }
    }

    async fn begin(&mut self, fault: Fault) {
        match fault {
            Fault::KillWorker(at) => self.servers[at] = None,
            Fault::PauseWorker(at) => self.signal(at, Signal::STOP),
            Fault::KillGateway(at) => {
                self.servers[WORKERS + at] = None;
                self.tell_gateway(WORKERS + at, None);
            }
            Fault::KillNode(at) => self.cluster.kill(at),
            Fault::PauseNode(at) => self.cluster.signal(at, Signal::STOP),
            Fault::CutServer(server, node) => self.to_nats[server][node].set(Passing::Nothing),
            Fault::Isolate(at) => self.to_nats[at].iter().for_each(|l| l.set(Passing::Nothing)),
            Fault::CutNodes(a, b) => self.cluster.set(a, b, Passing::Nothing),
            Fault::CutWorker(at) => self.to_worker[at].iter().for_each(|l| l.set(Passing::Nothing)),
            Fault::Slow(at) => {
                self.to_nats[at].iter().for_each(|l| l.set(Passing::Slowly(SLOW_BYTES)));
            }
            Fault::FullStore => self.limit_store(1).await,
        }
    }

    async fn end(&mut self, fault: Fault) {
        match fault {
            Fault::KillWorker(at) => self.start_server(at),
            Fault::PauseWorker(at) => self.signal(at, Signal::CONT),
            Fault::KillGateway(at) => self.start_server(WORKERS + at),
            Fault::KillNode(at) => self.cluster.restart(at),
            Fault::PauseNode(at) => self.cluster.signal(at, Signal::CONT),
            Fault::CutServer(server, node) => self.to_nats[server][node].set(Passing::All),
            Fault::Isolate(at) | Fault::Slow(at) => {
                self.to_nats[at].iter().for_each(|link| link.set(Passing::All));
            }
            Fault::CutNodes(a, b) => self.cluster.set(a, b, Passing::All),
            Fault::CutWorker(at) => self.to_worker[at].iter().for_each(|l| l.set(Passing::All)),
            Fault::FullStore => self.limit_store(-1).await,
        }
    }

    fn findings(&self) -> Findings {
        let log = |server| std::fs::read_to_string(self.cluster.log(&name(server)));
        let logs: Vec<String> =
            (0..WORKERS + GATEWAYS).map(|server| log(server).expect("it wrote a log")).collect();
        fleet_logs::read(&logs)
    }

    /// The sequences of the frames that a map has.
    async fn frames(&self, map: &str) -> Vec<u64> {
        let address = &self.ports[WORKERS][1];
        let url = format!(
            "http://{address}/v1/maps/{map}/export/trajectory.json?wait=settled&wait_seconds=60"
        );
        let began = Instant::now();
        loop {
            if let Ok(reply) = reqwest::get(&url).await
                && reply.status().is_success()
            {
                let trajectory: Value = reply.json().await.expect("it is JSON");
                let frames = trajectory.as_array().expect("a list of poses");
                return frames.iter().filter_map(|frame| frame["sequence"].as_u64()).collect();
            }
            assert!(began.elapsed() < RECOVERY, "map {map} cannot be read");
            tokio::time::sleep(Duration::from_millis(500)).await;
        }
    }
}

fn name(server: usize) -> String {
    if server < WORKERS {
        format!("worker-{server}")
    } else {
        format!("gateway-{}", server - WORKERS)
    }
}

/// The program, where one worker's clock is an hour ahead and one gateway's is an hour behind.
fn with_clock(program: PathBuf, server: usize) -> Command {
    let mut command = Command::new(program);
    let library = root().join(".deps/faketime/libfaketimeMT.so.1");
    let offset = match server {
        1 => "+1h",
        WORKERS => "-1h",
        _ => return command,
    };
    if library.exists() {
        command.env("LD_PRELOAD", library).env("FAKETIME", offset);
        // Such a clock only counts: no administrator can set it wrong.
        command.env("FAKETIME_DONT_FAKE_MONOTONIC", "1");
    }
    command
}

fn free_address() -> String {
    format!("127.0.0.1:{}", free_port())
}

/// Lets `count` things fail. Returns what the logs say, and how many frames the maps have.
async fn soak(
    program: PathBuf,
    seed: u64,
    count: u64,
    pick: fn(&mut ChaCha8Rng) -> Fault,
) -> (Findings, u64) {
    let shared = Arc::<Shared>::default();
    let mut fleet = Fleet::start(program, shared.clone()).await;
    let map = |at: usize| format!("soak-{at}");
    let robots: Vec<_> = (0..ROBOTS)
        .map(|at| {
            let robot = Robot { map: map(at), shared: shared.clone(), durable: None, acked: None };
            tokio::spawn(robot.drive(at))
        })
        .collect();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut open: Vec<(Instant, Fault)> = Vec::new();
    for at in 0..count {
        let fault = pick(&mut random);
        let acked = shared.acked.load(Ordering::Relaxed);
        println!("{at:4} {fault:?}, {} others, {acked} frames acknowledged", open.len());
        fleet.begin(fault).await;
        open.push((Instant::now() + Duration::from_millis(random.random_range(LASTS)), fault));
        let next = Instant::now() + Duration::from_millis(random.random_range(APART));
        while Instant::now() < next {
            tokio::time::sleep(Duration::from_millis(100)).await;
            fleet.take_started().await;
            let (over, left) = open.into_iter().partition(|(until, _)| *until < Instant::now());
            open = left;
            let over: Vec<(Instant, Fault)> = over;
            for (_, fault) in over {
                fleet.end(fault).await;
            }
        }
    }
    for (_, fault) in open {
        fleet.end(fault).await;
    }
    // Faults may have overlapped: the first to end ends both.
    (0..WORKERS + GATEWAYS).for_each(|server| fleet.start_server(server));
    let began = Instant::now();
    while fleet.servers.iter().any(Option::is_none) || began.elapsed() < Duration::from_secs(5) {
        assert!(began.elapsed() < RECOVERY, "not all servers start");
        fleet.take_started().await;
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    shared.is_ending.store(true, Ordering::Relaxed);
    let mut frames = 0;
    for (at, robot) in robots.into_iter().enumerate() {
        let sent = tokio::time::timeout(RECOVERY, robot).await;
        let sent = sent.expect("the fleet is well again").expect("frames are as they should be");
        let expected: Vec<u64> = (0..sent).collect();
        assert_eq!(fleet.frames(&map(at)).await, expected, "map {}", map(at));
        frames += sent;
    }
    let broken = shared.broken.load(Ordering::Relaxed);
    println!("{frames} frames, {broken} connections ended early");
    (fleet.findings(), frames)
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "takes a quarter of an hour: make soak-fleet"]
async fn nothing_acknowledged_is_lost_whatever_fails() {
    let (seed, count) = (number("SEED", 27), number("FAULTS", 200));
    if !root().join(".deps/faketime").exists() {
        println!(
            "SKIPPED: all clocks are right, because libfaketime could not be had (deploy/setup.sh --fleet)"
        );
    }
    let (findings, frames) = soak(program("lexsplat-server"), seed, count, Fault::random).await;
    println!("{findings:?}");
    assert!(findings.faults.is_empty(), "{:#?}", findings.faults);
    assert!(
        frames > count && findings.acks as u64 >= frames && findings.taken > ROBOTS,
        "{findings:?}"
    );
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "needs a build without fencing: make soak-fleet"]
async fn the_checker_finds_that_fencing_is_missing() {
    let program = std::env::var("LEXSPLAT_UNFENCED").expect("LEXSPLAT_UNFENCED names the program");
    let pause = |random: &mut ChaCha8Rng| Fault::PauseWorker(random.random_range(0..WORKERS));
    let (findings, _) = soak(program.into(), number("SEED", 27), 20, pause).await;
    println!("{findings:?}");
    assert!(!findings.faults.is_empty(), "nothing was found: {findings:?}");
}
