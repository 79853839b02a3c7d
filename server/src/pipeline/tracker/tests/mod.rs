//! Whole sequences through a real map without poses: a textured room, ray-cast.

mod cameras;

use super::super::frame::{Frame, FrameOutcome, FrameUp, Intrinsics, PoseHint, TrackingState};
use super::super::map::{Map, StreamGuard};
use crate::test_support::{ROOM_CAMERA as CAMERA, engine, ray_cast, tinted};
use lexsplat_gpu::align::se3;
use nalgebra::{Isometry3, Matrix6, Vector3, Vector6};
use std::sync::Arc;

const FRAME_NANOS: u64 = 33_000_000;
/// Errors of tracked frames stay below this, metres plus radians; worst measured 0.0005 (llvmpipe).
const CLOSE: f64 = 0.002;

/// Stripes in all directions, 0 to 1.
fn texture(point: &Vector3<f64>) -> f64 {
    let waves = [[2.1, 0.7, 1.3], [-1.9, 2.8, 0.6], [4.0, -2.0, 5.0], [7.0, 9.0, -6.0]];
    let wave = |(i, w): (usize, &[f64; 3])| (Vector3::from(*w).dot(point) + i as f64).sin();
    0.5 + 0.11 * waves.iter().enumerate().map(wave).sum::<f64>()
}

/// What the camera sees of the room.
fn shoot(world_from_camera: &Isometry3<f64>) -> (Vec<u8>, Vec<f32>) {
    shoot_with(&CAMERA, world_from_camera)
}

fn shoot_with(camera: &Intrinsics, world_from_camera: &Isometry3<f64>) -> (Vec<u8>, Vec<f32>) {
    let (mut rgb, mut depth) = (Vec::new(), Vec::new());
    for (place, z) in ray_cast(camera, world_from_camera) {
        rgb.extend(tinted(texture(&place) * 255.0));
        depth.push(z as f32);
    }
    (rgb, depth)
}

/// Where the camera is after some frames: a walk to the side while turning, 1.3 cm and 0.7 degrees
/// per frame.
fn pose(frame: f64) -> Isometry3<f64> {
    se3::exp(&(Vector6::new(0.012, -0.002, 0.004, 0.003, 0.012, 0.002) * frame))
}

/// Looking the other way, where the walk does not come.
fn behind() -> Isometry3<f64> {
    se3::exp(&Vector6::new(0.3, 0.0, -0.4, 0.0, std::f64::consts::PI - 0.2, 0.0))
}

/// A map that is sent frames without poses.
struct Robot {
    sender: StreamGuard,
    next: u64,
    /// What it says its camera is.
    camera: Intrinsics,
    /// Whether its frames are held out.
    held_out: bool,
}

impl Robot {
    fn new(map: &str) -> Self {
        let map = engine().open(map).unwrap();
        Self { sender: map.claim().unwrap(), next: 0, camera: CAMERA, held_out: false }
    }

    /// Goes, and comes back with another stream.
    fn again(self) -> Self {
        let Self { sender, next, camera, held_out } = self;
        let map = sender.map().clone();
        drop(sender);
        Self { sender: map.claim().unwrap(), next, camera, held_out }
    }

    fn map(&self) -> &Arc<Map> {
        self.sender.map()
    }

    async fn submit(
        &mut self,
        (rgb, depth): (Vec<u8>, Vec<f32>),
        hint: Option<PoseHint>,
    ) -> FrameOutcome {
        let sequence = self.next;
        self.next += 1;
        let frame = Frame {
            sequence,
            timestamp_nanos: sequence * FRAME_NANOS,
            intrinsics: self.camera,
            rgb: rgb.into(),
            depth_metres: depth.into(),
            depth_lag_nanos: 0,
            world_from_camera: None,
            hint: hint.map(Box::new),
            labels: None,
            held_out: self.held_out,
            up: FrameUp::default(),
        };
        self.map().submit(frame).await.unwrap().await.unwrap()
    }

    async fn look(&mut self, pose: &Isometry3<f64>) -> FrameOutcome {
        self.submit(shoot(pose), None).await
    }

    /// Walks to this frame from the one after the last; the worst error.
    async fn walk(&mut self, until: u64) -> f64 {
        let mut worst: f64 = 0.0;
        while self.next < until {
            let wanted = pose(self.next as f64);
            let outcome = self.look(&wanted).await;
            worst = worst.max(error(&outcome, &wanted));
        }
        worst
    }
}

/// Metres plus radians to where the camera was; infinite if it is lost.
fn error(outcome: &FrameOutcome, wanted: &Isometry3<f64>) -> f64 {
    let found = outcome.world_from_camera.map(|found| found.inverse() * wanted);
    found.map_or(f64::INFINITY, |off| off.translation.vector.norm() + off.rotation.angle())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_walk_is_tracked() {
    let mut robot = Robot::new("tracker-walk");
    let worst = robot.walk(30).await;
    println!("worst {worst:.5}");
    // Measured 0.0004 (metres plus radians, llvmpipe).
    assert!(worst < CLOSE, "{worst}");
    let outcome = robot.look(&pose(30.0)).await;
    assert_eq!((outcome.tracking, outcome.relocalised), (TrackingState::Tracking, false));
    assert!(error(&outcome, &pose(28.0)) > 2.0 * CLOSE, "two frames before is another place");
    assert!(robot.map().status().frames_lost == 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_camera_that_darkens_is_tracked() {
    let mut robot = Robot::new("tracker-exposure");
    let mut worst: f64 = 0.0;
    for frame in 0..30 {
        let wanted = pose(f64::from(frame));
        let (mut rgb, depth) = shoot(&wanted);
        let gain = 0.975f64.powi(frame);
        rgb.iter_mut().for_each(|value| *value = (f64::from(*value) * gain).round() as u8);
        worst = worst.max(error(&robot.submit((rgb, depth), None).await, &wanted));
    }
    println!("worst {worst:.5}");
    assert!(worst < CLOSE, "{worst}");
    let (rgb, depth) = shoot(&pose(30.0));
    let negative = robot.submit((rgb.iter().map(|value| 255 - value).collect(), depth), None).await;
    assert_eq!(negative.tracking, TrackingState::Lost, "no exposure makes a negative");
}

#[tokio::test(flavor = "multi_thread")]
async fn black_frames_are_lost_and_not_mapped_and_then_it_goes_on() {
    let mut robot = Robot::new("tracker-black");
    assert!(robot.walk(12).await < CLOSE);
    let pixels = (CAMERA.width * CAMERA.height) as usize;
    for depth in [0.0, 2.0] {
        for _ in 0..10 {
            let outcome = robot.submit((vec![0; 3 * pixels], vec![depth; pixels]), None).await;
            assert_eq!(outcome.tracking, TrackingState::Lost);
            assert!(!outcome.keyframe && outcome.world_from_camera.is_none());
        }
    }
    let white = robot.submit((vec![200; 3 * pixels], vec![0.0; pixels]), None).await;
    assert_eq!(white.tracking, TrackingState::Lost, "no depth at all");
    let unseen = robot.look(&behind()).await;
    assert_eq!(unseen.tracking, TrackingState::Lost, "a place that it has never seen");
    let back = robot.look(&pose(13.0)).await;
    println!("error {:.5}", error(&back, &pose(13.0)));
    assert!(back.relocalised && error(&back, &pose(13.0)) < CLOSE, "{back:?}");
    let next = robot.look(&pose(14.0)).await;
    assert!(!next.relocalised && error(&next, &pose(14.0)) < CLOSE, "{next:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn dropped_frames_are_bridged() {
    let mut robot = Robot::new("tracker-dropped");
    assert!(robot.walk(12).await < CLOSE);
    robot.next += 30;
    let wanted = pose(robot.next as f64);
    let outcome = robot.look(&wanted).await;
    println!("error {:.5}", error(&outcome, &wanted));
    assert!(error(&outcome, &wanted) < CLOSE, "{outcome:?}");
    assert!(error(&outcome, &pose(12.0)) > 10.0 * CLOSE, "it has not stayed");
    assert!(robot.walk(48).await < CLOSE);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_jump_to_a_place_seen_before_is_found() {
    let mut robot = Robot::new("tracker-jump");
    assert!(robot.walk(50).await < CLOSE);
    let outcome = robot.look(&pose(3.3)).await;
    println!("error {:.5}", error(&outcome, &pose(3.3)));
    assert!(outcome.relocalised && error(&outcome, &pose(3.3)) < CLOSE, "{outcome:?}");
    let unseen = robot.look(&behind()).await;
    assert_eq!(unseen.tracking, TrackingState::Lost, "a place that it has never seen");
}

/// A stream ends and another goes on with the map, from anywhere: it is found in what is there, also where
/// it could be taken for a frame that follows.
#[tokio::test(flavor = "multi_thread")]
async fn a_map_that_is_gone_on_with_is_found_again() {
    let mut robot = Robot::new("tracker-resume");
    assert!(robot.walk(40).await < CLOSE);
    // A moment later, far back, and 3 cm to the side of where the walk went.
    let aside = Isometry3::translation(0.03, 0.0, 0.0);
    for wanted in [pose(40.0), pose(3.3), pose(20.0) * aside] {
        robot = robot.again();
        let outcome = robot.look(&wanted).await;
        println!("error {:.5}", error(&outcome, &wanted));
        assert!(outcome.relocalised && error(&outcome, &wanted) < CLOSE, "{outcome:?}");
        // Negative control: the same sender need not find itself again.
        let next = robot.look(&wanted).await;
        assert!(!next.relocalised && error(&next, &wanted) < CLOSE, "{next:?}");
    }
    robot = robot.again();
    let unseen = robot.look(&behind()).await;
    assert_eq!(unseen.tracking, TrackingState::Lost, "a place that it has never seen");
    assert!(!unseen.keyframe, "which is not mapped");
    let back = robot.look(&pose(10.0)).await;
    assert!(back.relocalised && error(&back, &pose(10.0)) < CLOSE, "{back:?}");
}

/// A robot that knows its pose well is believed where the camera sees nothing but a wall of one
/// color, along which it could slide.
#[tokio::test(flavor = "multi_thread")]
async fn what_the_robot_thinks_is_weighed() {
    let pixels = (CAMERA.width * CAMERA.height) as usize;
    let wall = || (vec![120; 3 * pixels], vec![2.0; pixels]);
    let at = |x: f64| Isometry3::translation(x, 0.0, 0.0);
    let hint = |x: f64, sigma: f64| {
        let covariance = Some(Matrix6::identity() * sigma * sigma);
        Some(PoseHint { world_from_camera: at(x), covariance })
    };
    let mut robot = Robot::new("tracker-hint");
    let first = robot.submit(wall(), hint(1.0, 0.01)).await;
    assert!(error(&first, &at(1.0)) < 1e-9, "the first frame is where the robot says");
    let second = robot.submit(wall(), None).await;
    assert_eq!(second.tracking, TrackingState::Lost, "nothing tells where it slid");
    let third = robot.submit(wall(), hint(1.05, 0.01)).await;
    assert!(error(&third, &at(1.05)) < CLOSE, "{third:?}");
    assert!(error(&third, &at(1.0)) > 2.0 * CLOSE, "and not where it was");
}

/// A frame of the walk that is spoiled in one way.
fn spoiled(frame: u64, how: usize) -> (Vec<u8>, Vec<f32>) {
    let (mut rgb, mut depth) = shoot(&pose(frame as f64));
    match how {
        0 => rgb.iter_mut().for_each(|value| *value = value.saturating_mul(4)),
        1 => rgb.fill(255),
        2 => {
            depth.iter_mut().enumerate().filter(|(at, _)| at % 160 > 8).for_each(|(_, z)| *z = 0.0)
        }
        _ => {
            rgb.chunks_exact_mut(3).for_each(|pixel| pixel.copy_from_slice(&[190, 140, 120]));
            depth.fill(0.25);
        }
    }
    (rgb, depth)
}

/// The worst error of tracked frames, relative to the first good frame, and the number of lost ones.
async fn walk_with_bad(map: &str, is_bad: impl Fn(u64) -> Option<usize>) -> (f64, usize) {
    let mut robot = Robot::new(map);
    let (mut origin, mut worst, mut lost) = (None, 0.0f64, 0);
    for at in 0..30 {
        let how = is_bad(at);
        let images = how.map_or_else(|| shoot(&pose(at as f64)), |how| spoiled(at, how));
        let Some(found) = robot.submit(images, None).await.world_from_camera else {
            lost += usize::from(how.is_none());
            continue;
        };
        if how.is_none() {
            // The world may begin anew with a frame that was lost at first.
            let here = found * pose(at as f64).inverse();
            let first: Isometry3<f64> = *origin.get_or_insert(here);
            let off = first.inverse() * here;
            worst = worst.max(off.translation.vector.norm() + off.rotation.angle());
        }
    }
    (worst, lost)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_map_whose_first_frames_are_bad_begins_anew() {
    for how in 0..4 {
        let (worst, lost) =
            walk_with_bad(&format!("tracker-first-{how}"), |at| (at == 0).then_some(how)).await;
        println!("first frame bad ({how}): worst {worst:.5}, {lost} lost");
        assert!(worst < CLOSE && lost <= 1, "{how}: {worst} {lost}");
        let (worst, lost) = walk_with_bad(&format!("tracker-second-{how}"), |at| {
            (1..3).contains(&at).then_some(how)
        })
        .await;
        println!("second and third bad ({how}): worst {worst:.5}, {lost} lost");
        assert!(worst < CLOSE && lost <= 1, "{how}: {worst} {lost}");
    }
    // Negative control: frames of which no two agree begin no map.
    let mut robot = Robot::new("tracker-never");
    for at in 0..12 {
        let outcome = robot
            .look(
                &(pose(f64::from(at) * 9.0)
                    * if at % 2 == 0 { Isometry3::identity() } else { behind() }),
            )
            .await;
        assert_eq!(
            outcome.world_from_camera.is_some(),
            at == 0 || at % 2 == 0,
            "{at}: {outcome:?}"
        );
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn every_tenth_frame_may_be_bad() {
    let (worst, lost) =
        walk_with_bad("tracker-tenth", |at| (at % 10 == 9).then_some(at as usize / 10)).await;
    println!("worst {worst:.5}, {lost} lost");
    assert!(worst < CLOSE && lost == 0, "{worst} {lost}");
}

/// The first second of a camera is dark, then it brightens: all is one map.
#[tokio::test(flavor = "multi_thread")]
async fn the_first_second_may_be_dark() {
    let mut robot = Robot::new("tracker-dark");
    let (mut origin, mut worst, mut lost) = (None, 0.0f64, 0);
    for at in 0..45 {
        let (mut rgb, depth) = shoot(&pose(f64::from(at)));
        let gain = if at < 30 { 0.08 } else { 1.0 };
        rgb.iter_mut().for_each(|value| *value = (f64::from(*value) * gain) as u8);
        match robot.submit((rgb, depth), None).await.world_from_camera {
            Some(found) if at >= 30 => {
                let here = found * pose(f64::from(at)).inverse();
                let first: Isometry3<f64> = *origin.get_or_insert(here);
                let off = first.inverse() * here;
                worst = worst.max(off.translation.vector.norm() + off.rotation.angle());
            }
            Some(_) => {}
            None => lost += usize::from(at >= 30),
        }
    }
    println!("worst {worst:.5}, {lost} lost");
    assert!(worst < 2.0 * CLOSE && lost <= 1, "{worst} {lost}");
}

/// Far apart frames: either found exactly or lost.
#[tokio::test(flavor = "multi_thread")]
async fn a_large_step_is_never_tracked_wrongly() {
    for (stride, least) in [(10, 8), (15, 1), (30, 1)] {
        let mut robot = Robot::new(&format!("tracker-stride-{stride}"));
        let (mut worst, mut found) = (0.0f64, 0);
        for at in 0..8 {
            let wanted = pose(f64::from(at * stride));
            let outcome = robot.look(&wanted).await;
            if outcome.world_from_camera.is_some() {
                worst = worst.max(error(&outcome, &wanted));
                let beside = pose(f64::from(at * stride) + 1.0);
                assert!(error(&outcome, &beside) > 2.0 * CLOSE, "a frame beside is another place");
                found += 1;
            }
        }
        println!("every {stride}th frame: worst {worst:.5}, {found} of 8 found");
        assert!(worst < 2.0 * CLOSE && found >= least, "{stride}: {worst}, {found} found");
    }
}

/// A held-out frame adds nothing to a map. If it began one, the frame after it would begin it again, at the
/// same pose.
#[tokio::test(flavor = "multi_thread")]
async fn a_map_does_not_begin_with_a_held_out_frame() {
    let mut robot = Robot { held_out: true, ..Robot::new("tracker-held-out") };
    for at in 0..2 {
        let outcome = robot.look(&pose(f64::from(at))).await;
        assert_eq!(outcome.tracking, TrackingState::Lost, "{at}");
    }
    robot.held_out = false;
    let first = robot.look(&pose(2.0)).await;
    assert!(error(&first, &Isometry3::identity()) < 1e-9, "here the map begins");
    let second = robot.look(&pose(3.0)).await;
    let wanted = pose(2.0).inverse() * pose(3.0);
    assert!(error(&second, &wanted) < CLOSE && error(&second, &Isometry3::identity()) > CLOSE);
    robot.held_out = true;
    let third = robot.look(&pose(4.0)).await;
    assert!(error(&third, &(pose(2.0).inverse() * pose(4.0))) < CLOSE, "later ones are tracked");
}
