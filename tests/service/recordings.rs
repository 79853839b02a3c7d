//! Recordings that outside libraries wrote are mapped, and lexsplat's own are mapped again.

use lexsplat_client::Access;
use lexsplat_client::bags;
use lexsplat_client::dataset::{Dataset, DatasetError, DepthCamera, Distortion, inspect};
use lexsplat_client::rig::Wanted;
use lexsplat_client::stream::{Encoder, Poses, StreamOptions, stream};
use lexsplat_synthetic as synthetic;
use lexsplat_tests::{Robot, Server, python, said, tiny_config};
use nalgebra::{Isometry3, Vector3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const FRAMES: usize = 16;
const SEED: u64 = 5;
/// Poses are interpolated between those of the recording; metres and radians of the worst frame: 0.6 mm and
/// 0.03 degrees were measured.
const CLOSE: [f64; 2] = [0.003, 0.004];
/// A map that is made of wrong depth.
const WRONG: &str = "wrong";
/// The worst estimated pose, metres; 3 mm were measured, and 80 cm with depth taken to be registered.
const ESTIMATED: f64 = 0.02;

/// Kind, file or folder, and whether it is a bag of ROS 2.
const RECORDINGS: [(&str, &str, bool); 5] = [
    ("db3", "db3", true),
    ("mcap", "bag", true),
    ("ros2", "ros2.mcap", false),
    ("protobuf", "protobuf.mcap", false),
    ("json", "json.mcap", false),
];

fn write(room: &Path, out: &Path, kind: &str) {
    said(python("tests/outside/bags.py", &["bags"]).args([room, out]).arg(kind));
}

fn open(path: &Path, is_bag: bool, wanted: &str) -> Result<Box<dyn Dataset>, DatasetError> {
    let wanted = Wanted::parse(wanted).expect("the options are right");
    if is_bag { bags::rosbag2(path, &wanted) } else { bags::mcap(path, &wanted) }
}

/// The worst distance in metres and radians between two paths, which begin at the same place.
fn apart(found: &[Isometry3<f64>], truth: &[Isometry3<f64>]) -> [f64; 2] {
    let from_first = |path: &[Isometry3<f64>], at: usize| path[0].inverse() * path[at];
    let differences =
        (0..found.len()).map(|at| from_first(found, at).inverse() * from_first(truth, at));
    differences.fold([0.0, 0.0], |[metres, radians], one| {
        [one.translation.vector.norm().max(metres), one.rotation.angle().max(radians)]
    })
}

fn is_close([metres, radians]: [f64; 2]) -> bool {
    metres < CLOSE[0] && radians < CLOSE[1]
}

async fn map(
    server: &Server,
    dataset: Box<dyn Dataset>,
    map: &str,
    poses: Poses,
) -> Vec<Isometry3<f64>> {
    let options = StreamOptions {
        grpc: server.grpc.clone(),
        access: Access::default(),
        map: map.into(),
        poses,
        encoder: Encoder::Bundle,
        hold_out_every: None,
        realtime: false,
    };
    let summary = stream(Arc::from(dataset), &options, |_| {}).await.expect("it is streamed");
    assert_eq!((summary.sent, summary.left_out), (FRAMES as u64, 0), "{map}: {summary:?}");
    if map != WRONG {
        assert_eq!(summary.tracked, FRAMES as u64, "{map}: {summary:?}");
        assert!(summary.input_warnings.is_empty(), "{map}: {:?}", summary.input_warnings);
        assert!(summary.keyframes.len() > 1, "{map}: {summary:?}");
    }
    server.settled(map).await;
    let snapshot = server.engine.map(map).expect("it is there").snapshot().await;
    snapshot.trajectory.iter().map(|frame| frame.world_from_camera).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn recordings_of_other_programs_are_mapped() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let room = folder.path().join("room");
    let camera = synthetic::Camera::new(160, 120);
    let plan = synthetic::Plan { seed: SEED, frames: FRAMES, every: 1, camera };
    synthetic::write(&room, &plan, |_| {}).expect("the room can be written");
    let truth = Robot::with(SEED, FRAMES, camera).poses;
    let server = Server::start(tiny_config()).await;
    for (kind, name, is_bag) in RECORDINGS {
        let path = folder.path().join(name);
        write(&room, &path, kind);
        let dataset = open(&path, is_bag, "").unwrap_or_else(|error| panic!("{kind}: {error}"));
        assert_eq!((dataset.len(), dataset.skipped()), (FRAMES, &[][..]), "{kind}");
        check(&*dataset, kind);
        let found = map(&server, dataset, kind, Poses::Given).await;
        let apart = apart(&found, &truth);
        println!("{kind}: {:.2} mm, {:.3} degrees", apart[0] * 1e3, apart[1].to_degrees());
        assert!(is_close(apart), "{kind}: {apart:?}");
    }
    server.stop().await;

    let wrong = |name: &str, wanted: &str| {
        let error = open(&folder.path().join(name), true, wanted).err().expect("it is refused");
        error.to_string()
    };
    for (name, wanted, expected) in [
        ("db3", "color=/nope", "color=/nope: expected a topic with color pictures (/camera/color"),
        (
            "db3",
            "depth=/camera/color/image_raw",
            "expected a topic with depth pictures (/camera/al",
        ),
        ("db3", "world=moon", "world=moon: expected a frame above camera_color_optical_frame ("),
        ("bag", "info=/odom", "info=/odom: expected a topic with calibrations (/rgb/camera_info"),
        ("bag", "pose=/nope", "expected none, or a topic with transforms or poses (/odom, /tf"),
    ] {
        assert!(wrong(name, wanted).contains(expected), "{}", wrong(name, wanted));
    }
    // Negative control: in the robot's own coordinates the camera stands still.
    let still = open(&folder.path().join("db3"), true, "world=base_link").expect("it is a world");
    let poses = (0..FRAMES).map(|at| still.moment(at).expect("it is known").world_from_camera);
    assert!(!is_close(apart(
        &poses.map(|pose| pose.expect("there is one")).collect::<Vec<_>>(),
        &truth
    )));
}

/// What is special about a recording.
fn check(dataset: &dyn Dataset, kind: &str) {
    let notes = dataset.notes().join("\n");
    let frame = dataset.frame(3).expect("it can be read");
    match kind {
        "db3" => {
            assert!(notes.contains("color is /camera/color/image_raw (160x120"), "{notes}");
            assert!(notes.contains("depth is registered to color (/camera/aligned"), "{notes}");
            assert!(notes.contains("left aside: /camera/depth/image_rect_raw, /camera/infra1"));
            let depth = frame.extras.depth_timestamp_nanos.expect("depth was taken later");
            assert_eq!(depth - frame.timestamp_nanos, 3_000_000);
            assert_eq!(dataset.cameras().up, Some([0.0, 0.0, 1.0]));
        }
        "mcap" => {
            assert!(notes.contains("poses are those of base_link in odom (/odom)"), "{notes}");
            assert_eq!(dataset.cameras().up, Some([0.0, 0.0, 1.0]));
        }
        "ros2" | "json" => {
            assert!(notes.contains("taken as the color camera's"), "{notes}");
            assert_eq!(dataset.cameras().up, None, "nobody says so");
        }
        _ => assert!(notes.contains("poses are those of camera in world"), "{notes}"),
    }
    assert!(dataset.cameras().are_registered());
    if kind != "db3" {
        assert_eq!(frame.extras.depth_timestamp_nanos, None);
    }
}

/// Where the depth camera is beside the color camera: 5 cm to the right, and turned by 2 degrees.
fn color_from_depth() -> Isometry3<f64> {
    Isometry3::new(Vector3::new(0.05, 0.002, -0.003), Vector3::new(0.01, 0.035, 0.0))
}

/// What the depth camera of a walk sees, with room around it.
fn write_depth(folder: &Path, walk: &Robot) {
    let camera =
        synthetic::Camera { width: 200, height: 150, fx: 84.0, fy: 84.0, cx: 100.0, cy: 74.0 };
    std::fs::create_dir_all(folder).expect("it can be made");
    for (frame, pose) in walk.poses.iter().enumerate() {
        let view = walk.room.render(&camera, &(pose * color_from_depth()));
        let png = synthetic::depth_png(&view).expect("it encodes");
        std::fs::write(folder.join(format!("depth{frame:06}.png")), png).expect("it is written");
    }
    let pose = color_from_depth().to_homogeneous().transpose();
    let synthetic::Camera { width: w, height: h, fx, fy, cx, cy } = camera;
    let described = serde_json::json!({
        "camera": {"w": w, "h": h, "fx": fx, "fy": fy, "cx": cx, "cy": cy, "scale": 6553.5},
        "color_from_depth": pose.as_slice(),
    });
    std::fs::write(folder.join("camera.json"), described.to_string()).expect("it is written");
}

/// Two cameras with lenses, as a RealSense without alignment has them: the server removes distortion and
/// registers depth.
#[tokio::test(flavor = "multi_thread")]
async fn a_depth_camera_of_its_own_is_mapped() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let (room, path) = (folder.path().join("room"), folder.path().join("lenses"));
    let narrow = synthetic::Camera::new(160, 120);
    // The same focal length and more pixels on each side.
    let camera = synthetic::Camera { width: 240, height: 180, cx: 119.5, cy: 89.5, ..narrow };
    let plan = synthetic::Plan { seed: SEED, frames: FRAMES, every: 1, camera };
    synthetic::write(&room, &plan, |_| {}).expect("the room can be written");
    let walk = Robot::with(SEED, FRAMES, camera);
    write_depth(&room.join("depth"), &walk);
    write(&room, &path, "lenses");
    let dataset = open(&path, true, "").expect("it is read");
    let cameras = dataset.cameras();
    let brown = Distortion::BrownConrady(vec![-0.12, 0.02, 0.001, -0.002, 0.0]);
    assert_eq!(cameras.color.distortion, brown);
    let Some(DepthCamera::Own { camera, color_from_depth: found }) = cameras.depth else {
        panic!("{:?}", cameras.depth)
    };
    assert_eq!(camera.distortion, Distortion::KannalaBrandt([0.02, -0.01, 0.0, 0.0]));
    let difference = found.inverse() * color_from_depth();
    assert!(difference.translation.vector.norm() < 1e-9 && difference.rotation.angle() < 1e-9);

    let mut config = tiny_config();
    config.server.data_dir = Some(folder.path().join("data"));
    let server = Server::start(config).await;
    let given = map(&server, dataset, "given", Poses::Given).await;
    assert!(is_close(apart(&given, &walk.poses)));
    // What the server recorded is the same again, cameras too.
    let (sent, recorded) = (open(&path, true, ""), folder.path().join("data/given.map/0001.mcap"));
    let (sent, recorded) = (sent.expect("it is read"), open(&recorded, false, ""));
    let recorded = recorded.expect("it is read");
    assert_eq!((recorded.len(), recorded.cameras()), (FRAMES, sent.cameras()));
    let frame = |dataset: &dyn Dataset| dataset.frame(3).expect("it can be read");
    let [sent, found] = [&sent, &recorded].map(|one| frame(&**one));
    assert_eq!((&sent.color, &sent.depth), (&found.color, &found.depth));
    assert_eq!((sent.timestamp_nanos, sent.extras), (found.timestamp_nanos, found.extras));
    let mut errors = Vec::new();
    for (name, wanted) in [("estimated", ""), (WRONG, "registered=yes")] {
        let dataset = open(&path, true, wanted).expect("it is read");
        let found = map(&server, dataset, name, Poses::Estimate).await;
        errors.push(apart(&found, &walk.poses)[0]);
    }
    println!("two cameras: {:.2} mm; taken as one: {:.2} mm", errors[0] * 1e3, errors[1] * 1e3);
    server.stop().await;
    assert!(errors[0] < ESTIMATED, "{errors:?}");
    // Negative control: the same depth, taken to be registered.
    assert!(errors[1] > 2.0 * errors[0], "{errors:?}");
}

fn recorded(folder: &Path) -> PathBuf {
    folder.join("recorded.map/0001.mcap")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_of_the_server_is_mapped_again() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let mut config = tiny_config();
    config.server.data_dir = Some(folder.path().to_owned());
    let server = Server::start(config).await;
    let robot = Robot::new(7, FRAMES);
    server.stream(&robot, "recorded").await;
    server.stop().await;
    let dataset = open(&recorded(folder.path()), false, "").expect("it is read");
    assert_eq!((dataset.len(), dataset.skipped()), (FRAMES, &[][..]));
    let sent = robot.frame(5);
    let read = dataset.frame(5).expect("it can be read");
    assert_eq!((read.sequence, read.timestamp_nanos), (sent.sequence, sent.timestamp_nanos));
    assert_eq!((&read.color.bytes[..], &read.depth.bytes[..]), (&sent.color[..], &sent.depth[..]));
    assert_eq!(inspect(&*dataset, |_| ()).readable, FRAMES);
    let again = Server::start(tiny_config()).await;
    let found = map(&again, dataset, "again", Poses::Given).await;
    assert!(is_close(apart(&found, &robot.poses)));
    again.stop().await;

    // A file that ends in the middle of a frame is read up to there, and says so.
    let whole = std::fs::read(recorded(folder.path())).expect("it is there");
    let cut = folder.path().join("cut.mcap");
    std::fs::write(&cut, &whole[..whole.len() * 2 / 3]).expect("it can be written");
    let cut = open(&cut, false, "").expect("it is read as far as it goes");
    assert!((4..FRAMES).contains(&cut.len()), "{}", cut.len());
    assert!(cut.notes().iter().any(|note| note.contains("cut off")), "{:?}", cut.notes());
}
