//! Recordings that are uploaded as one file and mapped.

use lexsplat_server::config::Config;
use lexsplat_server::pipeline::mapper::Clock;
use lexsplat_tests::{Server, tiny_config, zipped, zipped_walk};
use serde_json::{Value, json};
use std::path::Path;
use std::time::{Duration, Instant};

/// How long mapping a few frames may take.
const PATIENCE: Duration = Duration::from_secs(300);

fn config(data: &Path) -> Config {
    let mut config = tiny_config();
    config.mapper.clock = Clock::PerFrame;
    config.server.data_dir = Some(data.to_owned());
    config
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder can be made")
}

async fn upload_as(server: &Server, path: &str, file: Vec<u8>, kind: &str) -> (u16, Value) {
    let post = reqwest::Client::new().post(server.url(&format!("/v1/maps/{path}")));
    let reply = post.header("content-type", kind).body(file).send().await.expect("it answers");
    (reply.status().as_u16(), reply.json().await.expect("JSON"))
}

async fn upload(server: &Server, map: &str, file: Vec<u8>) -> (u16, Value) {
    upload_as(server, &format!("{map}/import"), file, "application/octet-stream").await
}

async fn get(server: &Server, path: &str) -> (u16, Value) {
    let reply = reqwest::get(server.url(path)).await.expect("it answers");
    (reply.status().as_u16(), reply.json().await.expect("JSON"))
}

/// What is told of an import once it has ended.
async fn ended(server: &Server, map: &str) -> Value {
    let began = Instant::now();
    loop {
        let (status, told) = get(server, &format!("/v1/maps/{map}/import")).await;
        assert_eq!(status, 200, "{told}");
        if told["state"] != "receiving" && told["state"] != "mapping" {
            return told;
        }
        assert!(began.elapsed() < PATIENCE, "{told}");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

/// Names in the data directory.
fn names(data: &Path) -> Vec<String> {
    let read = std::fs::read_dir(data).expect("it can be listed");
    let mut names: Vec<String> =
        read.map(|entry| entry.expect("it is there").file_name().display().to_string()).collect();
    names.sort();
    names
}

async fn splats(server: &Server, map: &str) -> Vec<u8> {
    server.settled(map).await;
    let url = server.url(&format!("/v1/maps/{map}/export/splats.ply?wait=settled"));
    reqwest::get(url).await.expect("it answers").bytes().await.expect("a file").to_vec()
}

#[tokio::test(flavor = "multi_thread")]
async fn an_uploaded_recording_becomes_the_map_that_a_robot_would_have_made() {
    let data = folder();
    let server = Server::start(config(data.path())).await;
    let zip = zipped_walk(7, 8);
    assert_eq!(get(&server, "/v1/maps/zip/import").await.0, 404, "none yet");
    let (status, told) = upload(&server, "zip", zip.clone()).await;
    assert_eq!((status, &told["state"]), (202, &json!("mapping")), "{told}");
    assert_eq!((&told["layout"], &told["poses"]), (&json!("replica"), &json!("given")));
    let told = ended(&server, "zip").await;
    assert_eq!((&told["state"], &told["frames_done"]), (&json!("done"), &json!(8)), "{told}");

    // Frames of another recording must not get into the map.
    let (status, problem) = upload(&server, "zip", zipped_walk(8, 12)).await;
    let detail = problem["detail"].as_str().unwrap_or_default();
    assert!(status == 409 && detail.contains("resume=true"), "{status}: {problem}");
    assert_eq!(ended(&server, "zip").await["frames_done"], 8, "what was told before stays");
    // The same frames once more are no new ones.
    let path = "zip/import?resume=true";
    assert_eq!(upload_as(&server, path, zip.clone(), "application/octet-stream").await.0, 202);
    let told = ended(&server, "zip").await;
    let counts = ["frames_total", "frames_done", "frames_resumed_past"].map(|key| &told[key]);
    assert_eq!(counts, [&json!(0), &json!(0), &json!(8)], "{told}");
    assert_eq!(get(&server, "/v1/maps/zip").await.1["frames_received"], 8);

    // The recording that the server made of them, which it reads, too.
    let recorded = std::fs::read(data.path().join("zip.map/0001.mcap")).expect("it is there");
    assert_eq!(upload(&server, "mcap", recorded).await.1["layout"], "mcap");
    assert_eq!(ended(&server, "mcap").await["frames_done"], 8);
    let original = splats(&server, "zip").await;
    assert!(original == splats(&server, "mcap").await, "bit for bit");
    // Control: another walk is another map.
    upload(&server, "other", zipped_walk(8, 8)).await;
    ended(&server, "other").await;
    assert!(original != splats(&server, "other").await);

    // Poses that the server is to estimate.
    let path = "tracked/import?poses=estimated";
    let (_, told) = upload_as(&server, path, zip, "application/octet-stream").await;
    assert_eq!(told["poses"], "estimated");
    assert_eq!(ended(&server, "tracked").await["frames_done"], 8);
    assert_eq!(
        names(data.path()),
        ["lexsplat.lock", "mcap.map", "other.map", "tracked.map", "zip.map"],
        "the uploaded files are gone"
    );
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_no_recording_is_refused_and_leaves_nothing() {
    let data = folder();
    let mut few = config(data.path());
    few.imports.max_files = 40;
    few.imports.max_bytes = 4 << 20;
    let server = Server::start(few).await;
    let walk = zipped_walk(7, 3);
    let transforms = |file: &str| {
        let pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
        let frame = json!({
            "file_path": "a.png", "depth_file_path": file, "transform_matrix": pose,
        });
        let list = json!({"fl_x": 10, "fl_y": 10, "cx": 5, "cy": 5, "frames": [frame]});
        zipped([("x/transforms.json", list.to_string().as_bytes()), ("x/a.png", b"\x89PNG")])
    };
    let many: Vec<String> = (0..41).map(|at| format!("{at}.txt")).collect();
    for (what, file, expected) in [
        ("nothing", Vec::new(), "expected a file of the kind"),
        ("no recording", vec![7; 4000], "expected a file of the kind"),
        ("half a zip", walk[..walk.len() / 2].to_vec(), "the zip: "),
        ("no pictures", zipped([("notes.txt", &b"hello"[..])]), "the zip: expected recording.toml"),
        ("outside", zipped([("../../escape.txt", &b"x"[..])]), "a path that leaves it"),
        ("a list that leads outside", transforms("../../../etc/hostname"), "in the folder of the"),
        ("an absolute path", transforms("/etc/hostname"), "in the folder of the recording"),
        ("many files", zipped(many.iter().map(|name| (name.as_str(), &b""[..]))), "max_files"),
        ("a bomb", zipped([("zeros", &vec![0; 5 << 20][..])]), "max_bytes"),
        ("a large file", vec![7; 5 << 20], "max_bytes"),
        ("two", zipped([("a/rgb.txt", &b""[..]), ("b/rgb.txt", b"")]), "one by one"),
    ] {
        let (status, problem) = upload(&server, "room", file).await;
        let detail = problem["detail"].as_str().unwrap_or_default();
        let is_large = expected == "max_bytes";
        assert_eq!(status, if is_large { 413 } else { 400 }, "{what}: {problem}");
        assert!(detail.contains(expected), "{what}: {detail}");
        assert!(!detail.contains(&data.path().display().to_string()), "{what}: {detail}");
        assert_eq!(get(&server, "/v1/maps/room/import").await.0, 404, "{what}");
        assert_eq!(names(data.path()), ["lexsplat.lock"], "{what}");
    }
    assert_eq!(upload(&server, "a%2Fb", walk.clone()).await.0, 400, "the name");
    let foreign = upload_as(&server, "room/import", walk.clone(), "text/plain").await;
    assert_eq!(foreign.0, 415, "pages of other origins can send this unasked");
    let unknown =
        upload_as(&server, "room/import?poses=x", walk.clone(), "application/octet-stream").await;
    assert_eq!(unknown.0, 400, "{}", unknown.1);
    assert_eq!(upload(&server, "room", walk).await.0, 202, "and a whole one is taken");
    ended(&server, "room").await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_waits_for_its_turn_and_can_be_stopped() {
    let data = folder();
    let mut one = config(data.path());
    one.imports.at_once = 1;
    // A queue of one frame: mapping cannot be over when the answer comes.
    one.mapper.queue_frames = 1;
    let server = Server::start(one).await;
    let walk = zipped_walk(7, 60);
    assert_eq!(upload(&server, "room", walk.clone()).await.0, 202);
    let (status, problem) = upload(&server, "other", walk.clone()).await;
    assert_eq!(status, 503, "{problem}");
    let (status, problem) = upload(&server, "room", walk.clone()).await;
    assert_eq!(status, 409, "{problem}");
    let delete = |map: &str| {
        let url = server.url(&format!("/v1/maps/{map}/import"));
        async { reqwest::Client::new().delete(url).send().await.expect("it answers").status() }
    };
    assert_eq!(delete("other").await, 404);
    assert_eq!(delete("room").await, 204);
    let told = ended(&server, "room").await;
    assert_eq!(told["state"], "stopped", "{told}");
    // It is free at once, and goes on.
    let path = "room/import?resume=true";
    let again = upload_as(&server, path, walk, "application/octet-stream").await;
    assert_eq!(again.0, 202, "{}", again.1);
    assert_eq!(delete("room").await, 204);
    assert_eq!(delete("room").await, 404, "it has ended");
    let (_, status) = get(&server, "/v1/maps/room").await;
    assert!(status["frames_received"].as_u64().is_some_and(|frames| frames < 60), "{status}");
    server.stop().await;
}
