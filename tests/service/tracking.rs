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
