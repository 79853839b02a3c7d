//! Recordings whose topics are put together by [`rig`](crate::rig).

use super::compressed;
use super::files::Files;
use super::look::{Look, Met};
use crate::dataset::{
    Cameras, Color, Dataset, DatasetError, Depth, Pictures, Recording, Shot, name_of,
};
use crate::messages::{DEPTH_UNIT_METRES, Decoder, MessageError, Picture, Reading};
use crate::rig::{Rig, Wanted, frame_pictures, pair, window};
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
        return Ok(Box::new(own.recording(path, name, files, look.problems, wanted)?));
    }
    Ok(Box::new(recording(path, name, files, look, wanted)?))
}

/// The map's name: that of the folder or file, without its extension.
fn named(path: &Path) -> String {
    let is_file = path.extension().is_some_and(|e| e == "mcap" || e == "db3");
    name_of(&if is_file { path.with_extension("") } else { path.to_owned() })
}

/// Frames of chosen topics.
fn recording(
    path: &Path,
    name: String,
    files: Files,
    mut look: Look,
    wanted: &Wanted,
) -> Result<Recording, DatasetError> {
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
    let times = [&colors, &depths].map(|all| all.iter().map(|met| met.nanos).collect::<Vec<_>>());
    let within = window(&times[0], &times[1]);
    let (shots, frames): (Vec<Shot>, _) = pair(&times[0], &times[1], within)
        .iter()
        .map(|&(at, depth)| {
            let (color, depth) = (colors[at], depths[depth]);
            (rig.shot(at as u64, color.nanos, depth.nanos), [color, depth])
        })
        .unzip();
    let skipped = unpaired(rig.color_topic(), &colors, &shots, within);
    if shots.is_empty() {
        let first = skipped.first().map_or("there are no pictures", String::as_str);
        let nearest = nearest_seconds(&times[0], &times[1]);
        let nearest = nearest.map_or(String::new(), |s| format!(" (the nearest is {s:.3} s away)"));
        return Err(DatasetError::content(path, format!("no frames: {first}{nearest}")));
    }
    let unread = look.unread_pictures();
    let unread = (!unread.is_empty()).then(|| format!("not read: {unread}"));
    let notes = rig.notes().iter().cloned().chain(unread).chain(look.problems).collect();
    let cameras = rig.cameras().clone();
    let stored =
        Stored { path: path.to_owned(), files, cameras: cameras.clone(), decoders, frames };
    Ok(Recording {
        name,
        cameras,
        depth_unit_metres: DEPTH_UNIT_METRES,
        shots,
        pictures: Box::new(stored),
        skipped,
        notes,
    })
}

/// The pictures in the files.
struct Stored {
    path: PathBuf,
    files: Files,
    cameras: Cameras,
    decoders: [Decoder; 2],
    /// Color and depth of each frame.
    frames: Vec<[Met; 2]>,
}

impl Pictures for Stored {
    fn pictures(&self, index: usize, sequence: u64) -> Result<(Color, Depth), DatasetError> {
        let [color, depth] = self.frames[index];
        let bytes = [self.files.read(color.place)?, self.files.read(depth.place)?];
        let made = || {
            let mut space = [Vec::new(), Vec::new()];
            let [for_color, for_depth] = &mut space;
            let color = picture(self.decoders[0], &bytes[0], for_color, color)?;
            let depth = picture(self.decoders[1], &bytes[1], for_depth, depth)?;
            frame_pictures(&self.cameras, &color, &depth)
        };
        made().map_err(|error: MessageError| {
            DatasetError::content(&self.path, format!("picture {sequence}: {error}"))
        })
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
fn unpaired(topic: &str, colors: &[Met], shots: &[Shot], within: u64) -> Vec<String> {
    let mut paired = shots.iter().map(|shot| shot.sequence).peekable();
    let alone = (0..colors.len() as u64).filter(|at| paired.next_if_eq(at).is_none());
    let milliseconds = within as f64 / 1e6;
    alone
        .map(|at| {
            format!("{topic}: picture {at}: expected depth at most {milliseconds:.0} ms away, found none")
        })
        .collect()
}

fn picture<'a>(
    decoder: Decoder,
    data: &'a [u8],
    space: &'a mut Vec<u8>,
    met: Met,
) -> Result<Picture<'a>, MessageError> {
    match compressed::read(decoder, data, space)?.received(met.nanos) {
        Reading::Picture(picture) => Ok(picture),
        _ => unreachable!("the topic has pictures"),
    }
}
