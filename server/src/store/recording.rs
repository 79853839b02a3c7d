//! The recording of one map: the files of its folder, oldest first.

use super::disk::{Disk, RealDisk};
use super::error::StoreError;
use super::reader::{Entry, Reader};
use super::room::Room;
use super::writer::Writer;
use lexsplat_proto::v1::{self, frame_message::Message};
use prost::Message as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::{SystemTime, UNIX_EPOCH};

/// Ending of a recording's files.
const MCAP: &str = ".mcap";
/// What follows it in the name of a damaged file that was set aside; then seconds since 1970.
const DAMAGED: &str = ".mcap.damaged-";
/// Ending of a file that is being repaired.
const REPAIRED: &str = ".mcap.repaired";

/// Numbers of files are smaller, so that there is always a next one.
const NUMBERS: u32 = 1_000_000_000;

/// Whether a file of this name is a recording.
pub(super) fn is_recording(name: &str) -> bool {
    let number = name.strip_suffix(MCAP).and_then(|stem| stem.parse::<u32>().ok());
    number.is_some_and(|number| number < NUMBERS)
}

/// The wanted names in a map's folder, by the number that they begin with.
fn names(folder: &Path, is_wanted: impl Fn(&str) -> bool) -> Result<Vec<String>, StoreError> {
    let failed = |reason| StoreError::io("list", folder, reason);
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        found.extend(name.to_str().filter(|name| is_wanted(name)).map(str::to_owned));
    }
    found.sort_by_key(|name| (number(name), name.clone()));
    Ok(found)
}

/// The number in the name of a file.
fn number(name: &str) -> Option<u32> {
    name.split('.').next()?.parse().ok()
}

/// Whether the map that a recorder writes for was deleted. A map of the same name may be there since.
pub(super) type Life = Arc<RwLock<bool>>;

/// Appends the frames of one stream to a recording. They are in a file of their own, which is made with the
/// first frame. Cheap to clone.
#[derive(Clone)]
pub(crate) struct Recorder {
    disk: Arc<dyn Disk>,
    folder: Arc<PathBuf>,
    open: Arc<v1::OpenMap>,
    room: Arc<Room>,
    life: Life,
    /// `None` before the first frame and after an error.
    writer: Arc<Mutex<Option<Writer>>>,
}

impl Recorder {
    /// A recorder in a map's folder, which is created if needed.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(super) fn new(
        disk: Arc<dyn Disk>,
        folder: PathBuf,
        open: v1::OpenMap,
        room: Arc<Room>,
        life: Life,
    ) -> Result<Self, StoreError> {
        let made = disk
            .create_folder(&folder)
            .and_then(|()| folder.parent().map_or(Ok(()), |parent| disk.sync_folder(parent)));
        made.map_err(|reason| StoreError::io("create", &folder, reason))?;
        let (folder, open) = (Arc::new(folder), Arc::new(open));
        Ok(Self { disk, folder, open, room, life, writer: Arc::default() })
    }

    /// Appends a frame. It is on disk when this returns. After an error a new file is begun with the next
    /// frame, so that recording goes on once there is room again.
    ///
    /// # Errors
    /// [`StoreError`]; then the frame is not in the recording.
    pub(crate) async fn append(&self, frame: v1::Frame) -> Result<(), StoreError> {
        let this = self.clone();
        tokio::task::spawn_blocking(move || this.append_now(frame))
            .await
            .map_err(|_| StoreError::Closed { path: self.folder.to_path_buf() })?
    }

    /// The same on a thread that may wait for the disk.
    ///
    /// # Errors
    /// [`StoreError`]; then the frame is not in the recording.
    pub(super) fn append_now(&self, frame: v1::Frame) -> Result<(), StoreError> {
        // A deletion waits until the frame is written.
        let is_gone = self.life.read().unwrap_or_else(PoisonError::into_inner);
        if *is_gone {
            return Err(StoreError::Closed { path: self.folder.to_path_buf() });
        }
        let map = &self.open.map;
        let bytes = frame.encoded_len() as u64;
        let appended = self.room.admit(map, bytes).and_then(|()| self.write(frame));
        self.room.note(map, &appended);
        appended
    }

    fn write(&self, frame: v1::Frame) -> Result<(), StoreError> {
        let mut writer = self.writer.lock().unwrap_or_else(PoisonError::into_inner);
        let mut open = match writer.take() {
            Some(open) => open,
            None => self.begin()?,
        };
        open.append(frame)?;
        *writer = Some(open);
        Ok(())
    }

    /// Creates the next file.
    fn begin(&self) -> Result<Writer, StoreError> {
        let used = names(&self.folder, |name| name.contains(MCAP))?;
        let newest = used.iter().filter_map(|name| number(name)).max().unwrap_or(0);
        let path = self.folder.join(format!("{:04}{MCAP}", newest.saturating_add(1)));
        let writer = Writer::create(&self.disk, &path, &self.open)?;
        self.disk
            .sync_folder(&self.folder)
            .map_err(|reason| StoreError::io("write to", &self.folder, reason))?;
        Ok(writer)
    }

    /// Finishes the file. Does nothing if there is none.
    pub(crate) async fn finish(&self) {
        let this = self.clone();
        let finished = tokio::task::spawn_blocking(move || this.finish_now());
        if let Ok(Err(error)) = finished.await {
            // All frames are in the file. It is finished at the next start.
            tracing::warn!(%error, "a recording has no index yet");
        }
    }

    /// The same on a thread that may wait for the disk.
    ///
    /// # Errors
    /// [`StoreError`]; all frames are in the file, which has no index yet.
    pub(super) fn finish_now(&self) -> Result<(), StoreError> {
        let writer = self.writer.lock().unwrap_or_else(PoisonError::into_inner).take();
        writer.map_or(Ok(()), Writer::finish)
    }
}

/// Reads a recording from its beginning.
pub(crate) struct Records {
    disk: Arc<dyn Disk>,
    folder: PathBuf,
    /// Files that were not begun, newest first.
    waiting: Vec<String>,
    current: Option<(String, Reader)>,
    /// Whether damage was found in the current file.
    is_damaged: bool,
}

impl Records {
    /// Opens the recording in a map's folder.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(super) fn open(disk: Arc<dyn Disk>, folder: PathBuf) -> Result<Self, StoreError> {
        let mut waiting = names(&folder, is_recording)?;
        waiting.reverse();
        Ok(Self { disk, folder, waiting, current: None, is_damaged: false })
    }

    /// A recording without frames.
    pub(super) fn none() -> Self {
        let (folder, waiting) = (PathBuf::new(), Vec::new());
        Self { disk: Arc::new(RealDisk), folder, waiting, current: None, is_damaged: false }
    }

    /// Frames in the recording, counted by the chunks of its files without reading them: damage is not seen.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn count_frames(&self) -> Result<u64, StoreError> {
        self.waiting.iter().map(|name| Reader::open(&self.folder.join(name))?.count_chunks()).sum()
    }

    /// The next message or damage; `None` at the end. A file that is damaged, or was not finished because
    /// the server was stopped hard, is repaired when it has been read.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn next(&mut self) -> Result<Option<Entry>, StoreError> {
        loop {
            if self.current.is_none() {
                let Some(name) = self.waiting.pop() else { return Ok(None) };
                let reader = Reader::open(&self.folder.join(&name))?;
                self.current = Some((name, reader));
                self.is_damaged = false;
            }
            let Some((name, reader)) = &mut self.current else { continue };
            if let Some(entry) = reader.next()? {
                self.is_damaged |= matches!(entry, Entry::Damage(_));
                return Ok(Some(entry));
            }
            if (self.is_damaged || !reader.is_finished())
                && let Err(error) = repair(&self.disk, &self.folder, name, self.is_damaged)
            {
                // What was read is used. It is tried again at the next start.
                tracing::warn!(%error, "a recording could not be repaired");
            }
            self.current = None;
        }
    }
}

/// Writes a file anew from what can be read of it. A damaged one is set aside; one that only was not finished
/// is replaced.
fn repair(
    disk: &Arc<dyn Disk>,
    folder: &Path,
    name: &str,
    is_damaged: bool,
) -> Result<(), StoreError> {
    let path = folder.join(name);
    let stem = name.trim_end_matches(MCAP);
    let repaired = folder.join(format!("{stem}{REPAIRED}"));
    let io = |action, path| move |reason| StoreError::io(action, path, reason);
    if repaired.exists() {
        disk.remove(&repaired).map_err(io("remove", &repaired))?;
    }
    let has_frames = copy(disk, &path, &repaired).inspect_err(|_| {
        // The disk may be full: a part of a copy would take the last room.
        let _ = disk.remove(&repaired);
    })?;
    if is_damaged {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        let aside = folder.join(format!("{stem}{DAMAGED}{since}"));
        // A second name, so that the recording has a file at every moment.
        disk.link(&path, &aside).map_err(io("set aside", &path))?;
        tracing::error!(file = %aside.display(), "a recording is damaged: what is whole is used, the file was set aside");
    } else {
        tracing::info!(file = %path.display(), "finished a recording that was not closed");
    }
    if has_frames {
        disk.rename(&repaired, &path).map_err(io("replace", &path))?;
    } else {
        disk.remove(&path).map_err(io("remove", &path))?;
    }
    disk.sync_folder(folder).map_err(io("write to", folder))
}

/// Copies what can be read; returns whether there were frames. Without one nothing is written.
fn copy(disk: &Arc<dyn Disk>, from: &Path, to: &Path) -> Result<bool, StoreError> {
    let mut reader = Reader::open(from)?;
    let mut writer: Option<Writer> = None;
    let mut opened = None;
    while let Some(entry) = reader.next()? {
        match entry {
            Entry::Message(Message::Open(open)) => opened = Some(open),
            Entry::Message(Message::Frame(frame)) => {
                let Some(open) = &opened else { continue };
                let mut writing = match writer.take() {
                    Some(writer) => writer,
                    None => Writer::create(disk, to, open)?,
                };
                writing.append(frame)?;
                writer = Some(writing);
            }
            Entry::Damage(_) => {}
        }
    }
    let has_frames = writer.is_some();
    writer.map_or(Ok(()), Writer::finish)?;
    Ok(has_frames)
}

/// The files of a recording, oldest first.
///
/// # Errors
/// [`StoreError::Io`].
pub(super) fn files(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    Ok(names(folder, is_recording)?.iter().map(|name| folder.join(name)).collect())
}

/// The damaged files that were set aside.
///
/// # Errors
/// [`StoreError::Io`].
pub(super) fn damaged(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    Ok(names(folder, |name| name.contains(DAMAGED))?.iter().map(|name| folder.join(name)).collect())
}
