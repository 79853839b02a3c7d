//! Topics that are put together, and those that cannot be.

use super::track::Track;
use super::tree::Tree;
use super::{Rig, RigError, Survey, Wanted, frame_pictures, pair, window};
use crate::dataset::{DepthCamera, DepthFormat};
use crate::messages::{
    Calibration, Decoder, Gravity, Picture, Pixels, Posed, Reading, Region, Transform,
};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::borrow::Cow;

const SECOND: u64 = 1_000_000_000;

fn at(x: f64) -> Isometry3<f64> {
    Translation3::new(x, 0.0, 0.0).into()
}

fn transform(parent: &str, child: &str, nanos: u64, pose: Isometry3<f64>) -> Transform {
    Transform { nanos, parent: parent.into(), child: child.into(), parent_from_child: pose }
}

fn tf(topic: &str, survey: &mut Survey, all: Vec<Transform>) {
    survey.add(topic, Decoder::of("cdr", "tf2_msgs/msg/TFMessage").unwrap());
    survey.take(topic, Reading::Transforms(all));
}

fn raw(encoding: &str, frame_id: &str, (width, height): (u32, u32)) -> Picture<'static> {
    let bytes = match encoding {
        "rgb8" => 3,
        "16UC1" => 2,
        _ => 1,
    };
    let pixels = Pixels::Raw {
        width,
        height,
        encoding: encoding.into(),
        step: 0,
        is_big_endian: false,
        data: Cow::Owned(vec![7; (width * height * bytes) as usize]),
    };
    Picture { nanos: SECOND, frame_id: frame_id.into(), pixels }
}

fn pictures(survey: &mut Survey, topic: &str, picture: Picture<'static>) {
    survey.add(topic, Decoder::of("cdr", "sensor_msgs/msg/Image").unwrap());
    for _ in 0..10 {
        survey.take(topic, Reading::Picture(picture.clone()));
    }
}

fn info(survey: &mut Survey, topic: &str, frame_id: &str, (width, height): (u32, u32), focal: f64) {
    let (cx, cy) = (f64::from(width - 1) / 2.0, f64::from(height - 1) / 2.0);
    let k = [focal, 0.0, cx, 0.0, focal, cy, 0.0, 0.0, 1.0];
    let calibration = Calibration {
        frame_id: frame_id.into(),
        width,
        height,
        distortion_model: "plumb_bob".into(),
        d: vec![0.1, 0.0, 0.0, 0.0, 0.0],
        k,
        p: [0.0; 12],
        binning: [1, 1],
        region: Region::default(),
    };
    survey.add(topic, Decoder::of("cdr", "sensor_msgs/msg/CameraInfo").unwrap());
    survey.take(topic, Reading::Calibration(calibration));
}

const BIG: (u32, u32) = (64, 48);
const SMALL: (u32, u32) = (32, 24);

/// A RealSense without alignment on a robot that moves one metre a second along x of its odometry.
fn robot() -> Survey {
    let mut survey = Survey::default();
    pictures(&mut survey, "/cam/color/image_raw", raw("rgb8", "color", BIG));
    pictures(&mut survey, "/cam/depth/image_rect_raw", raw("16UC1", "depth", SMALL));
    pictures(&mut survey, "/cam/infra1/image_rect_raw", raw("mono8", "depth", SMALL));
    info(&mut survey, "/cam/color/camera_info", "color", BIG, 50.0);
    info(&mut survey, "/cam/depth/camera_info", "depth", SMALL, 30.0);
    let fixed = vec![
        transform("base", "link", 0, at(0.1)),
        transform("link", "color", 0, at(0.02)),
        transform("link", "depth", 0, at(0.005)),
    ];
    tf("/tf_static", &mut survey, fixed);
    for half in 0..5 {
        let moved = at(half as f64 / 2.0);
        tf("/tf", &mut survey, vec![transform("odom", "base", half * SECOND / 2, moved)]);
    }
    survey
}

fn wanted(text: &str) -> Wanted {
    Wanted::parse(text).unwrap()
}

fn x(rig: &Rig, nanos: u64) -> f64 {
    rig.pose_at(nanos).unwrap().translation.x
}

#[test]
fn a_robot_is_put_together() {
    let rig = Rig::of(&robot(), &Wanted::default()).unwrap();
    assert_eq!(rig.color_topic(), "/cam/color/image_raw");
    assert_eq!(rig.depth_topic(), "/cam/depth/image_rect_raw");
    let cameras = rig.cameras();
    assert_eq!(cameras.up, Some([0.0, 0.0, 1.0]));
    let Some(DepthCamera::Own { camera, color_from_depth }) = &cameras.depth else {
        panic!("{:?}", cameras.depth)
    };
    assert_eq!((camera.intrinsics.fx, camera.intrinsics.width), (30.0, 32));
    assert!((color_from_depth.translation.x + 0.015).abs() < 1e-12, "{color_from_depth}");
    // Between two transforms, before the first and long after the last.
    assert!((x(&rig, SECOND * 3 / 4) - (0.75 + 0.12)).abs() < 1e-9);
    assert_eq!((rig.poses_reach(2 * SECOND), rig.poses_reach(2 * SECOND + 1)), (true, false));
    let error = rig.pose_at(3 * SECOND).unwrap_err();
    assert!(error.contains("no transform from base to odom near 3.000 s"), "{error}");

    let (color, depth) = (raw("rgb8", "color", BIG), raw("16UC1", "depth", SMALL));
    let late = Picture { nanos: SECOND + 2_000_000, ..depth.clone() };
    let shot = rig.shot(3, color.nanos, late.nanos);
    assert_eq!((shot.sequence, shot.nanos), (3, SECOND));
    assert_eq!(shot.extras.depth_timestamp_nanos, Some(SECOND + 2_000_000));
    assert_eq!(frame_pictures(cameras, &color, &depth).unwrap().1.format, DepthFormat::U16);
    assert!((shot.world_from_camera.unwrap().translation.x - 1.12).abs() < 1e-9);
    assert_eq!(rig.shot(3, color.nanos, depth.nanos).extras.depth_timestamp_nanos, None);
    let big = raw("16UC1", "depth", BIG);
    let error = frame_pictures(cameras, &color, &big).unwrap_err().to_string();
    assert_eq!(error, "depth: expected 32x24 pixels, found 64x48");
}

#[test]
fn one_calibration_of_both_pictures_is_told_of_once() {
    let mut survey = Survey::default();
    pictures(&mut survey, "/cam/rgb", raw("rgb8", "color", BIG));
    pictures(&mut survey, "/cam/depth", raw("16UC1", "color", BIG));
    info(&mut survey, "/cam/camera_info", "color", (128, 96), 100.0);
    let rig = Rig::of(&survey, &Wanted::default()).unwrap();
    let told = rig.notes().iter().filter(|note| note.contains("is scaled to 64x48"));
    assert_eq!(told.count(), 1, "{:?}", rig.notes());
}

#[test]
fn a_frame_that_is_not_there_is_refused_although_transforms_need_none() {
    let error = Rig::of(&robot(), &wanted("pose_frame=nope")).unwrap_err().to_string();
    let expected =
        "pose_frame=nope: expected the camera's frame or one above it (color, link, base, odom)";
    assert_eq!(error, expected);
    Rig::of(&robot(), &wanted("pose_frame=base")).expect("negative control");
}

#[test]
fn later_messages_move_the_robot_on() {
    let mut rig = Rig::of(&robot(), &Wanted::default()).unwrap();
    let later = vec![transform("odom", "base", 5 * SECOND / 2, at(7.0))];
    rig.take("/tf", Reading::Transforms(later));
    assert!((x(&rig, 5 * SECOND / 2) - 7.12).abs() < 1e-9);
    assert!((x(&rig, 0) - 0.12).abs() < 1e-9);
    rig.forget_before(2 * SECOND);
    // Odometry that is not used says nothing.
    let mut survey = robot();
    survey.add("/odom", Decoder::of("cdr", "nav_msgs/msg/Odometry").unwrap());
    let mut other = Rig::of(&survey, &Wanted::default()).unwrap();
    let drifted = vec![transform("odom", "base", 3 * SECOND / 2, at(99.0))];
    other.take("/odom", Reading::Transforms(drifted));
    assert!((x(&other, 3 * SECOND / 2) - 1.62).abs() < 1e-9);
    assert!((x(&rig, 5 * SECOND / 2) - 7.12).abs() < 1e-9);
    assert!(rig.pose_at(0).is_err(), "it is forgotten");
}

#[test]
fn aligned_depth_is_preferred_and_registered() {
    let mut survey = robot();
    pictures(&mut survey, "/cam/aligned_depth_to_color/image_raw", raw("16UC1", "color", BIG));
    info(&mut survey, "/cam/aligned_depth_to_color/camera_info", "color", BIG, 50.0);
    let rig = Rig::of(&survey, &Wanted::default()).unwrap();
    assert_eq!(rig.depth_topic(), "/cam/aligned_depth_to_color/image_raw");
    assert_eq!(rig.cameras().depth, None);
    let aside = rig.notes().last().unwrap();
    assert_eq!(aside, "left aside: /cam/depth/image_rect_raw, /cam/infra1/image_rect_raw");
    // The other topics, if they are wanted.
    let rig = Rig::of(&survey, &wanted("depth=/cam/depth/image_rect_raw")).unwrap();
    assert!(matches!(rig.cameras().depth, Some(DepthCamera::Own { .. })));
    let rig = Rig::of(&survey, &wanted("depth=/cam/depth/image_rect_raw&registered=yes")).unwrap();
    assert_eq!(rig.cameras().depth, Some(DepthCamera::SameLens { width: 32, height: 24 }));
    let rig = Rig::of(&survey, &wanted("color=/cam/infra1/image_rect_raw")).unwrap();
    assert_eq!(rig.depth_topic(), "/cam/depth/image_rect_raw", "of the same camera");
    assert_eq!(rig.cameras().depth, None, "both are of one lens");
}

#[test]
fn depth_is_that_of_the_chosen_camera() {
    let mut survey = Survey::default();
    for side in ["left", "right"] {
        let frame = format!("{side}_optical");
        for (part, encoding) in [("color", "rgb8"), ("depth", "16UC1")] {
            pictures(&mut survey, &format!("/{side}/{part}/image_raw"), raw(encoding, &frame, BIG));
            info(&mut survey, &format!("/{side}/{part}/camera_info"), &frame, BIG, 50.0);
        }
    }
    for side in ["left", "right"] {
        let rig = Rig::of(&survey, &wanted(&format!("color=/{side}/color/image_raw"))).unwrap();
        assert_eq!(rig.depth_topic(), format!("/{side}/depth/image_raw"));
    }
    // Depth that was aligned to another camera is not registered to this one.
    let mut survey = robot();
    pictures(&mut survey, "/cam/aligned_depth_to_color/image_raw", raw("16UC1", "color", SMALL));
    info(&mut survey, "/cam/aligned_depth_to_color/camera_info", "color", SMALL, 50.0);
    let rig = Rig::of(&survey, &wanted("color=/cam/infra1/image_rect_raw")).unwrap();
    assert_eq!(rig.depth_topic(), "/cam/depth/image_rect_raw");
    let aligned = "color=/cam/infra1/image_rect_raw&depth=/cam/aligned_depth_to_color/image_raw";
    let rig = Rig::of(&survey, &wanted(aligned)).unwrap();
    assert!(matches!(rig.cameras().depth, Some(DepthCamera::Own { .. })));
}

#[test]
fn what_is_missing_is_told() {
    let mut survey = Survey::default();
    let missing = |survey: &Survey, expected: &str| {
        let error = Rig::of(survey, &Wanted::default()).unwrap_err();
        assert!(matches!(error, RigError::Missing { .. }));
        assert!(error.to_string().contains(expected), "{error}");
    };
    missing(&survey, "a topic with color pictures, found no topic that can be read");
    pictures(&mut survey, "/nothing", raw("rgb8", "color", (0, 0)));
    missing(&survey, "found /nothing (sensor_msgs/msg/Image: it has no pixels)");
    survey = Survey::default();
    pictures(&mut survey, "/rgb", raw("rgb8", "color", BIG));
    missing(
        &survey,
        "a topic with depth pictures, found /rgb (sensor_msgs/msg/Image, 10 messages)",
    );
    pictures(&mut survey, "/depth", raw("16UC1", "color", BIG));
    missing(&survey, "expected a calibration (CameraInfo) beside /rgb, or info=TOPIC, found none");
    info(&mut survey, "/other/camera_info", "other", BIG, 50.0);
    missing(&survey, "found /other/camera_info");
    let rig = Rig::of(&survey, &wanted("info=/other/camera_info")).unwrap();
    assert_eq!((rig.cameras().depth.clone(), rig.has_poses()), (None, false));
    assert!(rig.pose_at(0).unwrap_err().contains("no transforms place color"));
    let uncalibrated = raw("rgb8", "other", (640, 400));
    pictures(&mut survey, "/other/image", uncalibrated);
    let error = Rig::of(&survey, &wanted("color=/other/image")).unwrap_err().to_string();
    assert!(error.starts_with("/other/camera_info: expected pictures of 64x48"), "{error}");
}

#[test]
fn a_depth_camera_that_is_nowhere_is_told_of() {
    let mut survey = Survey::default();
    pictures(&mut survey, "/rgb/image", raw("rgb8", "color", BIG));
    pictures(&mut survey, "/depth/image", raw("16UC1", "depth", SMALL));
    info(&mut survey, "/rgb/camera_info", "color", BIG, 50.0);
    info(&mut survey, "/depth/camera_info", "depth", SMALL, 30.0);
    let rig = Rig::of(&survey, &Wanted::default()).unwrap();
    let Some(DepthCamera::Own { color_from_depth, .. }) = &rig.cameras().depth else { panic!() };
    assert_eq!(*color_from_depth, Isometry3::identity());
    let notes = rig.notes().join("\n");
    assert!(
        notes.contains("no transforms connect depth with color: the depth camera is"),
        "{notes}"
    );
}

#[test]
fn poses_come_from_odometry_or_a_topic_of_poses_where_no_tree_has_them() {
    let mut survey = robot();
    // The tree without its moving part.
    survey.tree = Tree::default();
    let fixed =
        vec![transform("base", "link", 0, at(0.1)), transform("link", "color", 0, at(0.02))];
    tf("/tf_static", &mut survey, fixed);
    survey.add("/odom", Decoder::of("cdr", "nav_msgs/msg/Odometry").unwrap());
    survey.add("/slam", Decoder::of("cdr", "geometry_msgs/msg/PoseStamped").unwrap());
    for second in 0..3 {
        let moved = transform("wheels", "base", second * SECOND, at(second as f64));
        survey.take("/odom", Reading::Transforms(vec![moved]));
        let posed = Posed { nanos: second * SECOND, frame_id: "slam".into(), pose: at(-1.0) };
        survey.take("/slam", Reading::Pose(posed));
    }
    let rig = Rig::of(&survey, &Wanted::default()).unwrap();
    assert!((x(&rig, SECOND) - 1.12).abs() < 1e-9, "odometry, composed with fixed transforms");
    assert!(rig.cameras().up.is_some());
    let rig = Rig::of(&survey, &wanted("pose=/slam")).unwrap();
    assert_eq!((x(&rig, SECOND), rig.cameras().up), (-1.0, None), "of the camera itself");
    let rig = Rig::of(&survey, &wanted("pose=/slam&pose_frame=base")).unwrap();
    assert!((x(&rig, SECOND) + 0.88).abs() < 1e-9);
    assert!(!Rig::of(&survey, &wanted("pose=none")).unwrap().has_poses());
    for (options, expected) in [
        ("pose=/odom&world=map", "world=map: expected wheels, which poses of /odom"),
        (
            "pose=/slam&pose_frame=arm",
            "pose_frame=arm: expected the camera's frame or one above it (color, link, base)",
        ),
        (
            "pose=/rgb",
            "pose=/rgb: expected none, or a topic with transforms or poses (/odom, /slam, /tf",
        ),
    ] {
        let error = Rig::of(&survey, &wanted(options)).unwrap_err().to_string();
        assert!(error.starts_with(expected), "{error}");
    }
    // A sender that puts the camera's own name where the world's belongs.
    survey.add("/vslam", Decoder::of("cdr", "geometry_msgs/msg/PoseStamped").unwrap());
    let own = |second: u64| {
        let pose = at(second as f64);
        Reading::Pose(Posed { nanos: second * SECOND, frame_id: "color".into(), pose })
    };
    (0..3).for_each(|second| survey.take("/vslam", own(second)));
    let mut rig = Rig::of(&survey, &wanted("pose=/vslam")).unwrap();
    rig.take("/vslam", own(3));
    assert_eq!((x(&rig, SECOND), x(&rig, 3 * SECOND)), (1.0, 3.0));
    // Live messages of the topic move it on; those of the tree about the same frame do not.
    let mut rig = Rig::of(&survey, &Wanted::default()).unwrap();
    let both =
        |x: f64| Reading::Transforms(vec![transform("wheels", "base", 5 * SECOND / 2, at(x))]);
    rig.take("/odom", both(9.0));
    rig.take("/tf", both(4.0));
    assert!((x(&rig, 5 * SECOND / 2) - 9.12).abs() < 1e-9);
}

#[test]
fn the_best_world_is_taken_and_others_can_be_wanted() {
    let mut survey = robot();
    for half in 0..5 {
        let corrected = transform("robot/map", "odom", half * SECOND / 2, at(10.0));
        tf("/tf", &mut survey, vec![corrected]);
    }
    tf("/tf_static", &mut survey, vec![transform("earth", "robot/map", 0, at(1000.0))]);
    let of = |text: &str| x(&Rig::of(&survey, &wanted(text)).unwrap(), SECOND);
    assert!((of("") - 11.12).abs() < 1e-9, "the map");
    assert!((of("world=odom") - 1.12).abs() < 1e-9);
    assert!((of("world=earth") - 1011.12).abs() < 1e-9);
    let error = Rig::of(&survey, &wanted("world=moon")).unwrap_err().to_string();
    assert!(
        error.starts_with("world=moon: expected a frame above color (link, base, odom"),
        "{error}"
    );
}

#[test]
fn an_imu_tells_up_where_the_world_does_not() {
    let mut survey = Survey::default();
    pictures(&mut survey, "/rgb/image", raw("rgb8", "color", BIG));
    pictures(&mut survey, "/depth/image", raw("16UC1", "color", BIG));
    info(&mut survey, "/rgb/camera_info", "color", BIG, 50.0);
    let turned = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    let pose = Isometry3::from_parts(Translation3::identity(), turned);
    tf("/tf_static", &mut survey, vec![transform("color", "imu", 0, pose)]);
    survey.add("/imu", Decoder::of("cdr", "sensor_msgs/msg/Imu").unwrap());
    for tenth in 0..20 {
        let nanos = tenth * SECOND / 10;
        let up = Vector3::new(0.0, 0.0, if tenth < 5 { -1.0 } else { 1.0 });
        let gravity = Gravity { nanos, frame_id: "imu".into(), up };
        survey.take("/imu", Reading::Gravity(Some(gravity)));
    }
    let rig = Rig::of(&survey, &Wanted::default()).unwrap();
    let up = |nanos: u64| rig.shot(0, nanos, nanos).extras.up;
    let [_, y, _] = up(SECOND).unwrap();
    assert!((y + 1.0).abs() < 1e-9, "z of the IMU is -y of the camera");
    assert!((up(0).unwrap()[1] - 1.0).abs() < 1e-9, "it was held upside down then");
    assert_eq!(up(9 * SECOND), None, "nothing was measured then");
}

#[test]
fn pictures_are_paired_with_the_nearest() {
    let colors = [0, 33, 66, 100].map(|millis| millis * 1_000_000);
    let depths = [35, 2, 90, 200].map(|millis| millis * 1_000_000);
    let within = window(&colors, &depths);
    assert!((16_000_000..20_000_000).contains(&within), "{within}");
    assert_eq!(pair(&colors, &depths, within), [(0, 1), (1, 0), (3, 2)]);
    assert_eq!(pair(&colors, &depths, 1_000_000), []);
    assert_eq!(window(&[], &[]), 5_000_000);
}

#[test]
fn a_track_says_nothing_about_long_gaps() {
    let mut track = Track::new("world".into(), false);
    track.add(10 * SECOND, at(0.0));
    assert_eq!(track.at(99 * SECOND), Some(at(0.0)), "one pose holds always");
    for (second, x) in [(11, 0.0), (12, 0.0), (13, 1.0), (16, 2.0)] {
        track.add(second * SECOND, at(x));
    }
    assert_eq!(track.at(11 * SECOND + 5), Some(at(0.0)), "it rested");
    assert_eq!(track.at(12 * SECOND + SECOND / 2), Some(at(0.5)));
    for nanos in [9 * SECOND, 14 * SECOND, 17 * SECOND] {
        assert_eq!(track.at(nanos), None, "{nanos}");
    }
    assert_eq!(track.at(16 * SECOND + SECOND / 20), Some(at(2.0)), "shortly after the last");
}

#[test]
fn circles_end() {
    let mut tree = Tree::default();
    for (parent, child) in [("a", "b"), ("b", "c"), ("c", "a"), ("d", "d")] {
        tree.add(&transform(parent, child, 0, at(1.0)), false);
    }
    assert!(tree.ancestors("a").len() <= 4);
    assert!(tree.lookup("a", "d", 0).is_err());
    let _ = tree.lookup("a", "b", 0);
}
