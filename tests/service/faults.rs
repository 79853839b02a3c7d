//! What goes wrong on real robots: frames that are dropped, black, or blurred, and a camera that is carried
//! away. Tracking comes back from each, and what it says then is true.

use lexsplat_proto::v1::{self, FrameStatus};
use lexsplat_tests::{Robot, Server, tiny_config};
use std::ops::Range;

const FRAMES: usize = 230;
const DROPPED: Range<usize> = 50..80;
const BLACK: Range<usize> = 110..130;
const BLURRED: Range<usize> = 160..180;
/// Frames before and after that a blurred one is the mean of.
const SMEAR: usize = 4;
/// Where the camera is carried after the walk, and how far it walks on from there.
const BACK: Range<usize> = 10..25;
/// Frames that recovery may take.
const PATIENCE: usize = 3;
/// Worst error of a believed pose, metres; measured: 0.0026 (llvmpipe).
const CLOSE: f64 = 0.01;

/// A frame that is sent.
struct Sent {
    /// Which of the walk's views.
    view: usize,
    frame: v1::Frame,
}

/// Raw colors of a view instead of its JPEG.
fn with_colors(mut frame: v1::Frame, rgb: Vec<u8>) -> v1::Frame {
    frame.set_color_format(v1::ColorFormat::Rgb8);
    frame.color = rgb.into();
    frame
}

/// The mean of the views around one: what a long exposure shows.
fn blurred(robot: &Robot, at: usize) -> Vec<u8> {
    let around = &robot.views[at - SMEAR..=at + SMEAR];
    let mean = |byte: usize| {
        let sum: usize = around.iter().map(|view| usize::from(view.rgb[byte])).sum();
        (sum / around.len()) as u8
    };
    (0..robot.views[at].rgb.len()).map(mean).collect()
}

/// The walk with its faults, then the jump.
fn walk(robot: &Robot) -> Vec<Sent> {
    let kept = (0..FRAMES).filter(|at| !DROPPED.contains(at));
    let mut sent: Vec<Sent> = kept
        .map(|view| {
            let frame = robot.frame(view);
            let pixels = 3 * (robot.camera.width * robot.camera.height) as usize;
            let frame = match view {
                at if BLACK.contains(&at) => with_colors(frame, vec![0; pixels]),
                at if BLURRED.contains(&at) => with_colors(frame, blurred(robot, at)),
                _ => frame,
            };
            Sent { view, frame }
        })
        .collect();
    for (at, view) in BACK.enumerate() {
        let (mut frame, time) = (robot.frame(view), robot.frame(FRAMES - 1));
        frame.sequence = time.sequence + 1 + at as u64;
        frame.timestamp_nanos = time.timestamp_nanos + 33_333_333 * (1 + at as u64);
        sent.push(Sent { view, frame });
    }
    sent
}

async fn acks(server: &Server, robot: &Robot, frames: Vec<v1::Frame>) -> Vec<v1::FrameAck> {
    let messages = robot.stream_without_poses("faults", frames);
    let mut acks = server.send(messages).await.expect("the stream ends well");
    acks.remove(0);
    acks
}

#[tokio::test(flavor = "multi_thread")]
async fn tracking_comes_back_from_every_fault() {
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(7, FRAMES + SMEAR);
    let sent = walk(&robot);
    let views: Vec<usize> = sent.iter().map(|one| one.view).collect();
    let frames = sent.into_iter().map(|one| one.frame).collect();
    let acks = acks(&server, &robot, frames).await;
    assert_eq!(acks.len(), views.len());
    let mut worst: f64 = 0.0;
    for (at, (ack, view)) in acks.iter().zip(&views).enumerate() {
        let is_back = at >= views.len() - BACK.len();
        let is_lost = ack.status() == FrameStatus::Lost;
        if !is_back && BLACK.contains(view) {
            assert!(is_lost, "frame {at} is black");
            continue;
        }
        let since = |begin: usize| view.checked_sub(begin).is_some_and(|since| since < PATIENCE);
        let recovers = since(DROPPED.end) || since(BLACK.end) || since(BLURRED.end);
        let jumps = is_back && at < views.len() - BACK.len() + PATIENCE;
        if is_lost {
            let may = recovers || jumps || BLURRED.contains(view);
            assert!(may, "frame {at}, view {view}, is lost for no reason");
            continue;
        }
        // A pose that is believed is right, or else the map would be wrong from then on.
        let off = robot.error(ack, *view);
        assert!(off < CLOSE, "frame {at}, view {view}: {off} m");
        worst = worst.max(off);
    }
    println!("worst {worst:.4} m");
    let carried = (robot.poses[FRAMES - 1].translation.vector
        - robot.poses[BACK.start].translation.vector)
        .norm();
    assert!(carried > 10.0 * CLOSE, "the camera was carried: {carried} m");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_place_never_seen_is_not_found() {
    let server = Server::start(tiny_config()).await;
    let (robot, elsewhere) = (Robot::new(7, 120), Robot::new(8, 120));
    let walk = (0..30).map(|at| robot.frame(at));
    let away = (0..10).map(|at| v1::Frame { sequence: 30 + at, ..elsewhere.frame(60) });
    let mut frames: Vec<v1::Frame> = walk.chain(away).collect();
    for (at, frame) in frames.iter_mut().enumerate() {
        frame.timestamp_nanos = at as u64 * 33_333_333;
    }
    let acks = acks(&server, &robot, frames).await;
    assert!(acks[..30].iter().all(|ack| ack.status() == FrameStatus::Tracked));
    let found = acks[30..].iter().filter(|ack| ack.status() != FrameStatus::Lost).count();
    assert_eq!(found, 0, "another room was taken for this one");
    server.stop().await;
}
