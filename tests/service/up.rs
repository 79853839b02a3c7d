//! A map knows which direction is up, and its files stand upright.

use lexsplat_proto::v1::{self, FrameStatus, frame_message::Message};
use lexsplat_server::config::Config;
use lexsplat_tests::{Robot, Server, python, said, tiny_config};
use nalgebra::{Isometry3, UnitQuaternion, UnitVector3, Vector3};
use serde_json::Value;
use std::path::Path;
use tonic::Code;

/// Up in the room.
const ROOM_UP: Vector3<f64> = Vector3::new(0.0, 0.0, 1.0);

/// A robot whose poses are in a world that is tilted against the room, and that world's direction up.
fn tilted(seed: u64, frames: usize) -> (Robot, Vector3<f64>) {
    let mut robot = Robot::new(seed, frames);
    let turn = UnitQuaternion::from_euler_angles(0.7, -0.4, 1.1);
    let world_from_room = Isometry3::from_parts(Vector3::new(2.0, 1.0, -3.0).into(), turn);
    for pose in &mut robot.poses {
        *pose = world_from_room * *pose;
    }
    (robot, turn * ROOM_UP)
}

fn wire(vector: Vector3<f64>) -> v1::Vector3 {
    v1::Vector3 { x: vector.x, y: vector.y, z: vector.z }
}

/// The direction up in the status of a map over gRPC, and where it is from.
async fn up(server: &Server, map: &str) -> (Vector3<f64>, String) {
    server.settled(map).await;
    let request = v1::GetMapRequest { name: map.to_owned() };
    let status = server.client().await.get_map(request).await.expect("it is there").into_inner();
    let up = status.up.expect("it has frames");
    let direction = up.direction.expect("a direction");
    (Vector3::new(direction.x, direction.y, direction.z), up.source)
}

/// The status over HTTP.
async fn status(server: &Server, map: &str) -> Value {
    server.loaded(map).await;
    let reply = reqwest::get(server.url(&format!("/v1/maps/{map}"))).await.expect("it answers");
    reply.json::<Value>().await.expect("JSON")["up"].take()
}

fn recorded(folder: &Path) -> Config {
    let mut config = tiny_config();
    config.server.data_dir = Some(folder.to_owned());
    config
}

#[tokio::test(flavor = "multi_thread")]
async fn files_of_a_tilted_map_stand_upright() {
    let (robot, truth) = tilted(5, 16);
    let (data, folder) = (tempfile::tempdir(), tempfile::tempdir().expect("a folder"));
    let data = data.expect("a folder");
    let server = Server::start(recorded(data.path())).await;
    server.stream(&robot, "upright").await;
    let (found, source) = up(&server, "upright").await;
    assert_eq!(source, "floor");
    let off = found.angle(&truth).to_degrees();
    assert!(off < 3.0, "{off} degrees");
    // Negative control: the cameras look down, so their upper sides would mislead.
    let guess: Vector3<f64> = robot.poses.iter().map(|pose| -(pose.rotation * Vector3::y())).sum();
    assert!(guess.angle(&truth).to_degrees() > 5.0, "{}", guess.angle(&truth).to_degrees());
    let files = [
        ("map.ply", "splats.ply"),
        ("z.ply", "splats.ply?up=z"),
        ("y.spz", "splats.spz?up=y"),
        ("y.glb", "splats.glb"),
        ("minus_y_splats.ply", "splats.ply?up=-y"),
        ("minus_y.ply", "mesh.ply?up=-y&voxel_metres=0.05"),
        ("z.tum", "trajectory.tum?up=z"),
    ];
    server.export("upright", folder.path(), &files).await;
    let mut reader = python("tests/outside/upright.py", &["readers", "gsply"]);
    println!("{off:.2} degrees off\n{}", said(reader.arg(folder.path())));
    assert_viewers_agree(folder.path());

    let before = status(&server, "upright").await;
    server.stop().await;
    let server = Server::start(recorded(data.path())).await;
    assert_eq!(status(&server, "upright").await, before, "after a restart, bit for bit");
    server.stop().await;
}

/// Programs that others made for splats and glTF open the files, and they stand upright there.
fn assert_viewers_agree(folder: &Path) {
    let modules = lexsplat_tests::root().join(".deps/viewers/node_modules");
    if !modules.exists() {
        println!(
            "SKIPPED: there is no Node.js, or .deps/viewers is missing (deploy/setup.sh --tests)"
        );
        return;
    }
    println!("{}", said(python("tests/outside/viewers.py", &["readers"]).arg(folder).arg(modules)));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_the_sender_knows_counts_more_than_the_floor() {
    let (robot, truth) = tilted(5, 3);
    let server = Server::start(tiny_config()).await;
    let given = |mut messages: Vec<v1::FrameMessage>, up: Vector3<f64>| {
        if let Some(Message::Open(open)) = &mut messages[0].message {
            open.up = Some(wire(up));
        }
        messages
    };
    // An accelerometer in the camera, disturbed in one frame of three.
    let measured = |at: usize| {
        let push = if at == 1 { Vector3::new(3.0, 0.0, 2.0) } else { Vector3::zeros() };
        let up = robot.poses[at].rotation.inverse() * truth * 9.81 + push;
        v1::Frame { up: Some(wire(up)), ..robot.frame(at) }
    };
    let frames = || (0..3).map(measured);
    // What is said is believed, also where it is wrong.
    let said = UnitVector3::new_normalize(Vector3::new(0.0, 3.0, 4.0)).into_inner();
    let sends = [
        ("given", given(robot.stream("given", frames()), 7.0 * said), said),
        ("gravity", robot.stream("gravity", frames()), truth),
        ("given", given(robot.stream_without_poses("hinted", frames()), said), said),
    ];
    for (source, messages, direction) in sends {
        let Some(Message::Open(open)) = &messages[0].message else { panic!("no opening") };
        let map = open.map.clone();
        server.send(messages).await.expect("the stream ends well");
        let (found, told) = up(&server, &map).await;
        let off = found.angle(&direction).to_degrees();
        assert!(told == source && off < 0.5, "{map}: {told}, {off} degrees");
    }
    // Without a pose or a hint the sender does not know the map's coordinates.
    let blind = (0..3).map(|at| v1::Frame { world_from_camera: None, ..robot.frame(at) });
    let blind = given(robot.stream_without_poses("blind", blind), said);
    server.send(blind).await.expect("the stream ends well");
    let (found, told) = up(&server, "blind").await;
    let truth = robot.poses[0].rotation.inverse() * truth;
    assert_eq!(told, "floor");
    assert!(found.angle(&truth).to_degrees() < 3.0, "{found}");

    let refused = server.send(given(robot.messages("refused"), Vector3::zeros())).await;
    let refused = refused.expect_err("it has no direction");
    assert!(
        refused.code() == Code::InvalidArgument && refused.message().contains("up"),
        "{refused}"
    );
    let nan = v1::Frame { up: Some(wire(Vector3::repeat(f64::NAN))), ..robot.frame(0) };
    let acks = server.send(robot.stream("nan", [nan, robot.frame(1)])).await.expect("it goes on");
    assert_eq!(acks[1].status(), FrameStatus::Refused);
    assert_eq!(acks[1].refused_field, "up");
    assert_eq!(acks[2].status(), FrameStatus::Tracked);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn exports_that_cannot_be_are_refused_with_a_reason() {
    let mut robot = Robot::new(5, 1);
    robot.poses[0].translation.vector += Vector3::new(20_000.0, 0.0, 0.0);
    let server = Server::start(tiny_config()).await;
    server.stream(&robot, "far").await;
    server.settled("far").await;
    for (file, status, field) in [
        ("splats.ply", 200, ""),
        ("splats.glb", 200, ""),
        // 24 bits hold no position 20 km away, whichever way is up.
        ("splats.spz", 409, "file"),
        ("splats.spz?up=z", 409, "file"),
        ("splats.ply?up=north", 400, "up"),
    ] {
        let url = server.url(&format!("/v1/maps/far/export/{file}"));
        let reply = reqwest::get(url).await.expect("it answers");
        assert_eq!(reply.status(), status, "{file}");
        if status != 200 {
            let problem: Value = reply.json().await.expect("JSON");
            assert_eq!(problem["field"], field, "{problem}");
            let detail = problem["detail"].as_str().expect("a reason");
            let reason = if field == "up" { "expected x, y, z" } else { "export splats.ply" };
            assert!(detail.contains(reason), "{detail}");
        }
    }
    let mut client = server.client().await;
    for (format, up, code) in [
        ("splats.spz", "", Code::FailedPrecondition),
        ("splats.ply", "north", Code::InvalidArgument),
    ] {
        let request = v1::ExportRequest {
            map: "far".into(),
            format: format.into(),
            up: up.into(),
            ..Default::default()
        };
        let refused = client.export_map(request).await.expect_err("it is refused");
        assert_eq!(refused.code(), code, "{refused}");
    }
    server.stop().await;
}
