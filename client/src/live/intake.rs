//! Messages of a robot become frames.
//!
//! First topics are looked at, then some are chosen, and then each color picture waits for its depth and,
//! if poses are given, for its pose. In: messages. Out: frames, in the order of color. Nothing here knows
//! networks.

use super::board::BridgeProgress;
use crate::dataset::RgbdFrame;
use crate::messages::{DEPTH_UNIT_METRES, Decoder, Kind, MessageError, Picture, Reading};
use crate::rig::{Rig, Survey, Wanted, frame_pictures, window};
use crate::stream::{MapSpec, Poses};
use std::collections::VecDeque;
use tokio_tungstenite::tungstenite::Bytes;

/// Pictures of a kind that wait.
const MOST_WAITING: usize = 64;
/// Times of pictures from which their usual distance is taken.
const TIMES: usize = 30;
/// How long a color picture waits for its depth, in time of the pictures, nanoseconds.
const DEPTH_PATIENCE_NANOS: u64 = 500_000_000;
/// How long it waits for its pose.
const POSE_PATIENCE_NANOS: u64 = 1_000_000_000;
/// A picture that is so much older than one before it comes from a clock that was set back.
const SET_BACK_NANOS: u64 = 1_000_000_000;

/// A message as it came.
#[derive(Clone)]
pub(super) struct Arrived {
    pub topic: String,
    pub decoder: Decoder,
    /// When it came, nanoseconds.
    pub nanos: u64,
    pub payload: Bytes,
}

/// Topics that are looked at, or frames that are made of them.
pub(super) struct Intake {
    wanted: Wanted,
    poses: Option<Poses>,
    survey: Survey,
    running: Option<Running>,
}

/// The chosen topics at work.
struct Running {
    rig: Rig,
    needs_poses: bool,
    colors: Queue,
    depths: Queue,
}

/// Pictures of a topic that wait, by time.
#[derive(Default)]
struct Queue {
    waiting: VecDeque<Kept>,
    times: VecDeque<u64>,
}

struct Kept {
    /// When it was taken.
    nanos: u64,
    arrived: Arrived,
}

impl Intake {
    pub(super) fn new(wanted: &Wanted, poses: Option<Poses>) -> Self {
        Self { wanted: wanted.clone(), poses, survey: Survey::default(), running: None }
    }

    /// Whether topics are chosen.
    pub(super) fn is_running(&self) -> bool {
        self.running.is_some()
    }

    /// Whether messages of a topic are of use.
    pub(super) fn needs(&self, topic: &str, decoder: Decoder) -> bool {
        if decoder.kind() != Kind::Picture {
            return true;
        }
        match &self.running {
            Some(Running { rig, .. }) => topic == rig.color_topic() || topic == rig.depth_topic(),
            None => match (&self.wanted.color, &self.wanted.depth) {
                (Some(color), Some(depth)) => topic == color || topic == depth,
                _ => true,
            },
        }
    }

    /// Takes a message.
    pub(super) fn take(&mut self, arrived: Arrived, counts: &mut BridgeProgress) {
        let payload = arrived.payload.clone();
        let reading = match arrived.decoder.read(&payload) {
            Ok(reading) => reading.received(arrived.nanos),
            Err(error) => {
                counts.damaged += 1;
                return self.survey.damaged(&arrived.topic, error.to_string());
            }
        };
        let Some(running) = &mut self.running else {
            self.survey.add(&arrived.topic, arrived.decoder);
            return self.survey.take(&arrived.topic, reading);
        };
        match reading {
            Reading::Picture(picture) => running.keep(picture.nanos, arrived, counts),
            other => running.rig.take(&arrived.topic, other),
        }
    }

    /// Chooses topics by what was seen of them. Returns the map to open, and what was concluded.
    ///
    /// # Errors
    /// What is missing, in words.
    pub(super) fn choose(&mut self, map: &str) -> Result<(MapSpec, Vec<String>), String> {
        let rig = Rig::of(&self.survey, &self.wanted).map_err(|error| error.to_string())?;
        let poses = match self.poses {
            None if rig.has_poses() => Poses::Given,
            None => Poses::Estimate,
            Some(poses) => poses,
        };
        let notes = rig.notes().to_vec();
        if poses == Poses::Given && !rig.has_poses() {
            let reason = notes.into_iter().find(|note| note.starts_with("no poses"));
            let reason = reason.unwrap_or_else(|| "no poses".into());
            return Err(format!("{reason}; the server can estimate them (--poses estimate)"));
        }
        let spec = MapSpec {
            map: map.to_owned(),
            cameras: rig.cameras().clone(),
            depth_unit_metres: DEPTH_UNIT_METRES,
            poses,
            label_texts: Vec::new(),
        };
        let (colors, depths) = (Queue::default(), Queue::default());
        let needs_poses = poses == Poses::Given;
        self.running = Some(Running { rig, needs_poses, colors, depths });
        self.survey = Survey::default();
        Ok((spec, notes))
    }

    /// The frames that are whole. They have no numbers yet.
    pub(super) fn frames(&mut self, counts: &mut BridgeProgress) -> Vec<RgbdFrame> {
        let mut frames = Vec::new();
        if let Some(running) = &mut self.running {
            while let Some(color) = running.due(counts) {
                frames.extend(running.frame(&color, counts));
            }
        }
        frames
    }
}

impl Queue {
    fn newest(&self) -> u64 {
        self.waiting.back().map_or(0, |kept| kept.nanos)
    }

    /// Keeps a picture; returns how many had to go.
    fn push(&mut self, nanos: u64, arrived: Arrived) -> u64 {
        let place = self.waiting.partition_point(|kept| kept.nanos <= nanos);
        self.waiting.insert(place, Kept { nanos, arrived });
        self.times.push_back(nanos);
        if self.times.len() > TIMES {
            self.times.pop_front();
        }
        let more = self.waiting.len().saturating_sub(MOST_WAITING);
        self.waiting.drain(..more);
        more as u64
    }
}

impl Running {
    fn keep(&mut self, nanos: u64, arrived: Arrived, counts: &mut BridgeProgress) {
        let is_color = arrived.topic == self.rig.color_topic();
        if !is_color && arrived.topic != self.rig.depth_topic() {
            return;
        }
        let newest = self.colors.newest().max(self.depths.newest());
        if nanos.saturating_add(SET_BACK_NANOS) < newest {
            counts.unpaired += self.colors.waiting.len() as u64;
            (self.colors, self.depths) = (Queue::default(), Queue::default());
        }
        if is_color {
            counts.colors += 1;
            counts.unpaired += self.colors.push(nanos, arrived);
        } else {
            counts.depths += 1;
            self.depths.push(nanos, arrived);
        }
    }

    /// The oldest color picture, once its depth and its pose are there or will not come.
    fn due(&mut self, counts: &mut BridgeProgress) -> Option<Kept> {
        loop {
            let nanos = self.colors.waiting.front()?.nanos;
            let age = self.colors.newest().max(self.depths.newest()).saturating_sub(nanos);
            let has_later = self.depths.newest() >= nanos;
            if !has_later && age < DEPTH_PATIENCE_NANOS {
                return None;
            }
            if self.nearest(nanos).is_none() {
                self.colors.waiting.pop_front();
                counts.unpaired += 1;
                continue;
            }
            let has_pose = !self.needs_poses || self.rig.poses_reach(nanos);
            return if has_pose || age >= POSE_PATIENCE_NANOS {
                self.colors.waiting.pop_front()
            } else {
                None
            };
        }
    }

    /// The place of the depth that belongs to a time.
    fn nearest(&self, nanos: u64) -> Option<usize> {
        let times = |queue: &Queue| queue.times.iter().copied().collect::<Vec<u64>>();
        let within = window(&times(&self.colors), &times(&self.depths));
        let apart = self.depths.waiting.iter().map(|kept| kept.nanos.abs_diff(nanos));
        let (apart, place) = apart.zip(0..).min()?;
        (apart <= within).then_some(place)
    }

    /// The frame of a color picture that is due.
    fn frame(&mut self, color: &Kept, counts: &mut BridgeProgress) -> Option<RgbdFrame> {
        let place = self.nearest(color.nanos)?;
        let depth = self.depths.waiting.drain(..=place).next_back()?;
        let shot = self.rig.shot(0, color.nanos, depth.nanos);
        let made = picture(&color.arrived).and_then(|color| {
            let both = frame_pictures(self.rig.cameras(), &color, &picture(&depth.arrived)?)?;
            Ok(shot.frame(both))
        });
        self.rig.forget_before(color.nanos.saturating_sub(POSE_PATIENCE_NANOS));
        match made {
            Err(_) => counts.damaged += 1,
            Ok(frame) if self.needs_poses && frame.world_from_camera.is_none() => {
                counts.without_pose += 1;
            }
            Ok(frame) => {
                counts.frames += 1;
                return Some(frame);
            }
        }
        None
    }
}

fn picture(arrived: &Arrived) -> Result<Picture<'_>, MessageError> {
    match arrived.decoder.read(&arrived.payload)?.received(arrived.nanos) {
        Reading::Picture(picture) => Ok(picture),
        _ => unreachable!("only pictures wait"),
    }
}
