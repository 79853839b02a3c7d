//! With the clock `per_frame` the same frames make the same map, however fast they come.

use lexsplat_proto::v1;
use lexsplat_server::pipeline::mapper::Clock;
use lexsplat_tests::{Robot, Server, tiny_config};
use std::time::Duration;

const FRAMES: usize = 12;

/// The map that a robot's walk makes, frames coming so long after each other, readers getting it so often.
async fn map_of(robot: &Robot, pause: Duration, snapshot_seconds: f64) -> Vec<[f32; 3]> {
    let mut config = tiny_config();
    config.mapper.clock = Clock::PerFrame;
    config.mapper.snapshot_seconds = snapshot_seconds;
    let server = Server::start(config).await;
    let mut messages: Vec<v1::FrameMessage> = robot.messages("clock");
    messages.truncate(1 + FRAMES);
    for message in messages.drain(1..).collect::<Vec<_>>() {
        let acks = server.send(vec![robot.open("clock"), message]).await.expect("it is mapped");
        assert_eq!(acks[1].status(), v1::FrameStatus::Tracked);
        tokio::time::sleep(pause).await;
    }
    server.settled("clock").await;
    let snapshot = server.engine.map("clock").expect("it is there").snapshot().await;
    let gaussians = &snapshot.gaussians;
    let codes = gaussians.language.features.chunks_exact(3).map(|code| [code[0], code[1], code[2]]);
    let made = gaussians.means.iter().copied().chain(codes).collect();
    server.stop().await;
    made
}

#[tokio::test(flavor = "multi_thread")]
async fn the_same_frames_make_the_same_map() {
    let robot = Robot::new(7, FRAMES);
    let fast = map_of(&robot, Duration::ZERO, 0.0).await;
    let slow = map_of(&robot, Duration::from_millis(150), 1e6).await;
    assert!(!fast.is_empty());
    assert_eq!(fast, slow, "bit for bit");
    let other = map_of(&Robot::new(8, FRAMES), Duration::ZERO, 0.0).await;
    assert_ne!(fast, other, "another room is another map");
}
