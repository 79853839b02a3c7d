//! A robot that does not say where it is walks through a room: the acknowledgements do.

use lexsplat_proto::v1::{self, FrameStatus};
use lexsplat_tests::{Robot, Server, tiny_config};
use std::ops::Range;

const FRAMES: usize = 40;
/// This one is black.
const BLACK: usize = 29;
const AFTER_BLACK: usize = BLACK + 1;
/// Worst error of a pose, metres; worst measured 0.0024 (llvmpipe).
const CLOSE: f64 = 0.01;

#[tokio::test(flavor = "multi_thread")]
async fn poses_are_estimated_where_none_are_given() {
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(7, FRAMES);
    let frames = (0..FRAMES).map(|at| {
        let mut frame = robot.frame(at);
        if at == BLACK {
            let pixels = robot.camera.width * robot.camera.height;
            frame.set_color_format(v1::ColorFormat::Rgb8);
            frame.color = vec![0; 3 * pixels as usize].into();
        }
        frame
    });
    let messages = robot.stream_without_poses("walk", frames);
    let acks = server.send(messages).await.expect("the stream ends well");
    let acks = &acks[1..];
    assert_eq!(acks.len(), FRAMES);
    let mut worst: f64 = 0.0;
    for (at, ack) in acks.iter().enumerate() {
        let status = match at {
            BLACK => FrameStatus::Lost,
            AFTER_BLACK => FrameStatus::Relocalised,
            _ => FrameStatus::Tracked,
        };
        assert_eq!(ack.status(), status, "frame {at}");
        if at != BLACK {
            worst = worst.max(robot.error(ack, at));
        }
    }
    println!("worst {worst:.5} m");
    assert!(worst < CLOSE, "{worst} m");
    let still = robot.error(&acks[FRAMES - 1], 0);
    assert!(still > 10.0 * CLOSE, "the robot has walked: {still} m");
    server.stop().await;
}

/// What a robot without poses sends of some views, after so many frames.
fn part(robot: &Robot, views: Range<usize>, after: usize) -> Vec<v1::FrameMessage> {
    let frames = views.enumerate().map(|(at, view)| {
        let sequence = (after + at) as u64;
        v1::Frame { sequence, timestamp_nanos: sequence * 33_333_333, ..robot.frame(view) }
    });
    robot.stream_without_poses("kept", frames)
}

/// The server is started anew while the robot is carried away: it is found in the map that was kept, and
/// what it says then is in the old map's coordinates.
#[tokio::test(flavor = "multi_thread")]
async fn a_robot_finds_itself_in_a_kept_map() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut config = tiny_config();
    config.server.data_dir = Some(folder.path().to_owned());
    let robot = Robot::new(7, FRAMES);
    let server = Server::start(config.clone()).await;
    let walk = part(&robot, 0..FRAMES, 0);
    server.send(walk).await.expect("the stream ends well");
    server.stop().await;

    let server = Server::start(config).await;
    server.loaded("kept").await;
    let back = 8..20;
    let acks = server.send(part(&robot, back.clone(), FRAMES)).await;
    let acks = acks.expect("the stream ends well");
    assert_eq!(acks[0].received_through, Some(FRAMES as u64 - 1), "the map was kept");
    let mut worst: f64 = 0.0;
    for (at, (ack, view)) in acks[1..].iter().zip(back).enumerate() {
        let status = if at == 0 { FrameStatus::Relocalised } else { FrameStatus::Tracked };
        assert_eq!(ack.status(), status, "frame {at}");
        worst = worst.max(robot.error(ack, view));
    }
    println!("worst {worst:.5} m");
    assert!(worst < CLOSE, "{worst} m");
    let end = robot.error(&acks[1], FRAMES - 1);
    assert!(end > 10.0 * CLOSE, "and not where the walk ended: {end} m");
    server.stop().await;
}
