//! Robots with different cameras feed one map, one after the other.

use lexsplat_proto::v1::{FrameAck, FrameStatus};
use lexsplat_server::config::Config;
use lexsplat_server::pipeline::mapper::Clock;
use lexsplat_synthetic::Camera;
use lexsplat_tests::{Robot, Server, tiny_config};
use serde_json::Value;
use std::path::Path;

const SEED: u64 = 3;
const FRAMES: usize = 12;
/// Frames of the first robot.
const FIRST: usize = 6;
/// Estimated poses are this good, metres.
const CLOSE: f64 = 0.02;

fn config(data: &Path) -> Config {
    let mut config = tiny_config();
    config.mapper.clock = Clock::PerFrame;
    config.server.data_dir = Some(data.to_owned());
    config
}

/// The walk with a smaller camera of another shape and with a longer focal length.
fn other() -> Robot {
    let camera = Camera::new(240, 160);
    let longer = Camera { fx: camera.fx * 1.2, fy: camera.fy * 1.2, cx: 117.0, ..camera };
    Robot::with(SEED, FRAMES, longer)
}

fn worst(robot: &Robot, acks: &[FrameAck]) -> f64 {
    let frames = acks.iter().filter(|ack| ack.status() != FrameStatus::Opened);
    frames.map(|ack| robot.error(ack, ack.sequence as usize)).fold(0.0, f64::max)
}

async fn json(server: &Server, path: &str) -> Value {
    let reply = reqwest::get(server.url(path)).await.expect("it answers");
    reply.json().await.expect("JSON")
}

/// Columns and rows of a rendered frame.
async fn rendered(server: &Server, frame: usize) -> (u32, u32) {
    let path = format!("/v1/maps/two/render?frame={frame}&channel=color");
    let png = reqwest::get(server.url(&path)).await.expect("it answers").bytes().await;
    let picture = image::load_from_memory(&png.expect("bytes")).expect("a PNG");
    (picture.width(), picture.height())
}

/// The cameras of the keyframes, each once.
async fn widths(server: &Server) -> Vec<u64> {
    let listed = json(server, "/v1/maps/two/frames").await;
    let frames = listed["frames"].as_array().expect("a list");
    let mut widths: Vec<u64> =
        frames.iter().filter_map(|frame| frame["camera"]["width"].as_u64()).collect();
    widths.dedup();
    widths
}

#[tokio::test(flavor = "multi_thread")]
async fn a_second_camera_goes_on_with_the_map_and_a_restart_keeps_both() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let server = Server::start(config(folder.path())).await;
    let (first, second) = (Robot::new(SEED, FRAMES), other());
    let frames = |robot: &Robot, from: usize, to: usize| {
        let frames: Vec<_> = (from..to).map(|at| robot.frame(at)).collect();
        robot.stream_without_poses("two", frames)
    };
    let acks = server.send(frames(&first, 0, FIRST)).await.expect("it opens");
    assert!(worst(&first, &acks) < CLOSE, "{}", worst(&first, &acks));
    let acks = server.send(frames(&second, FIRST, FRAMES)).await.expect("another camera opens it");
    assert_eq!(acks[1].status(), FrameStatus::Relocalised);
    assert!(worst(&second, &acks) < CLOSE, "{}", worst(&second, &acks));
    // Negative control: the error is measured against where the frame was taken.
    assert!(second.error(&acks[1], 0) > CLOSE);
    server.settled("two").await;
    assert_eq!(widths(&server).await, [320, 240]);
    assert_eq!(
        (rendered(&server, 0).await, rendered(&server, FRAMES - 1).await),
        ((320, 240), (240, 160))
    );
    server.stop().await;

    // From the recordings alone: two streams with two cameras.
    let map = folder.path().join("two.map");
    for entry in std::fs::read_dir(&map).expect("its folder").flatten() {
        if entry.path().extension().is_some_and(|extension| extension != "mcap") {
            std::fs::remove_file(entry.path()).expect("a checkpoint can be removed");
        }
    }
    let server = Server::start(config(folder.path())).await;
    server.loaded("two").await;
    server.settled("two").await;
    assert_eq!(widths(&server).await, [320, 240]);
    let status = json(&server, "/v1/maps/two").await;
    assert_eq!(status["frames_tracked"].as_u64(), Some(FRAMES as u64));
    server.stop().await;
}
