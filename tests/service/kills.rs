//! A server process that is killed while a robot sends frames, round after round. Between two rounds its
//! files are damaged as a crash or a bad disk does it. Frames that were acknowledged as durable stay as
//! they were, and damage is told.

use foxglove::messages::RawImage;
use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_proto::v1::{self, FrameMessage, frame_message::Message};
use lexsplat_tests::wall::{self, STEP_METRES};
use lexsplat_tests::{ServerProcess, program};
use prost::Message as _;
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, oneshot};
use tokio_stream::wrappers::ReceiverStream;

const MAP: &str = "kept";
/// Rounds of `make test`, and of `make soak` unless `KILL_ROUNDS` says otherwise.
const FEW_ROUNDS: usize = 5;
const MANY_ROUNDS: usize = 1000;
/// Rounds with the same data directory.
const ROUNDS_OF_A_FOLDER: usize = 20;
const SEED: u64 = 22;
/// How long a server may take to load the map.
const PATIENCE: Duration = Duration::from_secs(120);
/// Longest life of a server that takes frames, milliseconds.
const LONGEST_LIFE: u64 = 900;

/// What was done to the files between two rounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Damage {
    Nothing,
    /// A part of a frame at the end of the newest recording, as if the crash had come while it was written.
    TornFrame,
    /// One bit of a recording.
    RecordingBit,
    /// One bit of a checkpoint.
    CheckpointBit,
}

/// When a server is killed.
#[derive(Clone, Copy, Debug)]
struct Life {
    /// Counted from the first frame that is durable, not from the call.
    is_after_an_ack: bool,
    length: Duration,
}

impl Life {
    fn new(random: &mut ChaCha8Rng) -> Self {
        let length = Duration::from_millis(random.random_range(0..LONGEST_LIFE));
        Self { is_after_an_ack: random.random_range(0..5) > 0, length }
    }
}

/// A data directory, and what must be in it.
struct Folder {
    data: tempfile::TempDir,
    /// Frames that are on disk: they were acknowledged as durable, or read there.
    durable: BTreeSet<u64>,
    /// Frames that flipped bits have cost the recording. A checkpoint may have them.
    cost: BTreeSet<u64>,
    /// The next frame that is sent.
    next: u64,
    damage: Damage,
    /// The file that was damaged.
    damaged: PathBuf,
}

/// How often what happened.
#[derive(Debug, Default)]
struct Tally {
    rounds: usize,
    frames: usize,
    torn_frames: usize,
    recording_bits: usize,
    checkpoint_bits: usize,
    /// Frames that flipped bits cost.
    cost: usize,
}

impl Folder {
    fn new() -> Self {
        Self {
            data: tempfile::tempdir().expect("a temporary folder can be made"),
            durable: BTreeSet::new(),
            cost: BTreeSet::new(),
            next: 0,
            damage: Damage::Nothing,
            damaged: PathBuf::new(),
        }
    }

    fn map(&self) -> PathBuf {
        self.data.path().join(format!("{MAP}.map"))
    }

    /// The files of the map with this ending, oldest first.
    fn files(&self, ending: &str) -> Vec<PathBuf> {
        let Ok(entries) = std::fs::read_dir(self.map()) else { return Vec::new() };
        let paths = entries.map(|entry| entry.expect("it can be read").path());
        let mut found: Vec<PathBuf> =
            paths.filter(|path| path.to_str().is_some_and(|path| path.ends_with(ending))).collect();
        found.sort();
        found
    }

    fn start(&self) -> ServerProcess {
        ServerProcess::start(&[
            ("LEXSPLAT__SERVER__DATA_DIR", self.data.path().to_str().expect("a plain path")),
            ("LEXSPLAT__SERVER__CHECKPOINT_SECONDS", "1"),
            ("LEXSPLAT__MAPPER__MAX_GAUSSIANS", "500"),
            ("LEXSPLAT__MAPPER__STEPS_PER_KEYFRAME", "1"),
            ("LEXSPLAT__MAPPER__SNAPSHOT_SECONDS", "0.05"),
        ])
    }

    /// Sends frames until the server is killed. Notes what it said is durable.
    async fn live(&mut self, server: ServerProcess, life: Life) {
        let mut client =
            MappingClient::connect(format!("http://{}", server.grpc)).await.expect("it listens");
        let (messages, outgoing) = mpsc::channel(4);
        let first = self.next;
        let sending = tokio::spawn(async move {
            let mut next = first;
            if messages.send(wall::open(MAP)).await.is_err() {
                return next;
            }
            loop {
                let message = FrameMessage { message: Some(Message::Frame(wall::frame(next))) };
                if messages.send(message).await.is_err() {
                    return next;
                }
                next += 1;
            }
        });
        let (acknowledged, first_ack) = oneshot::channel();
        let killing = tokio::spawn(async move {
            if life.is_after_an_ack {
                // An error: the call failed.
                let _ = tokio::time::timeout(PATIENCE, first_ack).await;
            }
            tokio::time::sleep(life.length).await;
            drop(server);
        });
        let mut acknowledged = Some(acknowledged);
        // The call may fail: the server may be gone already.
        if let Ok(acks) = client.stream_frames(ReceiverStream::new(outgoing)).await {
            let mut acks = acks.into_inner();
            while let Ok(Some(ack)) = acks.message().await {
                assert!(ack.refused_field.is_empty(), "{ack:?}");
                if let Some(through) = ack.durable_through.filter(|through| *through >= first) {
                    self.durable.extend(first..=through);
                    if let Some(acknowledged) = acknowledged.take() {
                        // Nobody may wait for it.
                        let _ = acknowledged.send(());
                    }
                }
            }
        }
        killing.await.expect("the server can be killed");
        self.next = sending.await.expect("it ends when nobody receives");
        assert!(self.durable.last().is_none_or(|last| *last < self.next), "never sent");
    }

    /// Damages a file. What it does is noted for the check after the next start.
    fn damage(&mut self, random: &mut ChaCha8Rng) {
        self.damage = Damage::Nothing;
        let wanted = match random.random_range(0..6) {
            0 => Damage::TornFrame,
            1 | 2 => Damage::RecordingBit,
            3 => Damage::CheckpointBit,
            _ => return,
        };
        let mut files = match wanted {
            Damage::CheckpointBit => self.files(".lexsplat"),
            _ => self.files(".mcap"),
        };
        if files.is_empty() {
            return;
        }
        let at = match wanted {
            Damage::RecordingBit => random.random_range(0..files.len()),
            _ => files.len() - 1,
        };
        let path = files.swap_remove(at);
        let mut bytes = std::fs::read(&path).expect("it can be read");
        if wanted == Damage::TornFrame {
            let Some(chunk) = first_chunk(&bytes) else { return };
            // Behind a frame that the kill itself cut off, it would not be torn but mixed up.
            let ends_whole = records(&bytes).last().is_some_and(|(code, place)| {
                place.end == bytes.len() && code == mcap::records::op::MESSAGE_INDEX
            });
            if bytes.ends_with(mcap::MAGIC) || !ends_whole {
                return;
            }
            let part = chunk.start..random.random_range(chunk.start + 1..chunk.end);
            bytes.extend_from_within(part);
        } else {
            let end = if wanted == Damage::RecordingBit { read_part(&bytes) } else { bytes.len() };
            if end == 0 {
                return;
            }
            bytes[random.random_range(0..end)] ^= 1 << random.random_range(0..8);
        }
        std::fs::write(&path, bytes).expect("it can be written");
        self.damage = wanted;
        self.damaged = path;
    }

    /// Compares the map and the recording with what must be there. Returns how many frames were lost.
    async fn check(&mut self, server: &ServerProcess, context: &str) -> usize {
        let context = format!("{context}, {:?}", self.damage);
        let status = loaded(server).await;
        if self.durable.is_empty() && status.is_none() {
            return 0;
        }
        let found = self.recorded();
        let lost: Vec<u64> = self.durable.difference(&found).copied().collect();
        let may_cost = usize::from(self.damage == Damage::RecordingBit);
        assert!(lost.len() <= may_cost, "{context}: lost {lost:?}");
        self.durable = found;
        self.cost.extend(&lost);
        self.expect_told(server, status.as_ref(), !lost.is_empty(), &context).await;
        if status.is_some() {
            self.compare_map(server, &context).await;
        } else {
            assert!(self.durable.is_empty(), "{context}: the map is not there");
        }
        // As whoever looks after the server would do; the next damage has to be told anew.
        let files = self.files("");
        for aside in files.iter().filter(|path| path.to_string_lossy().contains("damaged-")) {
            std::fs::remove_file(aside).expect("it can be removed");
        }
        if self.damage == Damage::CheckpointBit {
            // An error: a newer checkpoint has taken its place.
            let _ = std::fs::remove_file(&self.damaged);
        }
        lost.len()
    }

    /// Damage is told, and nothing else is.
    async fn expect_told(
        &self,
        server: &ServerProcess,
        status: Option<&Value>,
        is_lost: bool,
        context: &str,
    ) {
        let told = status.map(|status| status["recording_damage"].as_str().unwrap_or_default());
        let warnings = get(server, "/readyz").await["warnings"].to_string();
        match self.damage {
            Damage::Nothing | Damage::TornFrame => {
                assert!(told.is_none_or(str::is_empty), "{context}: a false alarm: {told:?}");
            }
            // A bit of what no frame needs, such as the index of a chunk, costs nothing.
            Damage::RecordingBit if !is_lost && told.is_none_or(str::is_empty) => {}
            Damage::RecordingBit => {
                let is_told = |words: &str| words.contains(".mcap.damaged-");
                assert!(told.is_none_or(is_told), "{context}: not told: {told:?}");
                assert!(is_told(&warnings), "{context}: not told: {warnings}");
                assert!(!self.is_good(), "{context}: lexsplat-server check says that all is good");
            }
            Damage::CheckpointBit => {
                let is_told = |words: &str| words.contains(".lexsplat is not used");
                assert!(told.is_some_and(is_told), "{context}: not told: {told:?}");
            }
        }
    }

    /// The map has the frames of the recording, each with its pose.
    async fn compare_map(&self, server: &ServerProcess, context: &str) {
        let path = format!("/v1/maps/{MAP}/export/trajectory.json?wait=settled&wait_seconds=60");
        let poses = get(server, &path).await;
        let mut mapped = BTreeSet::new();
        for pose in poses.as_array().expect("a list of poses") {
            let sequence = pose["sequence"].as_u64().expect("a number");
            let x = pose["world_from_camera"][3].as_f64().expect("a matrix");
            assert!((x - STEP_METRES * sequence as f64).abs() < 1e-6, "{context}: {pose}");
            assert!(mapped.insert(sequence), "{context}: frame {sequence} is there twice");
        }
        let missing: Vec<&u64> = self.durable.difference(&mapped).collect();
        assert!(missing.is_empty(), "{context}: not in the map: {missing:?}");
        let more = mapped.difference(&self.durable).all(|sequence| self.cost.contains(sequence));
        assert!(more, "{context}: more than was recorded: {:?}, {mapped:?}", self.durable);
    }

    /// Frames in the recording, read by the `mcap` crate alone; each is what was sent.
    fn recorded(&self) -> BTreeSet<u64> {
        let mut found = BTreeSet::new();
        for path in self.files(".mcap") {
            let bytes = std::fs::read(&path).expect("it can be read");
            let (mut image, mut newest) = (RawImage::default(), found.last().copied());
            for message in mcap::MessageStream::new(&bytes).expect("a recording") {
                let message = message.expect("a whole recording");
                match message.channel.topic.as_str() {
                    "/camera/color_raw" => {
                        image = RawImage::decode(&message.data[..]).expect("an image");
                    }
                    "/lexsplat/frame" => {
                        let rest = v1::Frame::decode(&message.data[..]).expect("a frame");
                        let wanted = wall::frame(rest.sequence);
                        assert_eq!(image.data, wanted.color, "frame {}", rest.sequence);
                        assert_eq!(
                            (rest.timestamp_nanos, rest.world_from_camera),
                            (wanted.timestamp_nanos, wanted.world_from_camera)
                        );
                        assert!(newest < Some(rest.sequence), "in their order");
                        newest = Some(rest.sequence);
                        found.insert(rest.sequence);
                    }
                    _ => {}
                }
            }
        }
        found
    }

    /// What `lexsplat-server check` says.
    fn is_good(&self) -> bool {
        let mut check = Command::new(program("lexsplat-server"));
        check.arg("check").arg(self.data.path()).output().expect("it runs").status.success()
    }
}

/// Places of the records of an MCAP file that are whole: operation code and bytes.
fn records(bytes: &[u8]) -> impl Iterator<Item = (u8, std::ops::Range<usize>)> {
    let mut at = mcap::MAGIC.len();
    std::iter::from_fn(move || {
        let header = bytes.get(at..at + 9)?;
        let length = u64::from_le_bytes(header[1..].try_into().expect("8 bytes"));
        // A flipped bit can make a length as large as there is.
        let (start, end) = (at, usize::try_from(length).ok()?.checked_add(at + 9)?);
        at = end;
        (end <= bytes.len()).then_some((header[0], start..end))
    })
}

fn first_chunk(bytes: &[u8]) -> Option<std::ops::Range<usize>> {
    records(bytes).find(|(code, _)| *code == mcap::records::op::CHUNK).map(|(_, place)| place)
}

/// Bytes up to the end of the last chunk. The index behind it is for other programs.
fn read_part(bytes: &[u8]) -> usize {
    let chunks = records(bytes).filter(|(code, _)| *code == mcap::records::op::CHUNK);
    chunks.last().map_or(0, |(_, place)| place.end)
}

async fn get(server: &ServerProcess, path: &str) -> Value {
    let reply = reqwest::get(format!("http://{}{path}", server.http)).await.expect("it answers");
    let status = reply.status();
    let text = reply.text().await.expect("text");
    assert!(status.is_success(), "{path}: {status} {text}");
    serde_json::from_str(&text).expect("JSON")
}

/// The status of the map when it is loaded; `None` if there is no map.
async fn loaded(server: &ServerProcess) -> Option<Value> {
    let url = format!("http://{}/v1/maps/{MAP}", server.http);
    let began = Instant::now();
    loop {
        let reply = reqwest::get(&url).await.expect("it answers");
        match reply.status().as_u16() {
            404 => return None,
            503 => assert!(began.elapsed() < PATIENCE, "the map is not loaded"),
            _ => {
                let status: Value = reply.json().await.expect("JSON");
                assert!(status["failure"].is_null(), "{status}");
                return Some(status);
            }
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

async fn rounds(count: usize) -> Tally {
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut folder = Folder::new();
    let mut tally = Tally::default();
    for round in 0..count {
        let context = format!("round {round} of seed {SEED}");
        let server = folder.start();
        // Now and then the server dies while it loads, repairs or saves what it has.
        if random.random_range(0..6) == 0 {
            tokio::time::sleep(Duration::from_millis(random.random_range(0..300))).await;
            drop(server);
        } else {
            tally.cost += folder.check(&server, &context).await;
            let before = folder.durable.len();
            folder.live(server, Life::new(&mut random)).await;
            tally.frames += folder.durable.len() - before;
            folder.damage(&mut random);
            tally.torn_frames += usize::from(folder.damage == Damage::TornFrame);
            tally.recording_bits += usize::from(folder.damage == Damage::RecordingBit);
            tally.checkpoint_bits += usize::from(folder.damage == Damage::CheckpointBit);
        }
        tally.rounds += 1;
        if (round + 1) % ROUNDS_OF_A_FOLDER == 0 || round + 1 == count {
            tally.cost += folder.check(&folder.start(), &context).await;
            folder = Folder::new();
            println!("{tally:?}");
        }
    }
    tally
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_acknowledged_survives_kills_and_damage_is_told() {
    let tally = rounds(FEW_ROUNDS).await;
    assert!(tally.frames > 0, "{tally:?}");
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "an hour: make soak; KILL_ROUNDS says how many"]
async fn many_kills() {
    let count = std::env::var("KILL_ROUNDS")
        .map_or(MANY_ROUNDS, |rounds| rounds.parse().expect("KILL_ROUNDS is a number of rounds"));
    let tally = rounds(count).await;
    println!("nothing was lost in silence: {tally:?}");
    assert!(tally.recording_bits > 0 && tally.checkpoint_bits > 0, "{tally:?}");
}
