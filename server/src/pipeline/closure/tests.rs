//! Loops in ray-cast rooms with a noisy sensor: a turn all the way round is closed, and a room that looks
//! like another one is not taken for it.

use super::super::compressor::{self, CompressorConfig};
use super::super::frame::{Frame, FrameUp, TrackedPose};
use super::super::keyframes::{Keyframe, KeyframeWidths};
use super::super::live_map::{LiveMap, StepBudget};
use super::super::pose_graph::Edge;
use super::super::tracker::{Scene, Tracker, TrackerConfig, Tracking};
use super::parts::MapParts;
use super::{Closure, ClosureConfig};
use crate::test_support::{ROOM_CAMERA as CAMERA, ray_cast_room, tinted};
use lexsplat_gpu::{Gaussians, Gpu, HostGaussians, HostHead, Trainer};
use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Frames of a full turn.
const TURN: u64 = 45;
/// Standard deviation of a depth of one metre; it grows with the square of the depth.
const DEPTH_NOISE: f64 = 0.0015;

/// The color of a tile of a room, 30 to 230.
fn tile(room: u64, place: &Vector3<f64>) -> f64 {
    let cell = place.map(|x| (x * 3.0 + 0.01).floor() as i64 as u64);
    let mut hash = room.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for part in cell.iter() {
        hash = (hash ^ part).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash ^= hash >> 29;
    }
    30.0 + (hash % 200) as f64
}

/// What a noisy camera sees of a room.
fn shoot(room: u64, sequence: u64, world_from_camera: &Isometry3<f64>) -> Frame {
    let rng = &mut ChaCha8Rng::seed_from_u64(1000 * room + sequence);
    let (mut rgb, mut depth) = (Vec::new(), Vec::new());
    for (place, z) in ray_cast_room(world_from_camera) {
        rgb.extend(tinted(tile(room, &place) + rng.random_range(-6.0..6.0)));
        let noise: f64 = (0..4).map(|_| rng.random_range(-0.87..0.87)).sum();
        depth.push((z + DEPTH_NOISE * z * z * noise) as f32);
    }
    Frame {
        sequence,
        timestamp_nanos: sequence * 33_000_000,
        intrinsics: CAMERA,
        rgb: rgb.into(),
        depth_metres: depth.into(),
        depth_lag_nanos: 0,
        world_from_camera: None,
        hint: None,
        labels: None,
        held_out: false,
        up: FrameUp::default(),
    }
}

/// Where the camera is in a turn: it looks outwards from a circle.
fn place(frame: u64) -> Isometry3<f64> {
    let angle = std::f64::consts::TAU * frame as f64 / TURN as f64;
    let turn = UnitQuaternion::from_scaled_axis(Vector3::y() * angle);
    Isometry3::from_parts(Translation3::identity(), turn) * Isometry3::translation(0.0, 0.1, 0.4)
}

/// One Gaussian.
fn gaussian(mean: Point3<f64>) -> HostGaussians {
    let head = |channels| HostHead {
        rotations: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scales: vec![[-4.0; 3]],
        opacity_logits: vec![2.0],
        features: vec![0.5; channels],
        channels,
    };
    let mean = mean.cast::<f32>();
    HostGaussians { means: vec![[mean.x, mean.y, mean.z]], color: head(3), language: head(15) }
}

/// A place before each camera, where its keyframe's Gaussian is.
const BEFORE: Point3<f64> = Point3::new(0.1, -0.2, 1.5);

/// A map that is tracked and closed, and not optimised: each keyframe inserts one Gaussian.
struct Site {
    gpu: Gpu,
    live: LiveMap,
    trainer: Trainer,
    tracker: Tracker,
    closure: Closure,
    closed: usize,
}

impl Site {
    fn new(config: &ClosureConfig) -> Self {
        let gpu = Gpu::new(None).expect("these tests need a vulkan adapter");
        let online = compressor::online(&CompressorConfig::default());
        let gaussians = Gaussians::new(&gpu, online.code_size());
        Self {
            live: LiveMap::new(gaussians, online, StepBudget::new(1, 1)),
            trainer: Trainer::new(&gpu, 15).expect("compiles"),
            tracker: Tracker::new(&gpu, &TrackerConfig::default()),
            closure: Closure::new(config),
            gpu,
            closed: 0,
        }
    }

    fn begin_anew(&mut self) {
        self.live.clear(&self.gpu, StepBudget::new(1, 1));
        self.tracker.begin_anew();
        self.closure.begin_anew();
    }

    fn track(&mut self, frame: &Frame) -> TrackedPose {
        let Self { live, trainer, tracker, .. } = self;
        let (gaussians, keyframes) = (&live.gaussians, &live.keyframes);
        let mut scene = Scene { trainer, gaussians, keyframes };
        match tracker.track(frame, &mut scene).expect("the device is there") {
            Tracking::Found(tracked) => *tracked,
            Tracking::Lost | Tracking::BeginAnew(_) => panic!("{} is lost", frame.sequence),
        }
    }

    fn keyframe(&self, frame: &Frame, tracked: &TrackedPose) -> Keyframe {
        let widths = KeyframeWidths { training: 160, tracking: 160, full: false };
        Keyframe::new(frame, tracked, widths).expect("there is room")
    }

    fn parts(&mut self) -> (MapParts<'_>, &mut Closure) {
        let Self { live, trainer, tracker, closure, .. } = self;
        (MapParts { live, trainer, tracker }, closure)
    }

    /// Tracks a frame and makes it a keyframe.
    fn add(&mut self, frame: &Frame) {
        let tracked = self.track(frame);
        let mut keyframe = self.keyframe(frame, &tracked);
        let (mut parts, closure) = self.parts();
        let closed = closure.join(&mut parts, &mut keyframe).expect("the device is there");
        self.closed += usize::from(closed);
        let pose = keyframe.frame.world_from_camera;
        self.live.gaussians.append(&gaussian(pose * BEFORE)).expect("there is room");
        self.live.keyframes.add(keyframe);
        let tracked = TrackedPose { world_from_camera: pose, ..tracked };
        self.live.trajectory.push(frame, &tracked, &self.live.keyframes);
    }

    /// Distances of all keyframes from where the camera was, relative to the first, metres.
    fn errors(&self) -> Vec<f64> {
        let off = |keyframe: &Keyframe| {
            let wanted = place(0).inverse() * place(keyframe.frame.sequence);
            (keyframe.frame.world_from_camera.inverse() * wanted).translation.vector.norm()
        };
        self.live.keyframes.iter().map(off).collect()
    }
}

fn enabled() -> ClosureConfig {
    ClosureConfig { enabled: true, ..ClosureConfig::default() }
}

/// A full turn and a bit more.
fn turn(config: &ClosureConfig) -> Site {
    let mut site = Site::new(config);
    (0..TURN + 6).for_each(|at| site.add(&shoot(3, at, &place(at))));
    site
}

#[test]
fn a_turn_all_the_way_round_is_closed() {
    // Each keyframe is aligned with the one before alone, until a loop is closed.
    let config = ClosureConfig { connected_metres: 0.0, correction_metres: 0.002, ..enabled() };
    let site = turn(&config);
    let poses = |site: &Site| -> Vec<Isometry3<f64>> {
        site.live.keyframes.iter().map(|keyframe| keyframe.frame.world_from_camera).collect()
    };
    assert_eq!(poses(&site), poses(&turn(&config)), "the same every time");
    // Negative control: nothing is ever in view.
    let blind = turn(&ClosureConfig { overlap: 2.0, ..config });
    let at_return = |site: &Site| site.errors()[TURN as usize..].iter().sum::<f64>() / 6.0;
    let overall = |site: &Site| {
        let errors = site.errors();
        (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
    };
    println!(
        "at the return {:.4} instead of {:.4} m, overall {:.4} instead of {:.4} m, {} closed",
        at_return(&site),
        at_return(&blind),
        overall(&site),
        overall(&blind),
        site.closed
    );
    assert!(site.closed > 0 && blind.closed == 0, "{} {}", site.closed, blind.closed);
    // Measured: 0.0017 and 0.0104 m at the return, 0.0056 and 0.0101 m overall (llvmpipe).
    assert!(at_return(&site) < 0.5 * at_return(&blind));
    assert!(overall(&site) < 0.75 * overall(&blind));

    let means = site.live.gaussians.read_means().expect("the device is there");
    let frames = site.live.trajectory.frames(&site.live.keyframes);
    for ((keyframe, mean), frame) in site.live.keyframes.iter().zip(&means).zip(&frames) {
        let pose = &keyframe.frame.world_from_camera;
        let off = (pose * BEFORE - Point3::from(*mean).cast::<f64>()).norm();
        assert!(off < 1e-5, "the Gaussian of {} is {off} m away", frame.sequence);
        let off = (pose.inverse() * frame.world_from_camera).translation.vector.norm();
        assert!(off < 1e-6, "frame {} did not move with its keyframe", frame.sequence);
    }
}

/// Two keyframes of a room, and a third that looks like them. According to the path it was taken so many
/// `metres` away from the others, give or take 5 cm and 3 degrees. Returns whether a loop was found, for
/// each.
fn are_closed(site: &mut Site, room: u64, metres: &[f64]) -> Vec<bool> {
    site.begin_anew();
    // Sequence numbers are not used again.
    let shoot = |at: u64| shoot(room, 10 * room + at, &place(at));
    (0..2).for_each(|at| site.add(&shoot(at)));
    let frame = shoot(2);
    let tracked = site.track(&frame);
    let graph = site.live.graph.clone();
    let mut closed = Vec::new();
    for metres in metres {
        // The way there is not shown: only the graph knows of it.
        let aside = Isometry3::translation(*metres, 0.0, 0.0);
        let world_from_camera = aside * tracked.world_from_camera;
        let keyframe = site.keyframe(&frame, &TrackedPose { world_from_camera, ..tracked });
        let world_from_first = site.live.keyframes.at(0).frame.world_from_camera;
        let first_from_second = world_from_first.inverse() * world_from_camera;
        let covariance = Matrix6::identity() * 0.05 * 0.05;
        site.live.graph = graph.clone();
        let second = site.live.graph.add_node(10 * room + 2, false);
        let edge = Edge { first: 0, second, first_from_second, covariance, is_closure: false };
        site.live.graph.add_edge(edge);
        site.tracker.move_with_map(&aside);
        let (mut parts, closure) = site.parts();
        let found = closure.detection.look(&mut parts, &keyframe, second, &closure.config);
        closed.push(!found.expect("the device is there").is_empty());
        site.closure.begin_anew();
        site.tracker.move_with_map(&aside.inverse());
    }
    closed
}

#[test]
fn a_room_that_looks_like_another_is_not_taken_for_it() {
    let mut site = Site::new(&enabled());
    let mut found = 0;
    for room in 0..20 {
        let closed = are_closed(&mut site, room, &[0.6, 0.04]);
        assert!(!closed[0], "room {room}: the same furniture, but it should be elsewhere");
        found += usize::from(closed[1]);
    }
    // Negative control: where the path allows it, it is the same room.
    assert!(found >= 18, "{found} of 20");
}
