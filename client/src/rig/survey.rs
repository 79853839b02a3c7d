//! What the topics of a robot hold.

use super::tree::Tree;
use crate::messages::{Calibration, Content, Decoder, Gravity, Kind, Posed, Reading, Transform};
use std::collections::BTreeMap;

/// What the topics hold, as far as their messages were shown to it.
#[derive(Clone, Debug, Default)]
pub struct Survey {
    pub(super) topics: BTreeMap<String, Seen>,
    pub(super) tree: Tree,
    /// Whether transforms came in messages of ROS.
    pub(super) has_ros_transforms: bool,
}

/// What a topic holds.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    pub decoder: Decoder,
    pub messages: u64,
    pub picture: Option<PictureSeen>,
    pub calibration: Option<Calibration>,
    /// Poses of topics that are no tree, by time.
    pub poses: Vec<Transform>,
    pub gravity: Vec<Gravity>,
    /// Why a picture cannot be used.
    pub problem: Option<String>,
}

/// The first picture of a topic.
#[derive(Clone, Debug)]
pub(super) struct PictureSeen {
    pub content: Content,
    pub size: (u32, u32),
    pub frame_id: String,
}

impl Survey {
    /// Adds a topic; its messages may follow.
    pub fn add(&mut self, topic: &str, decoder: Decoder) {
        self.topics.entry(topic.to_owned()).or_insert_with(|| Seen {
            decoder,
            messages: 0,
            picture: None,
            calibration: None,
            poses: Vec::new(),
            gravity: Vec::new(),
            problem: None,
        });
    }

    /// Takes a message of a topic that was added. Its time is set.
    pub fn take(&mut self, topic: &str, reading: Reading<'_>) {
        let Some(seen) = self.topics.get_mut(topic) else { return };
        seen.messages += 1;
        match reading {
            Reading::Picture(picture) if seen.picture.is_none() => {
                let found = picture.content().and_then(|content| Ok((content, picture.size()?)));
                match found {
                    Ok((_, (0, _) | (_, 0))) => seen.problem = Some("it has no pixels".into()),
                    Ok((content, size)) => {
                        let frame_id = picture.frame_id;
                        seen.picture = Some(PictureSeen { content, size, frame_id });
                    }
                    Err(error) => seen.problem = Some(error.to_string()),
                }
            }
            Reading::Picture(_) => {}
            Reading::Calibration(calibration) => {
                seen.calibration.get_or_insert(calibration);
            }
            Reading::Transforms(all) if seen.decoder.kind() == Kind::Transforms => {
                self.has_ros_transforms |= seen.decoder.is_ros();
                let is_fixed = is_fixed(topic);
                all.iter().for_each(|transform| self.tree.add(transform, is_fixed));
            }
            Reading::Transforms(all) => seen.poses.extend(all),
            Reading::Pose(posed) => seen.poses.push(unnamed(posed)),
            Reading::Gravity(gravity) => seen.gravity.extend(gravity),
        }
    }

    /// The decoder of a topic that was added.
    pub fn decoder(&self, topic: &str) -> Option<Decoder> {
        self.topics.get(topic).map(|seen| seen.decoder)
    }

    /// Remembers why a message of a topic cannot be read.
    pub fn damaged(&mut self, topic: &str, reason: String) {
        if let Some(seen) = self.topics.get_mut(topic) {
            seen.problem.get_or_insert(reason);
        }
    }
}

/// Whether the transforms of a topic hold at all times.
pub(super) fn is_fixed(topic: &str) -> bool {
    topic.ends_with("tf_static")
}

/// A pose as the transform of a frame without a name.
pub(super) fn unnamed(posed: Posed) -> Transform {
    let Posed { nanos, frame_id: parent, pose: parent_from_child } = posed;
    Transform { nanos, parent, child: String::new(), parent_from_child }
}
