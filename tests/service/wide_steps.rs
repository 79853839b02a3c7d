//! Walks through rendered rooms of which only every K-th frame is sent, and walks with simulated sensors. A
//! pose that is said to be tracked is right; a frame without such a pose is lost and the camera is found
//! again.
//!
//! The rooms lie beside the project in `../shared/data`. Without them the tests say so and pass.

use lexsplat_client::Access;
use lexsplat_client::dataset::{Dataset, FrameRange, Replica};
use lexsplat_client::stream::{FrameStream, MapSpec, Poses};
use lexsplat_gpu::align::se3::adjoint;
use lexsplat_proto::v1::{FrameAck, FrameStatus};
use lexsplat_server::config::Config;
use lexsplat_synthetic::sensor::{D435, KINECT, PHONE, Preset, Sensed, TOF};
use lexsplat_tests::{Server, root, tiny_config};
use nalgebra::{Isometry3, Matrix6, Quaternion, Translation3, UnitQuaternion};
use std::num::NonZeroUsize;
use std::sync::Arc;

const ROOMS: [&str; 2] = ["house-bedroom", "house-living"];
/// No tracked frame may be farther from the truth, metres; worst measured 0.0019;
const MOST_METRES: f64 = 0.02;
/// nor be turned by more, radians; worst measured 0.001.
const MOST_RADIANS: f64 = 0.02;
/// Largest root mean square of all errors, metres; largest measured 0.0007.
const MOST_RMS_METRES: f64 = 0.001;
/// The same with a simulated sensor, with a Kinect twice that; largest measured 0.0082.
const MOST_SENSED_RMS_METRES: f64 = 0.01;
/// With a simulated sensor, frames may be off by this many times as much; worst measured 1.1 times.
const SENSED: f64 = 2.5;
/// Covariances expect errors that are right within this factor; measured: 0.4 to 4.3 times the errors.
const SURE_WITHIN: f64 = 4.5;
/// Frames of a walk with a simulated sensor.
const SENSED_FRAMES: usize = 160;

/// A data set beside the project; `None` where it is missing.
fn room(name: &str, range: FrameRange) -> Option<Box<dyn Dataset>> {
    let folder = root().parent()?.join("shared/data").join(name);
    if !folder.is_dir() {
        eprintln!("SKIPPED: {} is not there", folder.display());
        return None;
    }
    let whole = Replica::open(&folder).expect("a data set");
    Some(range.of(Box::new(whole)).expect("it has frames"))
}

fn every(stride: usize) -> FrameRange {
    let stride = NonZeroUsize::new(stride).expect("not 0");
    FrameRange { stride, ..FrameRange::default() }
}

/// Few steps, so that tracking takes most of the time; the tracker's own settings are the defaults.
fn config() -> Config {
    let mut config = tiny_config();
    config.mapper.steps_per_keyframe = 1;
    config
}

/// What a tracker does that believes every alignment and has no features to start from.
fn credulous() -> Config {
    let mut config = config();
    let tracker = &mut config.tracker;
    (tracker.convincing_disagreement, tracker.max_disagreement) = (1.0, 1.0);
    (tracker.min_overlap, tracker.min_surface) = (0.0, 0.0);
    config
}

/// How a walk was tracked.
#[derive(Clone, Copy, Debug, Default)]
struct Walk {
    frames: usize,
    lost: usize,
    /// Whether the last frame has a pose.
    ends_found: bool,
    rms_metres: f64,
    worst_metres: f64,
    worst_radians: f64,
    /// Root mean square of the errors relative to the newest keyframe, and of what their covariances expect,
    /// metres.
    step_metres: [f64; 2],
}

impl Walk {
    fn is_sure_rightly(&self) -> bool {
        let [found, expected] = self.step_metres;
        found < SURE_WITHIN * expected && expected < SURE_WITHIN * found
    }
}

/// Errors relative to the newest keyframe, and what the covariances expect.
#[derive(Default)]
struct Steps {
    /// True and estimated pose of the newest keyframe.
    keyframe: Option<[Isometry3<f64>; 2]>,
    frames: usize,
    /// Sums of squares of the position's error and of what is expected, metres².
    squares: [f64; 2],
}

impl Steps {
    fn add(&mut self, truth: &Isometry3<f64>, pose: &Isometry3<f64>, ack: &FrameAck) {
        if let Some([true_keyframe, keyframe]) = &self.keyframe {
            let expected = true_keyframe.inverse() * truth;
            let error = expected.inverse() * keyframe.inverse() * pose;
            assert_eq!(ack.pose_covariance.len(), 36, "{ack:?}");
            let world = Matrix6::from_row_slice(&ack.pose_covariance);
            let adjoint = adjoint(&pose.inverse());
            let covariance = adjoint * world * adjoint.transpose();
            self.frames += 1;
            self.squares[0] += error.translation.vector.norm_squared();
            self.squares[1] += (0..3).map(|i| covariance[(i, i)]).sum::<f64>();
        }
        if ack.keyframe {
            self.keyframe = Some([*truth, *pose]);
        }
    }

    fn metres(&self) -> [f64; 2] {
        self.squares.map(|sum| (sum / self.frames.max(1) as f64).sqrt())
    }
}

/// Streams a data set whose first pose alone is given.
async fn walk(dataset: Box<dyn Dataset>, config: Config) -> Walk {
    let server = Server::start(config).await;
    let dataset: Arc<dyn Dataset> = Arc::from(dataset);
    let spec = MapSpec {
        map: "walk".into(),
        cameras: dataset.cameras(),
        depth_unit_metres: dataset.depth_unit_metres(),
        poses: Poses::Estimate,
        label_texts: Vec::new(),
    };
    let FrameStream { frames, mut acks, .. } =
        FrameStream::open(&server.grpc, &Access::default(), spec, 4)
            .await
            .expect("the stream opens");
    let sent = dataset.clone();
    let sending = tokio::spawn(async move {
        for index in 0..sent.len() {
            let mut frame = sent.frame(index).expect("it is read");
            if index > 0 {
                frame.world_from_camera = None;
            }
            assert!(frames.send(frame).await, "the stream is open");
        }
    });
    let (mut walk, mut squares, mut steps) = (Walk::default(), 0.0, Steps::default());
    while let Some(ack) = acks.next().await.expect("the stream ends well") {
        let truth = dataset.moment(walk.frames).expect("it is read").world_from_camera;
        walk.frames += 1;
        let (truth, pose) = (truth.expect("poses are known"), found(&ack));
        walk.ends_found = pose.is_some();
        let Some(pose) = pose else {
            walk.lost += 1;
            continue;
        };
        steps.add(&truth, &pose, &ack);
        let error = truth.inverse() * pose;
        let metres = error.translation.vector.norm();
        squares += metres * metres;
        walk.worst_metres = walk.worst_metres.max(metres);
        walk.worst_radians = walk.worst_radians.max(error.rotation.angle());
    }
    sending.await.expect("all is sent");
    assert_eq!(walk.frames, dataset.len());
    walk.rms_metres = (squares / (walk.frames - walk.lost).max(1) as f64).sqrt();
    walk.step_metres = steps.metres();
    println!("{}: {walk:?}", dataset.name());
    server.stop().await;
    walk
}

/// The pose of an acknowledgement; `None` if the frame is lost.
fn found(ack: &FrameAck) -> Option<Isometry3<f64>> {
    if !matches!(ack.status(), FrameStatus::Tracked | FrameStatus::Relocalised) {
        assert_eq!(ack.status(), FrameStatus::Lost, "{ack:?}");
        return None;
    }
    let pose = ack.world_from_camera.as_ref()?;
    let (q, t) = (pose.rotation.as_ref()?, pose.translation_metres.as_ref()?);
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(q.w, q.x, q.y, q.z));
    Some(Isometry3::from_parts(Translation3::new(t.x, t.y, t.z), rotation))
}

/// `factor`: of the largest errors of single frames.
fn assert_right(walk: &Walk, most_rms_metres: f64, factor: f64) {
    assert!(walk.worst_metres < factor * MOST_METRES, "a wrong pose is believed: {walk:?}");
    assert!(walk.worst_radians < factor * MOST_RADIANS, "a wrong pose is believed: {walk:?}");
    assert!(walk.rms_metres < most_rms_metres, "{walk:?}");
    assert!(walk.ends_found && walk.lost * 4 < walk.frames, "lost for good: {walk:?}");
    assert!(walk.is_sure_rightly(), "the covariances are wrong: {walk:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn few_frames_of_a_walk_are_tracked_or_lost_and_never_wrong() {
    for name in ROOMS {
        for stride in [8, 14] {
            let Some(dataset) = room(name, every(stride)) else { return };
            assert_right(&walk(dataset, config()).await, MOST_RMS_METRES, 1.0);
        }
    }
    let Some(dataset) = room(ROOMS[0], every(14)) else { return };
    let credulous = walk(dataset, credulous()).await;
    assert!(credulous.worst_metres > 10.0 * MOST_METRES, "negative control: {credulous:?}");
    assert!(!credulous.is_sure_rightly(), "negative control: {credulous:?}");
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "takes many minutes: make soak"]
async fn many_frames_of_a_walk_are_tracked() {
    for name in ROOMS {
        for stride in [4, 1] {
            let Some(dataset) = room(name, every(stride)) else { return };
            assert_right(&walk(dataset, config()).await, MOST_RMS_METRES, 1.0);
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "takes many minutes: make soak"]
async fn simulated_sensors_are_tracked() {
    let sensed = |name, preset: Preset| {
        let range = FrameRange { end: Some(SENSED_FRAMES), ..FrameRange::default() };
        let dataset: Box<dyn Dataset> = Box::new(Sensed::new(room(name, range)?, preset, 1, 0));
        Some(dataset)
    };
    for name in ROOMS {
        for (preset, factor) in [(KINECT, 2.0), (D435, 1.0), (TOF, 1.0), (PHONE, 1.0)] {
            let Some(dataset) = sensed(name, preset) else { return };
            assert_right(&walk(dataset, config()).await, factor * MOST_SENSED_RMS_METRES, SENSED);
        }
    }
}
