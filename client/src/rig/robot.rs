//! The chosen topics as one camera that moves.

use super::cameras;
use super::choice::{Choice, Chosen};
use super::error::RigError;
use super::poses::Poses;
use super::survey::{Survey, is_fixed, unnamed};
use super::tree::{Tree, plain};
use super::wanted::Wanted;
use crate::dataset::{Cameras, Color, Depth, FrameExtras, Shot};
use crate::messages::{Gravity, Kind, MessageError, Picture, Reading};
use nalgebra::{Isometry3, Vector3};

/// Color and depth that are less apart were taken together, nanoseconds.
const TOGETHER_NANOS: u64 = 1_000_000;
/// Gravity is the mean of what an IMU measures so much before and after a picture, nanoseconds.
const STEADY_NANOS: u64 = 250_000_000;
/// The name of a camera whose pictures name no frame of coordinates.
const NAMELESS: &str = "camera";
/// Up in worlds of ROS (REP 103).
const Z_UP: [f64; 3] = [0.0, 0.0, 1.0];

/// The chosen topics of a robot: cameras, poses, and frames made of pictures.
#[derive(Clone, Debug)]
pub struct Rig {
    color_topic: String,
    depth_topic: String,
    /// The color camera's frame of coordinates.
    camera: String,
    cameras: Cameras,
    notes: Vec<String>,
    tree: Tree,
    poses: Poses,
    /// Topics of odometry that is not used.
    unused: Vec<String>,
    /// The topic of an IMU, if gravity is taken from it.
    imu: Option<String>,
    /// By time.
    gravity: Vec<Gravity>,
}

impl Rig {
    /// Chooses topics by what a survey has seen of them, or as they are wanted.
    ///
    /// # Errors
    /// [`RigError`] if color, depth or a calibration is missing, or what is wanted is not there.
    pub fn of(survey: &Survey, wanted: &Wanted) -> Result<Self, RigError> {
        let choice = Choice::of(survey, wanted)?;
        let mut notes = vec![used("color", &choice.color), used("depth", &choice.depth)];
        let mut cameras = cameras::of(survey, &choice, wanted, &mut notes)?;
        let camera = match plain(&choice.color.picture.frame_id) {
            "" => NAMELESS.to_owned(),
            frame => frame.to_owned(),
        };
        let mut tree = survey.tree.clone();
        let poses = Poses::choose(survey, &mut tree, &camera, wanted)?;
        cameras.up = (poses.is_z_up && poses.world.is_ok()).then_some(Z_UP);
        notes.push(told(&poses, &camera));
        let is_used = |topic: &str| poses.topic.as_ref().is_some_and(|(used, _)| used == topic);
        let odometry =
            survey.topics.iter().filter(|(_, seen)| seen.decoder.kind() == Kind::Odometry);
        let unused =
            odometry.map(|(topic, _)| topic.clone()).filter(|topic| !is_used(topic)).collect();
        let imu = if cameras.up.is_some() { None } else { imu(survey, &tree, &camera) };
        notes.extend(imu.iter().map(|topic| format!("up is taken from {topic}")));
        let gravity = imu.as_ref().map_or(Vec::new(), |topic| survey.topics[topic].gravity.clone());
        let used = [choice.color.topic, choice.depth.topic];
        let pictures =
            survey.topics.iter().filter(|(_, seen)| seen.decoder.kind() == Kind::Picture);
        let aside: Vec<&str> = pictures
            .map(|(topic, _)| topic.as_str())
            .filter(|topic| !used.contains(topic))
            .collect();
        if !aside.is_empty() {
            notes.push(format!("left aside: {}", aside.join(", ")));
        }
        let [color_topic, depth_topic] = used.map(str::to_owned);
        Ok(Self {
            color_topic,
            depth_topic,
            camera,
            cameras,
            notes,
            tree,
            poses,
            unused,
            imu,
            gravity,
        })
    }

    /// The topic of color.
    pub fn color_topic(&self) -> &str {
        &self.color_topic
    }

    /// The topic of depth.
    pub fn depth_topic(&self) -> &str {
        &self.depth_topic
    }

    /// The cameras. Depth of 16 bits is in units of
    /// [`DEPTH_UNIT_METRES`](crate::messages::DEPTH_UNIT_METRES).
    pub fn cameras(&self) -> &Cameras {
        &self.cameras
    }

    /// What was chosen and concluded, in words.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Whether poses are known at all.
    pub fn has_poses(&self) -> bool {
        self.poses.world.is_ok()
    }

    /// Takes a later message, of transforms, poses or an IMU; its time is set.
    pub fn take(&mut self, topic: &str, reading: Reading<'_>) {
        if self.unused.iter().any(|unused| unused == topic) {
            return;
        }
        let is_of_poses = self.poses.topic.as_ref().is_some_and(|(name, _)| name == topic);
        let all = match reading {
            Reading::Transforms(all) => all,
            Reading::Pose(posed) if is_of_poses => vec![unnamed(posed)],
            Reading::Gravity(gravity) if self.imu.as_deref() == Some(topic) => {
                return self.gravity.extend(gravity);
            }
            _ => return,
        };
        for mut transform in all {
            match (&self.poses.topic, &self.poses.world) {
                (Some((_, child)), Ok(world)) if is_of_poses => {
                    transform.child.clone_from(child);
                    transform.parent.clone_from(world);
                }
                // The topic of poses places this frame.
                (Some((_, child)), _) if plain(&transform.child) == child => continue,
                _ => {}
            }
            self.tree.add(&transform, is_fixed(topic));
        }
    }

    /// Forgets what only earlier pictures need.
    pub fn forget_before(&mut self, nanos: u64) {
        self.tree.forget_before(nanos);
        let from = nanos.saturating_sub(STEADY_NANOS);
        self.gravity.retain(|gravity| gravity.nanos >= from);
    }

    /// Whether the pose at a time is known, or messages that are still to come cannot tell it better.
    pub fn poses_reach(&self, nanos: u64) -> bool {
        let world = self.poses.world.as_deref();
        world.map_or(true, |world| self.tree.reaches(world, &self.camera) >= nanos)
    }

    /// The color camera's pose in the world at a time, nanoseconds.
    ///
    /// # Errors
    /// Why there is none, in words.
    pub fn pose_at(&self, nanos: u64) -> Result<Isometry3<f64>, String> {
        let world = self.poses.world.as_ref().map_err(|reason| format!("no poses: {reason}"))?;
        self.tree.lookup(world, &self.camera, nanos)
    }

    /// A frame without its pictures, of color and depth that were taken at these times, nanoseconds.
    pub(crate) fn shot(&self, sequence: u64, color_nanos: u64, depth_nanos: u64) -> Shot {
        let is_apart = depth_nanos.abs_diff(color_nanos) > TOGETHER_NANOS;
        Shot {
            sequence,
            nanos: color_nanos,
            world_from_camera: self.pose_at(color_nanos),
            extras: FrameExtras {
                intrinsics: None,
                depth_timestamp_nanos: is_apart.then_some(depth_nanos),
                up: self.up_at(color_nanos),
            },
        }
    }

    /// The direction up in the color camera's coordinates, if an IMU tells it.
    fn up_at(&self, nanos: u64) -> Option<[f64; 3]> {
        let from = self.gravity.partition_point(|g| g.nanos.saturating_add(STEADY_NANOS) < nanos);
        let near = self.gravity[from..].iter();
        let near = near.take_while(|gravity| gravity.nanos <= nanos.saturating_add(STEADY_NANOS));
        let frame_id = &self.gravity.get(from)?.frame_id;
        let sum: Vector3<f64> = near.map(|gravity| gravity.up).sum();
        let up = sum.try_normalize(1e-6)?;
        let camera_from_imu = self.tree.lookup(&self.camera, frame_id, nanos).ok()?;
        Some((camera_from_imu.rotation * up).into())
    }
}

/// Color and depth of messages, as frames of these cameras have them.
///
/// # Errors
/// [`MessageError`] if a picture is damaged, or has another size than its camera.
pub fn frame_pictures(
    cameras: &Cameras,
    color: &Picture<'_>,
    depth: &Picture<'_>,
) -> Result<(Color, Depth), MessageError> {
    let lens = cameras.color.intrinsics;
    check_size("color", color, (lens.width, lens.height))?;
    check_size("depth", depth, cameras.depth_size())?;
    Ok((color.color()?, depth.depth()?))
}

fn check_size(what: &str, picture: &Picture<'_>, expected: (u32, u32)) -> Result<(), MessageError> {
    let found = picture.size()?;
    if found == expected {
        return Ok(());
    }
    let ((width, height), (w, h)) = (expected, found);
    Err(MessageError::Content(format!("{what}: expected {width}x{height} pixels, found {w}x{h}")))
}

/// The topic of the IMU that the camera is connected with.
fn imu(survey: &Survey, tree: &Tree, camera: &str) -> Option<String> {
    let is_connected =
        |gravity: &Gravity| tree.lookup(camera, &gravity.frame_id, gravity.nanos).is_ok();
    let mut all = survey.topics.iter();
    let found = all.find(|(_, seen)| seen.gravity.first().is_some_and(is_connected));
    found.map(|(topic, _)| topic.clone())
}

fn used(what: &str, chosen: &Chosen) -> String {
    let (width, height) = chosen.picture.size;
    format!("{what} is {} ({width}x{height}, {} messages)", chosen.topic, chosen.messages)
}

fn told(poses: &Poses, camera: &str) -> String {
    match (&poses.world, &poses.topic) {
        (Err(reason), _) => format!("no poses: {reason}"),
        (Ok(world), None) => format!("poses are those of {camera} in {world} (transforms)"),
        (Ok(world), Some((topic, child))) if child == camera => {
            format!(
                "poses are those of {topic} in {world}, taken as the color camera's; pose_frame=FRAME names \
                 another frame"
            )
        }
        (Ok(world), Some((topic, child))) => {
            format!("poses are those of {child} in {world} ({topic}), with {camera} fixed to it")
        }
    }
}
