//! A map with little memory: it keeps to its budgets, goes on tracking and answering, and forgets nothing
//! but pictures.

use lexsplat_proto::v1::FrameStatus;
use lexsplat_server::pipeline::map::MapStatus;
use lexsplat_server::pipeline::snapshot::MapSnapshot;
use lexsplat_tests::{Robot, Server, tiny_config};
use std::sync::Arc;

const FRAMES: usize = 60;
const KEYFRAME_MIB: u64 = 10;
const GAUSSIANS: usize = 3000;
/// Worst error of a pose, metres; measured 0.0003 (llvmpipe).
const CLOSE: f64 = 0.01;

/// What a map has become after the walk.
struct Walked {
    status: MapStatus,
    snapshot: Arc<MapSnapshot>,
    /// Of what the first frame shows, found there.
    found: usize,
    /// Worst distance of a frame of the trajectory from where it was taken, metres.
    worst: f64,
}

/// A walk without poses on a server with these budgets; what is asked for is in the first frame.
async fn walk(
    robot: &Robot,
    things: &[(&'static str, usize)],
    budgets: Option<(u64, usize)>,
) -> Walked {
    let mut config = tiny_config();
    if let Some((mib, gaussians)) = budgets {
        config.mapper.max_keyframe_mib = mib;
        config.mapper.max_gaussians = gaussians;
    }
    let server = Server::start(config).await;
    let frames = (0..FRAMES).map(|at| robot.frame(at));
    let messages = robot.stream_without_poses("small", frames);
    let acks = server.send(messages).await.expect("the stream ends well");
    for (at, ack) in acks[1..].iter().enumerate() {
        assert_eq!(ack.status(), FrameStatus::Tracked, "frame {at}");
    }
    server.settled("small").await;
    let map = server.engine.map("small").expect("it is there");
    let snapshot = map.snapshot().await;
    let found = server.found(robot, &snapshot, things).await.len();
    let distance = |(at, frame): (usize, &nalgebra::Isometry3<f64>)| {
        (frame.translation.vector - robot.poses[at].translation.vector).norm()
    };
    let poses = snapshot.trajectory.iter().map(|frame| &frame.world_from_camera);
    let worst = poses.enumerate().map(distance).fold(0.0, f64::max);
    let status = map.status();
    server.stop().await;
    Walked { status, snapshot, found, worst }
}

#[tokio::test(flavor = "multi_thread")]
async fn budgets_are_kept_and_nothing_else_is_lost() {
    let robot = Robot::new(7, FRAMES);
    let mut classes: Vec<&str> = robot.room.instances().iter().map(|thing| thing.class).collect();
    classes.sort_unstable();
    classes.dedup();
    let is_large = |class: &&str| robot.pixels_of(0, class) > 1500;
    let things: Vec<(&'static str, usize)> =
        classes.into_iter().filter(is_large).map(|class| (class, 0)).collect();
    assert!(things.len() >= 3, "too little is visible to say anything: {things:?}");

    let free = walk(&robot, &things, None).await;
    let kept = walk(&robot, &things, Some((KEYFRAME_MIB, GAUSSIANS))).await;
    for (name, walked) in [("free", &free), ("kept", &kept)] {
        println!(
            "{name}: {} keyframes, {:.1} MiB, {} Gaussians, found {} of {}, worst {:.4} m",
            walked.status.keyframes,
            walked.status.keyframe_bytes as f64 / 2f64.powi(20),
            walked.status.gaussians,
            walked.found,
            things.len(),
            walked.worst,
        );
    }
    let limit = KEYFRAME_MIB << 20;
    assert!(free.status.keyframe_bytes > 2 * limit, "nothing would be tested");
    assert!(free.status.gaussians > GAUSSIANS as u64, "nothing would be tested");
    assert!(kept.status.keyframe_bytes <= limit, "{:?}", kept.status);
    assert!(kept.status.keyframe_bytes > limit / 2, "and they are used: {:?}", kept.status);
    assert!(kept.status.gaussians <= GAUSSIANS as u64, "{:?}", kept.status);

    // Every frame's place is still known, those of keyframes that were let go too.
    assert_eq!(kept.snapshot.trajectory.len(), FRAMES);
    assert!(free.worst < CLOSE, "{} m", free.worst);
    assert!(kept.worst < CLOSE, "{} m", kept.worst);
    let is_kept = |sequence| kept.snapshot.keyframes.iter().any(|kf| kf.frame.sequence == sequence);
    let forgotten = free.snapshot.keyframes.iter().find(|kf| !is_kept(kf.frame.sequence));
    let forgotten = forgotten.expect("some went").frame.sequence;
    assert!(kept.snapshot.tracked(forgotten).is_some());
    assert!(kept.found + 1 >= free.found, "{} and {} of {things:?}", kept.found, free.found);
}
