//! Reading all files of a data directory without changing one, to find damage.

use super::checkpoints::{self, CheckpointFault, CheckpointReader};
use super::directory::maps_in;
use super::error::StoreError;
use super::reader::{Entry, Reader};
use super::recording;
use lexsplat_proto::v1::frame_message::Message;
use std::path::Path;

/// What was found in the folder of a map.
pub(crate) struct MapReport {
    pub map: String,
    pub files: usize,
    /// Frames that can be read.
    pub frames: u64,
    /// The frame that the newest whole checkpoint is through.
    pub checkpoint: Option<u64>,
    /// Each damaged file, with what is wrong with it.
    pub damages: Vec<String>,
}

/// What is in one file of a recording.
pub(super) struct FileReport {
    pub frames: u64,
    /// First byte and end of what cannot be read.
    pub damages: Vec<(u64, u64)>,
}

impl FileReport {
    /// Reads a file.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub fn read(path: &Path) -> Result<Self, StoreError> {
        let mut reader = Reader::open(path)?;
        let mut report = Self { frames: 0, damages: Vec::new() };
        while let Some(entry) = reader.next()? {
            match entry {
                Entry::Message(Message::Open(_)) => {}
                Entry::Message(Message::Frame(_)) => report.frames += 1,
                Entry::Damage(damage) => report.damages.push((damage.from_byte, damage.to_byte)),
            }
        }
        Ok(report)
    }
}

/// Examines every map of a data directory, by name. The directory may be in use.
///
/// # Errors
/// [`StoreError::Io`] if a folder cannot be listed.
pub(crate) fn examine(data: &Path) -> Result<Vec<MapReport>, StoreError> {
    maps_in(data)?.into_iter().map(|(map, folder)| examine_map(map, &folder)).collect()
}

fn examine_map(map: String, folder: &Path) -> Result<MapReport, StoreError> {
    let mut report = MapReport { map, files: 0, frames: 0, checkpoint: None, damages: Vec::new() };
    let called = |path: &Path| path.file_name().unwrap_or_default().display().to_string();
    for path in recording::files(folder)? {
        report.files += 1;
        match FileReport::read(&path) {
            Ok(file) => {
                report.frames += file.frames;
                let words =
                    |(from, to)| format!("{}: bytes {from} to {to} are damaged", called(&path));
                report.damages.extend(file.damages.into_iter().map(words));
            }
            Err(error) => report.damages.push(format!("{}: {}", called(&path), error.reason())),
        }
    }
    for path in recording::damaged(folder)? {
        report.damages.push(format!("{}: was damaged and set aside", called(&path)));
    }
    for path in checkpoints::list(folder)? {
        let through = CheckpointReader::open(&path).and_then(|reader| {
            let through = reader.label().through;
            reader.finish().map(|()| through)
        });
        match through {
            Ok(through) => report.checkpoint = report.checkpoint.max(Some(through)),
            // It is replaced at the next start.
            Err(CheckpointFault::OtherVersion(_)) => {}
            Err(fault) => report.damages.push(format!("{}: {fault}", called(&path))),
        }
    }
    Ok(report)
}
