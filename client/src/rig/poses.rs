//! Choosing where poses come from: transforms (TF), odometry, or a topic of poses.

use super::error::RigError;
use super::survey::{Seen, Survey};
use super::track::Track;
use super::tree::{Tree, plain};
use super::wanted::Wanted;
use crate::messages::Kind;

/// Worlds, best first (REP 105); names may have a robot's name before them.
const WORLDS: [&str; 3] = ["map", "odom", "world"];

/// Where poses come from.
#[derive(Clone, Debug)]
pub(super) struct Poses {
    /// The frame of coordinates that is the world, or why there are no poses.
    pub world: Result<String, String>,
    /// A topic of odometry or poses, and the frame that they are of.
    pub topic: Option<(String, String)>,
    /// The world's z is up, as in worlds of ROS (REP 103).
    pub is_z_up: bool,
}

impl Poses {
    /// Chooses, and puts what a topic says into the tree.
    pub(super) fn choose(
        survey: &Survey,
        tree: &mut Tree,
        camera: &str,
        wanted: &Wanted,
    ) -> Result<Self, RigError> {
        let above = tree.ancestors(camera);
        if let Some(frame) = wanted.pose_frame.as_deref().filter(|f| !above.contains(&plain(f))) {
            let expected = format!("the camera's frame or one above it ({})", above.join(", "));
            let (option, value) = ("pose_frame", frame.to_owned());
            return Err(RigError::Wanted { option, value, expected });
        }
        let search = Search { survey, camera, wanted };
        match wanted.pose.as_deref() {
            Some("none") => Ok(Self::none("none are wanted (pose=none)".into())),
            Some(topic) => search.topic(tree, topic),
            None => search.best(tree),
        }
    }

    fn none(reason: String) -> Self {
        Self { world: Err(reason), topic: None, is_z_up: false }
    }
}

struct Search<'a> {
    survey: &'a Survey,
    /// The color camera's frame.
    camera: &'a str,
    wanted: &'a Wanted,
}

impl Search<'_> {
    /// The topic that is wanted.
    fn topic(&self, tree: &mut Tree, topic: &str) -> Result<Poses, RigError> {
        let seen = self.survey.topics.get(topic);
        let wrong = |expected: String| {
            Err(RigError::Wanted { option: "pose", value: topic.to_owned(), expected })
        };
        let Some(seen) = seen.filter(|seen| has_poses(seen)) else {
            let all = self.survey.topics.iter().filter(|(_, seen)| has_poses(seen));
            let all: Vec<&str> = all.map(|(topic, _)| topic.as_str()).collect();
            return wrong(format!(
                "none, or a topic with transforms or poses ({})",
                all.join(", ")
            ));
        };
        if seen.decoder.kind() == Kind::Transforms {
            return Ok(match self.in_tree(tree, false)? {
                Some(poses) => poses,
                None => Poses::none(self.no_tree(tree)),
            });
        }
        match self.of_topic(tree, topic, seen)? {
            Ok(poses) => Ok(poses),
            Err(reason) => wrong(format!("poses of a frame that the camera hangs on ({reason})")),
        }
    }

    /// Transforms, then odometry, then poses without names.
    fn best(&self, tree: &mut Tree) -> Result<Poses, RigError> {
        if let Some(poses) = self.in_tree(tree, false)? {
            return Ok(poses);
        }
        let mut reasons = vec![self.no_tree(tree)];
        for kind in [Kind::Odometry, Kind::Pose] {
            let all = self.survey.topics.iter();
            let mut all: Vec<_> = all
                .filter(|(_, seen)| seen.decoder.kind() == kind && !seen.poses.is_empty())
                .collect();
            all.sort_by_key(|(_, seen)| std::cmp::Reverse(seen.messages));
            for (topic, seen) in all {
                match self.of_topic(tree, topic, seen)? {
                    Ok(poses) => return Ok(poses),
                    Err(reason) => reasons.push(format!("{topic}: {reason}")),
                }
            }
        }
        // A camera that stands still in a world.
        match self.in_tree(tree, true)? {
            Some(poses) => Ok(poses),
            None => Ok(Poses::none(reasons.join("; "))),
        }
    }

    fn no_tree(&self, tree: &Tree) -> String {
        match &tree.ancestors(self.camera)[..] {
            [] | [_] => format!("no transforms place {}", self.camera),
            [.., root] => {
                format!("transforms place {} in {root} only, where it never moves", self.camera)
            }
        }
    }

    /// The world in the tree in which the camera moves, or stands still.
    fn in_tree(&self, tree: &Tree, may_stand: bool) -> Result<Option<Poses>, RigError> {
        let all = tree.ancestors(self.camera);
        let above = &all[1..];
        let moves = |frame: &str| tree.moves(frame, self.camera);
        let is_named = |frame: &str, name: &str| frame.rsplit('/').next() == Some(name);
        let named = || {
            let found = |name| above.iter().find(|frame| is_named(frame, name)).copied();
            WORLDS.into_iter().filter_map(found).find(|frame| may_stand || moves(frame))
        };
        let world = match self.wanted.world.as_deref() {
            Some(wanted) if above.contains(&plain(wanted)) => Some(plain(wanted)),
            Some(wanted) if !above.is_empty() && may_stand => {
                let expected = format!("a frame above {} ({})", self.camera, above.join(", "));
                return Err(RigError::Wanted { option: "world", value: wanted.into(), expected });
            }
            Some(_) => None,
            None => named().or_else(|| above.last().copied().filter(|root| moves(root))),
        };
        Ok(world.map(|world| Poses {
            world: Ok(world.to_owned()),
            topic: None,
            is_z_up: self.survey.has_ros_transforms,
        }))
    }

    /// Puts what a topic says into the tree; the reason if that does not place the camera.
    fn of_topic(
        &self,
        tree: &mut Tree,
        topic: &str,
        seen: &Seen,
    ) -> Result<Result<Poses, String>, RigError> {
        let Some(first) = seen.poses.first() else { return Ok(Err("it has no poses".into())) };
        let is_named = !first.child.is_empty();
        let wanted = self.wanted.pose_frame.as_deref();
        let child = wanted.unwrap_or(if is_named { &first.child } else { self.camera });
        let child = plain(child).to_owned();
        let above = tree.ancestors(self.camera);
        if !above.contains(&child.as_str()) {
            return Ok(Err(format!("no transforms connect {child} with {}", self.camera)));
        }
        // Some senders put the camera's own name there: then the topic names the world.
        let parent = plain(&first.parent);
        let is_world = !parent.is_empty() && !above.contains(&parent);
        let parent = if is_world { parent } else { plain(topic) }.to_owned();
        let mut track = Track::new(parent.clone(), false);
        seen.poses.iter().for_each(|pose| track.add(pose.nanos, pose.parent_from_child));
        tree.put(&child, track);
        let world = match self.wanted.world.as_deref() {
            Some(wanted) if plain(wanted) != parent => {
                let expected = format!("{parent}, which poses of {topic} are given in");
                return Err(RigError::Wanted { option: "world", value: wanted.into(), expected });
            }
            _ => parent,
        };
        Ok(Ok(Poses {
            world: Ok(world),
            topic: Some((topic.to_owned(), child)),
            is_z_up: is_named && seen.decoder.is_ros(),
        }))
    }
}

fn has_poses(seen: &Seen) -> bool {
    match seen.decoder.kind() {
        Kind::Transforms => seen.messages > 0,
        Kind::Odometry | Kind::Pose => !seen.poses.is_empty(),
        Kind::Picture | Kind::Calibration | Kind::Imu => false,
    }
}
