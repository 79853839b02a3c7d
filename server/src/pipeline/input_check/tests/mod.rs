//! Walks through a room with one mistake each: the right warning, once, and none without a mistake.

mod scene;

use super::super::frame::{Frame, Intrinsics, PoseHint};
use super::super::input_warning::{InputProblem, InputWarning};
use super::{InputCheck, PATIENCE};
use nalgebra::{Isometry3, Matrix3, Matrix6, Rotation3, UnitQuaternion, Vector3};
use scene::{CAMERA, FRAMES, frame, pose, seen_from, shoot};

/// What is said about a walk.
fn warnings(frames: impl Iterator<Item = Frame>) -> Vec<InputWarning> {
    let mut check = InputCheck::new();
    frames.flat_map(|frame| check.examine(&frame).warnings).collect()
}

/// The problems that are seen in a walk whose frames were changed.
fn problems(change: impl Fn(&mut Frame)) -> Vec<InputProblem> {
    let change = |at| {
        let mut frame = frame(at);
        change(&mut frame);
        frame
    };
    let warnings = warnings((0..FRAMES).map(change));
    for warning in &warnings {
        println!("{:?}: {}", warning.problem, warning.message);
    }
    warnings.into_iter().map(|warning| warning.problem).collect()
}

fn change_pose(frame: &mut Frame, change: impl Fn(Isometry3<f64>) -> Isometry3<f64>) {
    frame.world_from_camera = frame.world_from_camera.map(change);
}

fn scale_depth(frame: &mut Frame, factor: f32) {
    frame.depth_metres = frame.depth_metres.iter().map(|depth| depth * factor).collect();
}

/// The pose of axes that a rotation takes to optical axes.
fn with_axes(optical_from_axes: Matrix3<f64>) -> impl Fn(Isometry3<f64>) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from(Rotation3::from_matrix_unchecked(optical_from_axes));
    move |world_from_camera| world_from_camera * rotation
}

fn open_gl() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0))
}

#[test]
fn a_right_stream_is_passed_over_in_silence() {
    assert_eq!(problems(|_| ()), []);
    assert_eq!(problems(|frame| frame.world_from_camera = None), [], "and without poses");
}

#[test]
fn a_wrong_unit_of_depth_is_seen_against_the_poses() {
    for factor in [10.0, 0.1, 3.0, 0.0254 / 0.01, 1.3, 0.8] {
        let found = problems(|frame| scale_depth(frame, factor));
        assert_eq!(found, [InputProblem::DepthUnit], "{factor}");
    }
    assert_eq!(problems(|frame| scale_depth(frame, 1.02)), [], "real sensors are no better");
}

#[test]
fn a_stream_without_any_depth_is_told_of_once() {
    assert_eq!(problems(|frame| scale_depth(frame, 0.0)), [InputProblem::NoDepth]);
    // Negative control: a camera that sends depth from its fifteenth frame on.
    let late = |at| {
        let mut frame = frame(at);
        scale_depth(&mut frame, if at < PATIENCE - 1 { 0.0 } else { 1.0 });
        frame
    };
    assert_eq!(warnings((0..FRAMES).map(late)), []);
}

#[test]
fn the_factor_is_told() {
    let told = |factor| {
        let scaled = move |at| {
            let mut frame = frame(at);
            scale_depth(&mut frame, factor);
            frame
        };
        warnings((0..FRAMES).map(scaled)).remove(0).message
    };
    assert!(told(10.0).contains("10 times too large"), "{}", told(10.0));
    assert!(told(0.1).contains("10 times too small"), "{}", told(0.1));
    assert!(told(2.0).contains(" 2.0 times too large"), "{}", told(2.0));
}

#[test]
fn poses_that_are_camera_from_world_are_seen() {
    let found = problems(|frame| change_pose(frame, |pose| pose.inverse()));
    assert_eq!(found, [InputProblem::InvertedPoses]);
}

#[test]
fn poses_in_other_axes_are_seen() {
    let found = problems(|frame| change_pose(frame, with_axes(open_gl())));
    assert_eq!(found, [InputProblem::CameraAxes], "OpenGL");
    let optical_from_body = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
    let found = problems(|frame| change_pose(frame, with_axes(optical_from_body)));
    assert_eq!(found, [InputProblem::CameraAxes], "ROS");
}

#[test]
fn two_mistakes_are_told_apart() {
    let found = problems(|frame| {
        change_pose(frame, |pose| with_axes(open_gl())(pose).inverse());
        scale_depth(frame, 10.0);
    });
    let all = [InputProblem::InvertedPoses, InputProblem::CameraAxes, InputProblem::DepthUnit];
    assert_eq!(found, all);
}

/// A robot's own estimate is believed like a given pose, if it says how sure it is.
#[test]
fn odometry_in_another_unit_is_seen() {
    let hinted = |covariance: Option<Matrix6<f64>>| {
        problems(|frame| {
            let mut world_from_camera = frame.world_from_camera.take().expect("it has one");
            world_from_camera.translation.vector *= 1000.0;
            frame.hint = Some(Box::new(PoseHint { world_from_camera, covariance }));
        })
    };
    assert_eq!(hinted(Some(Matrix6::identity())), [InputProblem::DepthUnit]);
    assert_eq!(hinted(None), [], "an estimate that nobody uses");
}

/// Where the depth of another camera lies on the color image.
fn other_camera(camera: Intrinsics, color_from_depth: Isometry3<f64>) -> Vec<InputProblem> {
    problems(|frame| {
        let pose = frame.world_from_camera.expect("it has one") * color_from_depth;
        frame.depth_metres = shoot(&camera, &pose).1.into();
    })
}

#[test]
fn depth_of_another_camera_is_seen() {
    let wide = Intrinsics { fx: 100.0, fy: 100.0, ..CAMERA };
    let found = other_camera(wide, Isometry3::identity());
    assert_eq!(found, [InputProblem::UnregisteredDepth], "a wider lens");
    let aside = Isometry3::translation(0.12, 0.0, 0.0);
    assert_eq!(other_camera(CAMERA, aside), [InputProblem::UnregisteredDepth], "beside it");
    let low = Intrinsics { cy: CAMERA.cy + 6.0, ..CAMERA };
    let found = other_camera(low, Isometry3::identity());
    assert_eq!(found, [InputProblem::UnregisteredDepth], "lower");
    let near = Isometry3::translation(0.01, 0.0, 0.0);
    assert_eq!(other_camera(CAMERA, near), [], "a centimetre is nothing");
}

#[test]
fn a_turned_depth_picture_is_seen() {
    let found = problems(|frame| {
        let turned: Vec<f32> = frame.depth_metres.iter().rev().copied().collect();
        frame.depth_metres = turned.into();
        frame.world_from_camera = None;
    });
    assert_eq!(found, [InputProblem::UnregisteredDepth]);
}

#[test]
fn depths_of_no_room_are_seen_without_poses() {
    let found = |factor| {
        problems(|frame| {
            scale_depth(frame, factor);
            frame.world_from_camera = None;
        })
    };
    assert_eq!(found(0.01), [InputProblem::DepthUnit]);
    assert_eq!(found(30.0), [InputProblem::DepthUnit]);
    assert_eq!(found(3.0), [], "it may be a hall");
}

#[test]
fn what_no_mistake_explains_is_passed_over_in_silence() {
    let others = |at: usize| Frame { world_from_camera: Some(pose(at * 7 % FRAMES)), ..frame(at) };
    assert_eq!(warnings((0..FRAMES).map(others)), [], "poses of other frames");
}

/// Frames of a camera that only turns fit together with depths of any unit.
#[test]
fn a_unit_that_cannot_be_seen_is_not_guessed() {
    let turning = |at: usize| {
        let turn = UnitQuaternion::from_euler_angles(0.0, 0.08 * at as f64, 0.0);
        let mut frame = seen_from(at, &Isometry3::from_parts(Vector3::zeros().into(), turn));
        scale_depth(&mut frame, 10.0);
        frame
    };
    assert_eq!(warnings((0..FRAMES).map(turning)), []);
}

/// A robot that sees nothing but a wall at first is not examined in vain.
#[test]
fn frames_that_tell_nothing_do_not_use_the_check_up() {
    let mut check = InputCheck::new();
    for at in 0..40 {
        let mut wall = frame(0);
        // Each is brighter, so that it looks new, and shows a wall at the same distance.
        let grey = (at % 2) as u8 * 100 + 50;
        wall.rgb = (0..wall.rgb.len()).map(|byte| grey * u8::from(byte / 3 % 160 < 80)).collect();
        wall.depth_metres = wall.depth_metres.iter().map(|_| 2.0 + 1e-3 * at as f32).collect();
        assert_eq!(check.examine(&wall).warnings, [], "a wall fits with anything");
    }
    assert!(check.examined > 24, "they looked new: {}", check.examined);
    let inverted = (0..FRAMES).flat_map(|at| {
        let mut frame = frame(at);
        change_pose(&mut frame, |pose| pose.inverse());
        check.examine(&frame).warnings
    });
    let found: Vec<_> = inverted.map(|warning| warning.problem).collect();
    assert_eq!(found, [InputProblem::InvertedPoses]);
}

#[test]
fn poses_that_are_not_sent_are_not_waited_for() {
    let mut check = InputCheck::new();
    let mut walk = |frames: std::ops::Range<usize>| {
        for at in frames {
            check.examine(&Frame { world_from_camera: None, ..frame(at) });
        }
        (check.examined >= PATIENCE, check.poses.is_none())
    };
    assert_eq!(walk(0..5), (false, false));
    assert_eq!(walk(5..FRAMES), (true, true));
}

#[test]
fn a_camera_that_stands_still_is_not_examined() {
    let mut check = InputCheck::new();
    for at in 0..FRAMES {
        check.examine(&seen_from(at, &pose(0)));
    }
    assert_eq!(check.examined, 1);
    (0..FRAMES).for_each(|at| {
        check.examine(&frame(at));
    });
    assert!(check.examined > 10, "a walk is: {}", check.examined);
}

/// Numbers of the frames that repeat the depth of another one.
fn repeated(frames: impl Iterator<Item = Frame>) -> (Vec<usize>, Vec<InputProblem>) {
    let mut check = InputCheck::new();
    let examined: Vec<_> = frames.map(|frame| check.examine(&frame)).collect();
    let repeats = examined.iter().enumerate().filter(|(_, seen)| seen.repeats_depth);
    let numbers = repeats.map(|(at, _)| at).collect();
    let problems = examined.iter().flat_map(|seen| &seen.warnings).map(|warning| warning.problem);
    (numbers, problems.collect())
}

#[test]
fn depth_that_repeats_while_color_changes_is_found() {
    let with_depth_of = |at: usize, depth: usize| Frame {
        depth_metres: frame(depth).depth_metres,
        world_from_camera: None,
        ..frame(at)
    };
    let (found, problems) = repeated((0..12).map(|at| with_depth_of(at, at.min(5))));
    assert_eq!(
        (found, problems),
        ((6..12).collect(), vec![InputProblem::RepeatedDepth]),
        "stopped"
    );
    let (found, problems) = repeated((0..12).map(|at| with_depth_of(at, at / 2 * 2)));
    let every_other: Vec<_> = (1..12).step_by(2).collect();
    assert_eq!((found, problems), (every_other, vec![InputProblem::RepeatedDepth]), "half as fast");
    let (found, problems) = repeated((0..12).map(|at| with_depth_of(at, at)));
    assert_eq!((found, problems), (vec![], vec![]));
    let along_a_wall = |at: usize| {
        let mut frame = with_depth_of(at, 0);
        frame.depth_metres = frame.depth_metres.iter().map(|_| 2.0).collect();
        frame
    };
    assert_eq!(repeated((0..12).map(along_a_wall)), (vec![], vec![]), "a rendered wall");
    let (found, problems) = repeated((0..40).map(along_a_wall));
    assert_eq!((found, problems), (vec![], vec![InputProblem::RepeatedDepth]), "a made-up depth");
    // A camera that stands still, seen by a renderer, under a light that flickers.
    let flickering = (0..12u8).map(|at| {
        let mut frame = with_depth_of(3, 3);
        frame.rgb = frame.rgb.iter().map(|value| value / 2 + 10 * (at % 3)).collect();
        frame
    });
    assert_eq!(repeated(flickering), (vec![], vec![]), "another exposure");
}
