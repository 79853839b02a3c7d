//! A server that is started again: its maps are loaded from checkpoints and recordings, and are what they
//! were.

use lexsplat_client::Access;
use lexsplat_client::dataset::Intrinsics;
use lexsplat_client::http::{HttpClient, Question};
use lexsplat_client::stream::{FrameStream, MapSpec, Poses};
use lexsplat_proto::v1::{self, FrameMessage};
use lexsplat_server::config::Config;
use lexsplat_server::pipeline::mapper::Clock;
use lexsplat_synthetic::Camera;
use lexsplat_tests::{Robot, Server, tiny_config};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tonic::Code;

/// How long loading may take.
const PATIENCE: Duration = Duration::from_secs(300);
const POLL: Duration = Duration::from_millis(50);
const MAP: &str = "kept";

/// Maps that are the same every time, recorded in a folder.
fn config(data: &Path) -> Config {
    let mut config = tiny_config();
    config.mapper.clock = Clock::PerFrame;
    config.server.data_dir = Some(data.to_owned());
    config.server.loading_wait_seconds = 0;
    config
}

/// A question about everything, without what differs each time.
async fn answer(server: &Server, map: &str) -> Value {
    let url = server.url(&format!("/v1/maps/{map}/query"));
    let question = json!({"text": "chair"});
    let began = Instant::now();
    loop {
        let reply = reqwest::Client::new().post(&url).json(&question).send().await;
        let reply = reply.expect("it answers");
        if reply.status() == 503 && began.elapsed() < PATIENCE {
            tokio::time::sleep(POLL).await;
            continue;
        }
        assert!(reply.status().is_success(), "{}", reply.text().await.unwrap_or_default());
        let mut answer: Value = reply.json().await.expect("JSON");
        for own in ["query_id", "timing_ms", "points"] {
            answer.as_object_mut().expect("an object").remove(own);
        }
        return answer;
    }
}

async fn get(server: &Server, path: &str) -> reqwest::Response {
    reqwest::get(server.url(path)).await.expect("it answers")
}

/// The answer with the direction up, the Gaussians and the poses.
async fn all(server: &Server, map: &str) -> (Value, Vec<u8>, String) {
    answer(server, map).await;
    server.settled(map).await;
    let mut answer = answer(server, map).await;
    let status = get(server, &format!("/v1/maps/{map}")).await.json::<Value>().await;
    answer["up"] = status.expect("JSON")["up"].take();
    assert!(answer["up"]["direction"].is_array(), "{answer}");
    let splats = get(server, &format!("/v1/maps/{map}/export/splats.ply")).await;
    let poses = get(server, &format!("/v1/maps/{map}/trajectory")).await;
    let splats = splats.bytes().await.expect("bytes").to_vec();
    (answer, splats, poses.text().await.expect("text"))
}

fn messages(robot: &Robot, frames: std::ops::Range<usize>) -> Vec<FrameMessage> {
    robot.stream_without_poses(MAP, frames.map(|at| robot.frame(at)))
}

/// A server on this folder that was sent these streams, and what its map is then.
async fn after(data: &Path, streams: &[Vec<FrameMessage>]) -> (Value, Vec<u8>, String) {
    let server = Server::start(config(data)).await;
    for stream in streams {
        answer_of_open(&server).await;
        server.send(stream.clone()).await.expect("the stream ends well");
    }
    let all = all(&server, MAP).await;
    server.stop().await;
    all
}

/// Waits until a map that may be loading can be used.
async fn answer_of_open(server: &Server) {
    let began = Instant::now();
    while get(server, &format!("/v1/maps/{MAP}")).await.status() == 503 {
        assert!(began.elapsed() < PATIENCE);
        tokio::time::sleep(POLL).await;
    }
}

/// The only checkpoint of the map in a folder.
fn checkpoint(data: &Path) -> PathBuf {
    let folder = data.join(format!("{MAP}.map"));
    let entries = std::fs::read_dir(folder).expect("the map has a folder");
    let files = entries.map(|entry| entry.expect("it can be read").path());
    let is_checkpoint = |path: &PathBuf| path.extension().is_some_and(|end| end == "lexsplat");
    let found: Vec<PathBuf> = files.filter(is_checkpoint).collect();
    assert_eq!(found.len(), 1, "{found:?}");
    found[0].clone()
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder can be made")
}

#[tokio::test(flavor = "multi_thread")]
async fn answers_are_those_before_and_mapping_goes_on_as_without_a_restart() {
    let robot = Robot::new(7, 12);
    let (first, second) = (messages(&robot, 0..7), messages(&robot, 7..12));
    let (stopped, through) = (folder(), folder());
    let before = after(stopped.path(), std::slice::from_ref(&first)).await;
    checkpoint(stopped.path());
    let again = after(stopped.path(), &[]).await;
    assert_eq!(before.0, again.0, "the answer");
    assert!(before.1 == again.1 && before.2 == again.2, "Gaussians and poses, bit for bit");
    let went_on = after(stopped.path(), std::slice::from_ref(&second)).await;
    let without = after(through.path(), &[first, second]).await;
    assert_eq!(went_on.0, without.0, "the answer");
    assert!(went_on.1 == without.1 && went_on.2 == without.2, "bit for bit");
    assert!(went_on.1 != before.1, "negative control: the map has changed");
}

/// A server that was killed in the middle of a stream: its last checkpoint is older than its recording.
#[tokio::test(flavor = "multi_thread")]
async fn a_stream_goes_on_behind_a_checkpoint_in_its_middle() {
    let robot = Robot::new(7, 12);
    let (half, whole) = (folder(), folder());
    after(half.path(), &[messages(&robot, 0..6)]).await;
    let wanted = after(whole.path(), &[messages(&robot, 0..12)]).await;
    std::fs::remove_file(checkpoint(whole.path())).expect("it can be removed");
    let rebuilt = after(whole.path(), &[]).await;
    assert!(rebuilt == wanted, "from the recording alone");
    let newest = checkpoint(whole.path());
    std::fs::copy(checkpoint(half.path()), &newest).expect("it can be copied");
    let went_on = after(whole.path(), &[]).await;
    assert_eq!(went_on.0, wanted.0);
    assert!(went_on.1 == wanted.1 && went_on.2 == wanted.2, "bit for bit");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_checkpoint_that_cannot_be_used_is_told_and_the_recording_is_used() {
    let robot = Robot::new(7, 6);
    let data = folder();
    let before = after(data.path(), &[messages(&robot, 0..6)]).await;
    let file = checkpoint(data.path());
    let mut bytes = std::fs::read(&file).expect("it can be read");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    std::fs::write(&file, &bytes).expect("it can be written");
    let server = Server::start(config(data.path())).await;
    let again = all(&server, MAP).await;
    assert!(again == before, "from the recording");
    let status: Value = get(&server, &format!("/v1/maps/{MAP}")).await.json().await.expect("JSON");
    let damage = status["recording_damage"].as_str().unwrap_or_default();
    assert!(damage.contains("checkpoint-0001.lexsplat"), "{status}");
    server.stop().await;
    // Other settings make another map: a checkpoint would hide that.
    let mut other = config(data.path());
    other.mapper.steps_per_keyframe += 3;
    let server = Server::start(other).await;
    let changed = all(&server, MAP).await;
    assert!(changed.1 != before.1, "with other settings it is mapped again");
    let status: Value = get(&server, &format!("/v1/maps/{MAP}")).await.json().await.expect("JSON");
    assert!(status["recording_damage"].is_null(), "that is no damage: {status}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_map_that_is_loading_says_so() {
    let robot = Robot::new(7, 20);
    let data = folder();
    after(data.path(), &[messages(&robot, 0..20)]).await;
    std::fs::remove_file(checkpoint(data.path())).expect("it can be removed");
    let server = Server::start(config(data.path())).await;
    assert!(get(&server, "/readyz").await.status().is_success(), "it is ready at once");
    let reply = get(&server, &format!("/v1/maps/{MAP}/trajectory")).await;
    assert_eq!(reply.status(), 503);
    assert!(reply.headers().contains_key("retry-after"));
    let problem: Value = reply.json().await.expect("JSON");
    assert!(problem["detail"].as_str().is_some_and(|text| text.contains("loaded")), "{problem}");
    let began = Instant::now();
    let progress = loop {
        let reply = get(&server, &format!("/v1/maps/{MAP}")).await;
        assert_eq!(reply.status(), 503, "20 frames take longer");
        let problem: Value = reply.json().await.expect("JSON");
        if problem["progress"]["frames_total"] == 20 {
            break problem["progress"]["frames_done"].as_u64().expect("a number");
        }
        assert!(began.elapsed() < PATIENCE, "{problem}");
    };
    assert!(progress < 20);
    let listed: Value = get(&server, "/v1/maps").await.json().await.expect("JSON");
    assert_eq!(
        (&listed["maps"][0]["name"], &listed["maps"][0]["state"]),
        (&json!(MAP), &json!("loading"))
    );
    let ready: Value = get(&server, "/readyz").await.json().await.expect("JSON");
    assert_eq!(ready["loading"][0]["map"], MAP);
    let request = v1::GetMapRequest { name: MAP.into() };
    let refused = server.client().await.get_map(request).await.expect_err("it is loading");
    assert_eq!(refused.code(), Code::Unavailable);
    assert!(refused.message().contains("being loaded"), "{}", refused.message());
    let refused = server.send(messages(&robot, 0..1)).await.expect_err("it is loading");
    assert_eq!(refused.code(), Code::Unavailable, "{}", refused.message());
    let create = reqwest::Client::new().post(server.url("/v1/maps")).json(&json!({"name": MAP}));
    assert_eq!(create.send().await.expect("it answers").status(), 503, "the name is taken");
    // A map can be deleted while it is loaded.
    let deleted = reqwest::Client::new().delete(server.url(&format!("/v1/maps/{MAP}"))).send();
    assert_eq!(deleted.await.expect("it answers").status(), 204);
    assert_eq!(get(&server, &format!("/v1/maps/{MAP}")).await.status(), 404);
    assert!(!data.path().join(format!("{MAP}.map")).exists());
    server.stop().await;
}

/// The library's clients wait instead of failing.
#[tokio::test(flavor = "multi_thread")]
async fn clients_wait_for_a_map_that_is_loading() {
    let robot = Robot::new(7, 8);
    let data = folder();
    after(data.path(), &[messages(&robot, 0..8)]).await;
    std::fs::remove_file(checkpoint(data.path())).expect("it can be removed");
    let server = Server::start(config(data.path())).await;
    assert_eq!(get(&server, &format!("/v1/maps/{MAP}")).await.status(), 503, "it is loading");
    let asker = HttpClient::new(&server.http).expect("an address").waiting(300);
    let Camera { width, height, fx, fy, cx, cy } = robot.camera;
    let spec = MapSpec {
        map: MAP.into(),
        cameras: Intrinsics { width, height, fx, fy, cx, cy }.into(),
        depth_unit_metres: 1.0 / 6553.5,
        poses: Poses::Estimate,
        label_texts: Vec::new(),
    };
    let question = Question::in_space("chair");
    let access = Access::default();
    let (answer, stream) = tokio::join!(
        asker.query(MAP, &question),
        FrameStream::open(&server.grpc, &access, spec, 1)
    );
    let answer = answer.expect("it is answered");
    assert_eq!((answer.settled, answer.through), (true, Some(7)));
    let opened = stream.expect("it opens").opened;
    assert_eq!(opened.received_through, Some(7), "the robot goes on behind that");
    server.stop().await;
}
