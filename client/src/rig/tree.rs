//! The tree of frames of coordinates that ROS calls TF.

use super::track::Track;
use crate::messages::Transform;
use nalgebra::Isometry3;
use std::collections::HashMap;

/// Frames deeper than this in the tree are a circle.
const DEEPEST: usize = 100;

/// Frames of coordinates, each placed in its parent over time.
#[derive(Clone, Debug, Default)]
pub(super) struct Tree {
    /// By the child's name.
    tracks: HashMap<String, Track>,
}

/// A frame's name; early versions of ROS put a slash before it.
pub(super) fn plain(frame: &str) -> &str {
    frame.trim_start_matches('/')
}

impl Tree {
    /// Adds a transform; a frame that gets another parent moves there. `is_fixed`: it holds at all times.
    pub(super) fn add(&mut self, transform: &Transform, is_fixed: bool) {
        let (parent, child) = (plain(&transform.parent), plain(&transform.child));
        if parent == child || child.is_empty() {
            return;
        }
        match self.tracks.get_mut(child) {
            Some(track) if track.parent == parent => {
                track.add(transform.nanos, transform.parent_from_child);
            }
            _ => {
                let mut track = Track::new(parent.to_owned(), is_fixed);
                track.add(transform.nanos, transform.parent_from_child);
                self.tracks.insert(child.to_owned(), track);
            }
        }
    }

    /// Puts a frame elsewhere.
    pub(super) fn put(&mut self, child: &str, track: Track) {
        self.tracks.insert(plain(child).to_owned(), track);
    }

    /// Forgets what is not needed for later times.
    pub(super) fn forget_before(&mut self, nanos: u64) {
        self.tracks.values_mut().for_each(|track| track.forget_before(nanos));
    }

    /// A frame and those above it.
    pub(super) fn ancestors<'a>(&'a self, frame: &'a str) -> Vec<&'a str> {
        let mut path = vec![plain(frame)];
        while let Some(track) = self.tracks.get(path[path.len() - 1]) {
            if path.len() > DEEPEST || path.contains(&&*track.parent) {
                break;
            }
            path.push(&track.parent);
        }
        path
    }

    /// Whether a frame was seen to move within one above it.
    pub(super) fn moves(&self, ancestor: &str, frame: &str) -> bool {
        self.below(ancestor, frame).any(|track| track.moves())
    }

    /// Until when the place of a frame within one above it is known, nanoseconds.
    pub(super) fn reaches(&self, ancestor: &str, frame: &str) -> u64 {
        self.below(ancestor, frame).map(Track::reaches).min().unwrap_or(u64::MAX)
    }

    fn below<'a>(&'a self, ancestor: &'a str, frame: &'a str) -> impl Iterator<Item = &'a Track> {
        let path = self.ancestors(frame).into_iter();
        let path = path.take_while(move |frame| *frame != plain(ancestor));
        path.filter_map(|frame| self.tracks.get(frame))
    }

    /// The pose of `source` in `target` at a time.
    ///
    /// # Errors
    /// What is missing, in words.
    pub(super) fn lookup(
        &self,
        target: &str,
        source: &str,
        nanos: u64,
    ) -> Result<Isometry3<f64>, String> {
        let (from, to) = (self.ancestors(source), self.ancestors(target));
        let Some(common) = from.iter().find(|frame| to.contains(frame)) else {
            return Err(format!("no transforms connect {} with {}", plain(source), plain(target)));
        };
        let from = self.along(&from, common, nanos)?;
        Ok(self.along(&to, common, nanos)?.inverse() * from)
    }

    /// The pose of the first frame of a path in one on it.
    fn along(&self, path: &[&str], end: &str, nanos: u64) -> Result<Isometry3<f64>, String> {
        let mut pose = Isometry3::identity();
        for frame in path.iter().take_while(|frame| **frame != end) {
            let track = &self.tracks[*frame];
            let step = track.at(nanos).ok_or_else(|| {
                let seconds = nanos as f64 / 1e9;
                format!("no transform from {frame} to {} near {seconds:.3} s", track.parent)
            })?;
            pose = step * pose;
        }
        Ok(pose)
    }
}
