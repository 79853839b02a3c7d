//! Recordings whose topics are put together by [`rig`](crate::rig).

use super::files::Files;
use super::look::{Look, Met};
use crate::dataset::{Cameras, Dataset, DatasetError, Intrinsics, Moment, RgbdFrame, name_of};
use crate::messages::{DEPTH_UNIT_METRES, Decoder, MessageError, Picture, Reading};
use crate::rig::{Rig, Wanted, pair, window};
use nalgebra::Isometry3;
use std::path::{Path, PathBuf};

/// An MCAP file, or a folder of such files that were written one after the other.
///
/// # Errors
/// [`DatasetError`] if nothing can be read, or the topics give no RGB-D frames.
pub fn mcap(path: &Path, wanted: &Wanted) -> Result<Box<dyn Dataset>, DatasetError> {
    open(path, Files::mcap(path)?, wanted)
}

/// A bag of ROS 2: its folder, or one of its files.
///
/// # Errors
/// [`DatasetError`] if nothing can be read, or the topics give no RGB-D frames.
pub fn rosbag2(path: &Path, wanted: &Wanted) -> Result<Box<dyn Dataset>, DatasetError> {
    open(path, Files::rosbag2(path)?, wanted)
}

fn open(path: &Path, files: Files, wanted: &Wanted) -> Result<Box<dyn Dataset>, DatasetError> {
    let name = named(path);
    let mut look = Look::through(&files)?;
    if let Some(own) = std::mem::take(&mut look.own).opened() {
        return Ok(Box::new(own.dataset(path, name, files, look.problems, wanted)?));
    }
    Ok(Box::new(Bag::new(path, name, files, look, wanted)?))
}

/// The map's name: that of the folder or file, without its extension.
fn named(path: &Path) -> String {
    let is_file = path.extension().is_some_and(|e| e == "mcap" || e == "db3");
    name_of(&if is_file { path.with_extension("") } else { path.to_owned() })
}

/// Frames of chosen topics.
struct Bag {
    path: PathBuf,
    name: String,
    files: Files,
    rig: Rig,
    decoders: [Decoder; 2],
    frames: Vec<Paired>,
    skipped: Vec<String>,
    notes: Vec<String>,
}

/// A frame: the number of its color picture, both pictures and the pose.
struct Paired {
    sequence: u64,
    color: Met,
    depth: Met,
    world_from_camera: Result<Isometry3<f64>, String>,
}

impl Bag {
    fn new(
        path: &Path,
        name: String,
        files: Files,
        mut look: Look,
        wanted: &Wanted,
    ) -> Result<Self, DatasetError> {
        let rig = Rig::of(&look.survey, wanted).map_err(|error| {
            let unread = look.unread();
            let unread = if unread.is_empty() { unread } else { format!("; not read: {unread}") };
            let problem = look.problems.first().map_or(String::new(), |p| format!("; {p}"));
            DatasetError::content(path, format!("{error}{unread}{problem}"))
        })?;
        let topics = [rig.color_topic(), rig.depth_topic()];
        let decoders = topics.map(|topic| look.survey.decoder(topic).expect("it was chosen"));
        let [colors, depths] = topics.map(|topic| {
            let mut met = look.pictures.remove(topic).unwrap_or_default();
            met.sort_by_key(|met| met.nanos);
            met
        });
        let times =
            [&colors, &depths].map(|all| all.iter().map(|met| met.nanos).collect::<Vec<_>>());
        let within = window(&times[0], &times[1]);
        let pairs = pair(&times[0], &times[1], within);
        let frames: Vec<Paired> = pairs
            .iter()
            .map(|&(at, depth)| {
                let (color, depth) = (colors[at], depths[depth]);
                let world_from_camera = rig.pose_at(color.nanos);
                Paired { sequence: at as u64, color, depth, world_from_camera }
            })
            .collect();
        let skipped = unpaired(rig.color_topic(), &colors, &frames, within);
        if frames.is_empty() {
            let first = skipped.first().map_or("there are no pictures", String::as_str);
            let nearest = nearest_seconds(&times[0], &times[1]);
            let nearest =
                nearest.map_or(String::new(), |s| format!(" (the nearest is {s:.3} s away)"));
            return Err(DatasetError::content(path, format!("no frames: {first}{nearest}")));
        }
        let unread = look.unread_pictures();
        let unread = (!unread.is_empty()).then(|| format!("not read: {unread}"));
        let notes = rig.notes().iter().cloned().chain(unread).chain(look.problems).collect();
        let path = path.to_owned();
        Ok(Self { path, name, files, rig, decoders, frames, skipped, notes })
    }

    fn read(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        let Paired { sequence, color, depth, world_from_camera } = &self.frames[index];
        let bytes = [self.files.read(color.place)?, self.files.read(depth.place)?];
        let made = || {
            let color = picture(self.decoders[0], &bytes[0], *color)?;
            let depth = picture(self.decoders[1], &bytes[1], *depth)?;
            self.rig.frame(*sequence, &color, &depth)
        };
        let frame = made().map_err(|error: MessageError| {
            DatasetError::content(&self.path, format!("picture {sequence}: {error}"))
        })?;
        let world_from_camera = world_from_camera.as_ref().ok().copied();
        Ok(RgbdFrame { world_from_camera, ..frame })
    }
}

/// How near color and depth come to each other in time, seconds.
fn nearest_seconds(colors: &[u64], depths: &[u64]) -> Option<f64> {
    let near = |color: &u64| {
        let later = depths.partition_point(|depth| depth < color);
        let around = &depths[later.saturating_sub(1)..depths.len().min(later + 1)];
        around.iter().map(|depth| depth.abs_diff(*color)).min()
    };
    colors.iter().filter_map(near).min().map(|nanos| nanos as f64 / 1e9)
}

/// Why color pictures have no depth.
fn unpaired(topic: &str, colors: &[Met], frames: &[Paired], within: u64) -> Vec<String> {
    let mut paired = frames.iter().map(|frame| frame.sequence).peekable();
    let alone = (0..colors.len() as u64).filter(|at| paired.next_if_eq(at).is_none());
    let milliseconds = within as f64 / 1e6;
    alone
        .map(|at| {
            format!("{topic}: picture {at}: expected depth at most {milliseconds:.0} ms away, found none")
        })
        .collect()
}

fn picture(decoder: Decoder, data: &[u8], met: Met) -> Result<Picture<'_>, MessageError> {
    match decoder.read(data)?.received(met.nanos) {
        Reading::Picture(picture) => Ok(picture),
        _ => unreachable!("the topic has pictures"),
    }
}

impl Dataset for Bag {
    fn name(&self) -> &str {
        &self.name
    }

    fn len(&self) -> usize {
        self.frames.len()
    }

    fn intrinsics(&self) -> Intrinsics {
        self.rig.cameras().color.intrinsics
    }

    fn cameras(&self) -> Cameras {
        self.rig.cameras().clone()
    }

    fn depth_unit_metres(&self) -> f64 {
        DEPTH_UNIT_METRES
    }

    fn sequence(&self, index: usize) -> u64 {
        self.frames[index].sequence
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        self.read(index)
    }

    fn moment(&self, index: usize) -> Result<Moment, DatasetError> {
        let Paired { color, world_from_camera, .. } = &self.frames[index];
        let world_from_camera = world_from_camera.as_ref().ok().copied();
        Ok(Moment { timestamp_nanos: color.nanos, world_from_camera })
    }

    fn no_pose(&self, index: usize) -> Option<&str> {
        self.frames[index].world_from_camera.as_ref().err().map(String::as_str)
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }
}
