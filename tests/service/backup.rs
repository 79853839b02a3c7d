//! Backups of maps: one file, taken while a map is being made, checked, and put in place under another name.

use lexsplat_server::config::Config;
use lexsplat_tests::{Robot, Server, tiny_config};
use reqwest::{Body, Response};
use serde_json::{Value, json};
use std::path::Path;
use std::time::{Duration, Instant};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio_stream::wrappers::ReceiverStream;

/// How long loading may take.
const PATIENCE: Duration = Duration::from_secs(300);

fn config(data: &Path) -> Config {
    let mut config = tiny_config();
    config.mapper.clock = lexsplat_server::pipeline::mapper::Clock::PerFrame;
    config.server.data_dir = Some(data.to_owned());
    config.server.loading_wait_seconds = 0;
    config
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder can be made")
}

async fn get(server: &Server, path: &str) -> Response {
    reqwest::get(server.url(path)).await.expect("it answers")
}

async fn backup(server: &Server, map: &str) -> Vec<u8> {
    let reply = get(server, &format!("/v1/maps/{map}/backup")).await;
    assert!(reply.status().is_success(), "{}", reply.text().await.unwrap_or_default());
    reply.bytes().await.expect("a file").to_vec()
}

async fn restore(server: &Server, map: &str, backup: Vec<u8>) -> (u16, Value) {
    restore_as(server, map, backup, "application/x-tar").await
}

async fn restore_as(server: &Server, map: &str, backup: Vec<u8>, kind: &str) -> (u16, Value) {
    let put = reqwest::Client::new().put(server.url(&format!("/v1/maps/{map}/backup")));
    let put = put.header("content-type", kind).body(backup);
    let reply = put.send().await.expect("it answers");
    (reply.status().as_u16(), reply.json().await.unwrap_or_default())
}

/// The Gaussians of a settled map, waiting while it loads.
async fn splats(server: &Server, map: &str) -> Vec<u8> {
    let began = Instant::now();
    loop {
        let reply =
            get(server, &format!("/v1/maps/{map}/export/splats.ply?wait=settled&wait_seconds=300"))
                .await;
        if reply.status() != 503 {
            assert!(reply.status().is_success(), "{}", reply.text().await.unwrap_or_default());
            assert_eq!(reply.headers()["lexsplat-settled"], "true");
            return reply.bytes().await.expect("a file").to_vec();
        }
        assert!(began.elapsed() < PATIENCE);
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_backup_becomes_the_same_map_elsewhere() {
    let (here, there) = (folder(), folder());
    let robot = Robot::new(7, 10);
    let server = Server::start(config(here.path())).await;
    let messages = robot.stream_without_poses("room", (0..10).map(|at| robot.frame(at)));
    server.send(messages).await.expect("the stream ends well");
    let original = splats(&server, "room").await;
    let taken = backup(&server, "room").await;
    let (status, problem) = restore(&server, "room", taken.clone()).await;
    assert_eq!((status, &problem["field"]), (409, &json!("name")), "the name is taken");
    assert_eq!(get(&server, "/v1/maps/nowhere/backup").await.status(), 404);
    server.stop().await;

    let server = Server::start(config(there.path())).await;
    let (status, problem) = restore(&server, "copy", taken.clone()).await;
    assert_eq!(status, 201, "{problem}");
    assert!(splats(&server, "copy").await == original, "bit for bit");
    let status: Value = get(&server, "/v1/maps/copy").await.json().await.expect("JSON");
    assert_eq!(status["frames_tracked"], 10);
    // It goes on.
    let more = robot.stream_without_poses(
        "copy",
        [lexsplat_proto::v1::Frame { sequence: 10, ..robot.frame(9) }],
    );
    server.send(more).await.expect("the stream ends well");
    let read = std::fs::read_dir(there.path()).expect("it can be listed");
    let names: Vec<String> = read
        .map(|entry| entry.expect("it can be read").file_name().display().to_string())
        .collect();
    assert!(names.contains(&"copy.map".to_owned()) && names.len() == 2, "{names:?}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_no_whole_backup_is_refused_and_leaves_nothing() {
    let data = folder();
    let robot = Robot::new(7, 4);
    let server = Server::start(config(data.path())).await;
    server.stream(&robot, "room").await;
    let taken = backup(&server, "room").await;
    let mut flipped = taken.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    let mut foreign = tar_of("../../escape", b"x");
    let cut = taken[..taken.len() - 1536].to_vec();
    for (what, archive) in [
        ("a flipped bit", flipped),
        ("half of it", taken[..taken.len() / 2].to_vec()),
        ("without its end", cut),
        ("nothing", Vec::new()),
        ("no tar", vec![7; 4000]),
        ("a path that leads outside", std::mem::take(&mut foreign)),
        ("another file", tar_of("notes.txt", b"hello")),
        ("a number without a next one", tar_of("4294967295.mcap", b"x")),
        ("a name that is longer than a header", tar_of(&"long/".repeat(60), b"x")),
    ] {
        let (status, problem) = restore(&server, "copy", archive).await;
        assert_eq!(status, 400, "{what}: {problem}");
        assert_eq!(get(&server, "/v1/maps/copy").await.status(), 404, "{what}");
        let left = std::fs::read_dir(data.path()).expect("it can be listed").count();
        assert_eq!(left, 2, "{what}: the lock and the room");
    }
    assert_eq!(restore(&server, "a%2Fb", taken.clone()).await.0, 400, "the name");
    let as_form = restore_as(&server, "copy", taken.clone(), "text/plain").await;
    assert_eq!(as_form.0, 415, "pages of other origins can send this unasked");
    let (status, restored) = restore(&server, "copy", taken).await;
    assert_eq!((status, restored), (201, json!({"frames": 4})), "and the whole one is taken");
    server.stop().await;
    let none = Server::start(tiny_config()).await;
    assert_eq!(restore(&none, "copy", Vec::new()).await.0, 409, "nothing is recorded there");
    none.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_restore_needs_room_and_a_free_place() {
    let (here, there) = (folder(), folder());
    let server = Server::start(config(here.path())).await;
    server.stream(&Robot::new(7, 4), "room").await;
    let taken = backup(&server, "room").await;
    server.stop().await;
    let mut little = config(there.path());
    little.recording.max_bytes = taken.len() as u64 / 2;
    let server = Server::start(little).await;
    let (status, problem) = restore(&server, "copy", taken.clone()).await;
    let detail = problem["detail"].as_str().unwrap_or_default();
    assert!(status == 507 && detail.contains("recording.max_bytes"), "{status}: {problem}");
    let left = std::fs::read_dir(there.path()).expect("it can be listed").count();
    assert_eq!(left, 1, "the lock");
    server.stop().await;
    let mut few = config(there.path());
    few.mapper.max_maps = 1;
    let server = Server::start(few).await;
    assert_eq!(restore(&server, "copy", taken.clone()).await.0, 201);
    // Whether it is loaded yet or not.
    for _ in 0..2 {
        let (status, problem) = restore(&server, "second", taken.clone()).await;
        let detail = problem["detail"].as_str().unwrap_or_default();
        assert!(status == 429 && detail.contains("mapper.max_maps"), "{status}: {problem}");
        splats(&server, "copy").await;
    }
    assert_eq!(get(&server, "/v1/maps/second").await.status(), 404);
    server.stop().await;
}

/// A restore whose body is sent bit by bit.
struct Slow {
    parts: mpsc::Sender<std::io::Result<Vec<u8>>>,
    answer: JoinHandle<Response>,
}

impl Slow {
    /// Begins, and waits until the server has begun, too.
    async fn begin(server: &Server, data: &Path, map: &str, part: &[u8]) -> Self {
        let (parts, body) = mpsc::channel(1);
        let put = reqwest::Client::new().put(server.url(&format!("/v1/maps/{map}/backup")));
        let put = put.header("content-type", "application/x-tar");
        let put = put.body(Body::wrap_stream(ReceiverStream::new(body))).send();
        let answer = tokio::spawn(async { put.await.expect("it answers") });
        parts.send(Ok(part.to_vec())).await.expect("it is read");
        let began = Instant::now();
        while !data.join(format!("{map}.map.unfinished")).exists() {
            assert!(began.elapsed() < PATIENCE);
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        Self { parts, answer }
    }

    /// Sends the rest and returns the status.
    async fn end(self, part: &[u8]) -> u16 {
        self.parts.send(Ok(part.to_vec())).await.expect("it is read");
        drop(self.parts);
        self.answer.await.expect("no panic").status().as_u16()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn restores_are_bounded_and_a_deletion_waits_for_one() {
    let data = folder();
    let server = Server::start(config(data.path())).await;
    server.stream(&Robot::new(7, 4), "room").await;
    let taken = backup(&server, "room").await;
    let (first, rest) = taken.split_at(taken.len() / 2);
    let one = Slow::begin(&server, data.path(), "one", first).await;
    let two = Slow::begin(&server, data.path(), "two", first).await;
    let (status, problem) = restore(&server, "three", taken.clone()).await;
    assert_eq!(status, 503, "{problem}");
    let delete = reqwest::Client::new().delete(server.url("/v1/maps/one")).send();
    let deleting = tokio::spawn(async { delete.await.expect("it answers").status() });
    tokio::time::sleep(Duration::from_millis(300)).await;
    assert!(!deleting.is_finished(), "the restore is not at its end");
    assert_eq!(one.end(rest).await, 201);
    assert!(deleting.await.expect("no panic").is_success());
    assert_eq!(get(&server, "/v1/maps/one").await.status(), 404);
    assert!(!data.path().join("one.map").exists());
    assert_eq!(restore(&server, "three", taken.clone()).await.0, 201, "there is a place again");
    assert_eq!(two.end(rest).await, 201);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn slow_clients_give_their_places_up() {
    let data = folder();
    let mut config = config(data.path());
    config.connections.body_seconds = 1;
    let server = Server::start(config).await;
    server.stream(&Robot::new(7, 4), "room").await;
    let taken = backup(&server, "room").await;
    let slow = Slow::begin(&server, data.path(), "slow", &taken[..taken.len() / 2]).await;
    let (parts, answer) = (slow.parts, slow.answer);
    let dripping = tokio::spawn(async move {
        // Until the server reads no more.
        while parts.send(Ok(vec![0])).await.is_ok() {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    });
    assert_eq!(answer.await.expect("no panic").status(), 408);
    dripping.await.expect("no panic");
    assert_eq!(restore(&server, "copy", taken).await.0, 201);
    // More than the buffers of sockets hold.
    let large = std::fs::File::create(data.path().join("room.map/0009.mcap")).expect("a file");
    large.set_len(256 << 20).expect("it takes no room on the disk");
    let mut unread = Vec::new();
    for _ in 0..4 {
        unread.push(get(&server, "/v1/maps/room/backup").await);
    }
    assert!(unread.iter().all(|reply| reply.status() == 200));
    let began = Instant::now();
    loop {
        let reply = get(&server, "/v1/maps/room/backup").await;
        if reply.status() == 200 {
            break;
        }
        assert_eq!(reply.status(), 503, "as many as there may be");
        assert!(began.elapsed() < PATIENCE, "nobody reads them");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    let mut broken = 0;
    for reply in unread {
        broken += usize::from(reply.bytes().await.is_err());
    }
    assert!(broken > 0, "a reader must not take a part for the whole");
    server.stop().await;
}

/// A tar with one file, written by hand as other programs could.
fn tar_of(name: &str, contents: &[u8]) -> Vec<u8> {
    let mut header = vec![0u8; 512];
    header[..name.len()].copy_from_slice(name.as_bytes());
    header[100..107].copy_from_slice(b"0000644");
    header[124..135].copy_from_slice(format!("{:011o}", contents.len()).as_bytes());
    header[136..147].copy_from_slice(b"00000000000");
    header[156] = b'0';
    header[257..263].copy_from_slice(b"ustar\0");
    header[263..265].copy_from_slice(b"00");
    header[148..156].copy_from_slice(b"        ");
    let sum: u32 = header.iter().map(|byte| u32::from(*byte)).sum();
    header[148..155].copy_from_slice(format!("{sum:06o}\0").as_bytes());
    let mut tar = header;
    tar.extend_from_slice(contents);
    tar.resize(tar.len().next_multiple_of(512) + 1024, 0);
    tar
}
