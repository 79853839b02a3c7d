//! A server process under load for an hour: four robots, twenty questions a second, maps that are deleted and
//! begun anew. Its memory and its descriptors stay where they are, and nothing is lost.

use lexsplat_client::http::{HttpClient, Question};
use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_proto::v1::{FrameMessage, FrameStatus, frame_message::Message};
use lexsplat_tests::{Robot, ServerProcess};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::sync::{Semaphore, mpsc};
use tokio_stream::wrappers::ReceiverStream;

const ROBOTS: usize = 4;
/// Views of each robot's room; it walks back and forth.
const VIEWS: usize = 6;
/// Frames of a map until it is deleted, and the time between two.
const FRAMES_OF_A_MAP: usize = 30;
const FRAME_PAUSE: Duration = Duration::from_secs(1);
const QUESTION_PAUSE: Duration = Duration::from_millis(50);
/// Questions that may wait for answers; beyond that one that is due is counted and not asked.
const MOST_WAITING: usize = 32;
const SAMPLE_PAUSE: Duration = Duration::from_secs(10);
/// Most growth of the median from the second to the last quarter, as a share.
const MOST_GROWTH: f64 = 0.05;
const TEXTS: [&str; 5] = ["chair", "table", "lamp", "book", "cup"];
const PATIENCE: Duration = Duration::from_secs(300);

/// How often what happened.
#[derive(Debug, Default)]
struct Tally {
    frames: AtomicUsize,
    maps: AtomicUsize,
    answered: AtomicUsize,
    /// The server was busy, or the map was just deleted or had no frame yet.
    refused: AtomicUsize,
    not_asked: AtomicUsize,
    /// Why questions were refused.
    reasons: Mutex<BTreeMap<String, usize>>,
}

/// What a process takes.
#[derive(Clone, Copy, Debug)]
struct Sample {
    resident_bytes: f64,
    descriptors: f64,
}

fn count(counter: &AtomicUsize) {
    counter.fetch_add(1, Ordering::Relaxed);
}

fn start(data: &Path) -> ServerProcess {
    ServerProcess::start(&[
        ("LEXSPLAT__SERVER__DATA_DIR", data.to_str().expect("a plain path")),
        ("LEXSPLAT__SERVER__CHECKPOINT_SECONDS", "15"),
        // As in deploy/: else glibc keeps what it freed, in an arena for each of many threads.
        ("MALLOC_ARENA_MAX", "2"),
    ])
}

/// A robot that builds one map after the other. Returns how many frames of the last one are durable.
async fn drive(
    grpc: String,
    http: HttpClient,
    (robot, walk): (usize, Arc<Robot>),
    going: Arc<AtomicBool>,
    tally: Arc<Tally>,
) -> u64 {
    let map = format!("soak-{robot}");
    // The maps begin and end at different times.
    let mut frames = FRAMES_OF_A_MAP * (robot + 1) / ROBOTS;
    loop {
        let durable = stream(&grpc, &map, &walk, frames, &going, &tally).await;
        frames = FRAMES_OF_A_MAP;
        if !going.load(Ordering::Relaxed) {
            return durable;
        }
        http.delete(&map).await.expect("it is deleted");
        count(&tally.maps);
    }
}

/// Streams so many frames into a map, fewer at the end. Every one is tracked or lost, and durable.
async fn stream(
    grpc: &str,
    map: &str,
    walk: &Arc<Robot>,
    frames: usize,
    going: &Arc<AtomicBool>,
    tally: &Tally,
) -> u64 {
    let (messages, outgoing) = mpsc::channel(1);
    let (walk, open, going) = (walk.clone(), walk.open(map), going.clone());
    let sending = tokio::spawn(async move {
        messages.send(open).await.expect("the stream is open");
        for at in 0..frames {
            let round = at % (2 * VIEWS - 2);
            let mut frame = walk.frame(round.min(2 * VIEWS - 2 - round));
            (frame.sequence, frame.timestamp_nanos) = (at as u64, at as u64 * 33_333_333);
            let message = FrameMessage { message: Some(Message::Frame(frame)) };
            messages.send(message).await.expect("the stream is open");
            if !going.load(Ordering::Relaxed) {
                return at as u64 + 1;
            }
            tokio::time::sleep(FRAME_PAUSE).await;
        }
        frames as u64
    });
    let mut client = MappingClient::connect(format!("http://{grpc}")).await.expect("it listens");
    let acks = client.stream_frames(ReceiverStream::new(outgoing)).await.expect("it opens");
    let (mut acks, mut durable) = (acks.into_inner(), 0);
    while let Some(ack) = acks.message().await.expect("the stream ends well") {
        assert!(ack.status() != FrameStatus::Refused, "{ack:?}");
        durable = ack.durable_through.map_or(durable, |through| through + 1);
        if ack.status() != FrameStatus::Opened {
            count(&tally.frames);
        }
    }
    assert_eq!(durable, sending.await.expect("it does not panic"), "{map}: frames are missing");
    durable
}

/// Asks questions at a constant rate.
async fn ask(http: HttpClient, going: Arc<AtomicBool>, tally: Arc<Tally>) {
    let places = Arc::new(Semaphore::new(MOST_WAITING));
    let mut due = tokio::time::interval(QUESTION_PAUSE);
    for number in 0_usize.. {
        due.tick().await;
        if !going.load(Ordering::Relaxed) {
            break;
        }
        let Ok(place) = places.clone().try_acquire_owned() else {
            count(&tally.not_asked);
            continue;
        };
        let text = TEXTS[number / 8 % TEXTS.len()];
        let question =
            if number % 2 == 0 { Question::in_frame(text, 0) } else { Question::in_space(text) };
        let (http, tally) = (http.clone(), tally.clone());
        tokio::spawn(async move {
            let map = format!("soak-{}", number / 2 % ROBOTS);
            match http.query(&map, &question).await {
                Ok(_) => count(&tally.answered),
                Err(error) => {
                    count(&tally.refused);
                    let mut reasons = tally.reasons.lock().expect("nobody panicked");
                    *reasons.entry(error.to_string()).or_default() += 1;
                }
            }
            drop(place);
        });
    }
    // Until all are answered.
    let _all = places.acquire_many(MOST_WAITING as u32).await.expect("it is never closed");
}

/// What the server says about its process.
async fn sample(http: &HttpClient) -> Sample {
    let text = http.metrics().await.expect("it answers");
    let gauge = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        line.and_then(|value| value.parse().ok()).unwrap_or_else(|| panic!("{name} in {text}"))
    };
    Sample {
        resident_bytes: gauge("process_resident_memory_bytes"),
        descriptors: gauge("process_open_fds"),
    }
}

/// Medians of the second and the last quarter.
fn medians(samples: &[Sample], value: fn(&Sample) -> f64) -> [f64; 2] {
    let quarter = samples.len() / 4;
    [&samples[quarter..2 * quarter], &samples[samples.len() - quarter..]].map(|part| {
        let mut values: Vec<f64> = part.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    })
}

fn is_flat([early, late]: [f64; 2]) -> bool {
    late <= early * (1.0 + MOST_GROWTH)
}

/// Runs the load until it is enough, as the time and the tally say. Returns samples of the process.
async fn soak(is_enough: impl Fn(Duration, &Tally) -> bool, pause: Duration) -> Vec<Sample> {
    let walks: Vec<_> =
        (0..ROBOTS).map(|robot| Arc::new(Robot::new(100 + robot as u64, VIEWS))).collect();
    let data = tempfile::tempdir().expect("a temporary folder can be made");
    let server = start(data.path());
    let http = HttpClient::new(&server.http).expect("an address");
    let (going, tally) = (Arc::new(AtomicBool::new(true)), Arc::new(Tally::default()));
    let driving: Vec<_> = walks
        .into_iter()
        .enumerate()
        .map(|robot| {
            let (going, tally) = (going.clone(), tally.clone());
            tokio::spawn(drive(server.grpc.clone(), http.clone(), robot, going, tally))
        })
        .collect();
    let asking = tokio::spawn(ask(http.clone(), going.clone(), tally.clone()));
    let (began, mut samples) = (Instant::now(), Vec::new());
    while !is_enough(began.elapsed(), &tally) {
        tokio::time::sleep(pause).await;
        samples.push(sample(&http).await);
        println!("{:4} s {:?} {tally:?}", began.elapsed().as_secs(), samples[samples.len() - 1]);
    }
    going.store(false, Ordering::Relaxed);
    let mut durable = Vec::new();
    for robot in driving {
        durable.push(robot.await.expect("nothing was refused or lost"));
    }
    asking.await.expect("it does not panic");
    drop(server);
    // After a sudden end every map is there, with all its frames.
    let server = start(data.path());
    for (robot, frames) in durable.into_iter().enumerate() {
        assert_eq!(frames_of(&server, &format!("soak-{robot}")).await, frames, "robot {robot}");
    }
    samples
}

/// Frames of a map that may be loading.
async fn frames_of(server: &ServerProcess, map: &str) -> u64 {
    let began = Instant::now();
    loop {
        let url = format!("http://{}/v1/maps/{map}", server.http);
        let reply = reqwest::get(&url).await.expect("it answers");
        if reply.status() != 503 {
            let status: Value = reply.json().await.expect("JSON");
            return status["frames_received"].as_u64().expect("a number");
        }
        assert!(began.elapsed() < PATIENCE, "{map} is not loaded");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_little_load_loses_nothing() {
    let is_enough = |passed, tally: &Tally| {
        assert!(passed < PATIENCE, "{tally:?}");
        [&tally.answered, &tally.maps].iter().all(|count| count.load(Ordering::Relaxed) > 0)
    };
    let samples = soak(is_enough, Duration::from_millis(200)).await;
    assert!(samples.iter().all(|sample| sample.descriptors > 10.0), "{samples:?}");
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "an hour: make soak; SOAK_SECONDS says how long"]
async fn memory_and_descriptors_stay_as_they_are() {
    let seconds = std::env::var("SOAK_SECONDS")
        .map_or(3600, |seconds| seconds.parse().expect("SOAK_SECONDS is a number of seconds"));
    let length = Duration::from_secs(seconds);
    let samples = soak(|passed, _| passed >= length, SAMPLE_PAUSE).await;
    let memory = medians(&samples, |sample| sample.resident_bytes / f64::from(1 << 20));
    let descriptors = medians(&samples, |sample| sample.descriptors);
    println!("medians of the second and the last quarter: {memory:.0?} MiB, {descriptors:?} open");
    assert!(is_flat(memory), "memory grows: {memory:?} MiB");
    // Connections come and go with the questions.
    assert!(descriptors[1] <= descriptors[0] + 8.0, "descriptors: {descriptors:?}");
}

#[test]
fn growth_is_seen() {
    let sample = |at: usize, growth: f64| Sample {
        resident_bytes: 1e9 * (1.0 + growth * at as f64 / 100.0),
        descriptors: 30.0,
    };
    let growing = |growth| (0..100).map(|at| sample(at, growth)).collect::<Vec<_>>();
    assert!(is_flat(medians(&growing(0.01), |sample| sample.resident_bytes)));
    assert!(!is_flat(medians(&growing(0.2), |sample| sample.resident_bytes)));
}
