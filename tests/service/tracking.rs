//! A robot that does not say where it is walks through a room: the acknowledgements do.

use lexsplat_proto::v1::{self, FrameStatus, frame_message::Message};
use lexsplat_tests::{Robot, Server, tiny_config};
use nalgebra::{Isometry3, Point3};

const FRAMES: usize = 40;
/// Worst error of a pose, metres; worst measured 0.0024 (llvmpipe).
const CLOSE: f64 = 0.01;

/// Metres between where a frame was taken and where its acknowledgement says.
fn error(ack: &v1::FrameAck, wanted: &Isometry3<f64>) -> f64 {
    let found = ack.world_from_camera.as_ref().and_then(|pose| pose.translation_metres);
    found.map_or(f64::INFINITY, |at| {
        nalgebra::distance(&Point3::new(at.x, at.y, at.z), &wanted.translation.vector.into())
    })
}

#[tokio::test(flavor = "multi_thread")]
async fn poses_are_estimated_where_none_are_given() {
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(7, FRAMES);
    let mut messages = robot.messages("walk");
    let mut frames = 0;
    for message in &mut messages {
        match &mut message.message {
            Some(Message::Open(open)) => open.set_pose_source(v1::PoseSource::Estimated),
            Some(Message::Frame(frame)) => {
                frames += 1;
                if frames > 1 {
                    frame.world_from_camera = None;
                }
                // One black frame on the way.
                if frames == 30 {
                    frame.set_color_format(v1::ColorFormat::Rgb8);
                    let pixels = robot.camera.width * robot.camera.height;
                    frame.color = vec![0; 3 * pixels as usize].into();
                }
            }
            None => {}
        }
    }
    let acks = server.send(messages).await.expect("the stream ends well");
    let acks = &acks[1..];
    assert_eq!(acks.len(), FRAMES);
    let mut worst: f64 = 0.0;
    for (at, (ack, wanted)) in acks.iter().zip(&robot.poses).enumerate() {
        let status = match at {
            29 => FrameStatus::Lost,
            30 => FrameStatus::Relocalised,
            _ => FrameStatus::Tracked,
        };
        assert_eq!(ack.status(), status, "frame {at}");
        if at != 29 {
            worst = worst.max(error(ack, wanted));
        }
    }
    println!("worst {worst:.5} m");
    assert!(worst < CLOSE, "{worst} m");
    let still = error(&acks[FRAMES - 1], &robot.poses[0]);
    assert!(still > 10.0 * CLOSE, "the robot has walked: {still} m");
    server.stop().await;
}

/// What a robot without poses sends of some views, after so many frames.
fn without_poses(robot: &Robot, views: Vec<usize>, after: usize) -> Vec<v1::FrameMessage> {
    let mut open = robot.open("kept");
    if let Some(Message::Open(open)) = &mut open.message {
        open.set_pose_source(v1::PoseSource::Estimated);
    }
    let frames = views.into_iter().enumerate().map(|(at, view)| {
        let mut frame = robot.frame(view);
        frame.sequence = (after + at) as u64;
        frame.timestamp_nanos = frame.sequence * 33_333_333;
        if frame.sequence > 0 {
            frame.world_from_camera = None;
        }
        v1::FrameMessage { message: Some(Message::Frame(frame)) }
    });
    std::iter::once(open).chain(frames).collect()
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
    let walk = without_poses(&robot, (0..FRAMES).collect(), 0);
    server.send(walk).await.expect("the stream ends well");
    server.stop().await;

    let server = Server::start(config).await;
    let back: Vec<usize> = (8..20).collect();
    let acks = server.send(without_poses(&robot, back.clone(), FRAMES)).await;
    let acks = acks.expect("the stream ends well");
    assert_eq!(acks[0].received_through, Some(FRAMES as u64 - 1), "the map was kept");
    let mut worst: f64 = 0.0;
    for (at, (ack, view)) in acks[1..].iter().zip(back).enumerate() {
        let status = if at == 0 { FrameStatus::Relocalised } else { FrameStatus::Tracked };
        assert_eq!(ack.status(), status, "frame {at}");
        worst = worst.max(error(ack, &robot.poses[view]));
    }
    println!("worst {worst:.5} m");
    assert!(worst < CLOSE, "{worst} m");
    let end = error(&acks[1], &robot.poses[FRAMES - 1]);
    assert!(end > 10.0 * CLOSE, "and not where the walk ended: {end} m");
    server.stop().await;
}
