//! The open log of one map: appending with group commit.

use super::error::StoreError;
use super::record::{cut_torn_tail, write_record};
use lexsplat_proto::v1::{self, FrameMessage, frame_message::Message};
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use tokio::sync::{mpsc, watch};

/// Capacity of the queue of frames to write; when it is full the sender waits.
const APPEND_BACKLOG: usize = 16;

/// Sequence of the newest durable frame, or why writing failed.
type Durability = Result<Option<u64>, String>;

/// An open log. Frames still in the queue are written after it is dropped.
pub(crate) struct Log {
    path: PathBuf,
    frames: mpsc::Sender<v1::Frame>,
    durable: watch::Receiver<Durability>,
}

impl Log {
    /// Opens or creates the log at `path`, cuts off an incomplete record, and appends `open`.
    pub(super) fn open(path: PathBuf, open: v1::OpenMap) -> Result<Self, StoreError> {
        let newest = match path.exists() {
            true => cut_torn_tail(&path)?,
            false => None,
        };
        let mut file = OpenOptions::new()
            .append(true)
            .create(true)
            .open(&path)
            .map_err(|reason| StoreError::io("open", &path, reason))?;
        let noted = write_record(&mut file, &FrameMessage { message: Some(Message::Open(open)) })
            .and_then(|()| file.sync_data())
            .and_then(|()| sync_directory(&path));
        noted.map_err(|reason| StoreError::io("write to", &path, reason))?;
        let (frames, waiting) = mpsc::channel(APPEND_BACKLOG);
        let (report, durable) = watch::channel(Ok(newest));
        std::thread::Builder::new()
            .name("frame-log".into())
            .spawn(move || append_until_closed(&mut file, waiting, &report))
            .map_err(|reason| StoreError::io("start a thread for", &path, reason))?;
        Ok(Self { path, frames, durable })
    }

    /// Puts a frame into the queue; waits while the queue is full.
    ///
    /// # Errors
    /// [`StoreError::Failed`] if an earlier frame could not be written.
    pub(crate) async fn append(&self, frame: v1::Frame) -> Result<(), StoreError> {
        self.frames.send(frame).await.map_err(|_| self.failed())
    }

    /// Waits until the frame with this sequence is durable.
    ///
    /// # Errors
    /// [`StoreError::Failed`] if it could not be written.
    pub(crate) async fn durable(&self, sequence: u64) -> Result<(), StoreError> {
        let reached = |state: &Durability| match state {
            Ok(through) => through.is_some_and(|through| through >= sequence),
            Err(_) => true,
        };
        match self.durable.clone().wait_for(reached).await {
            Ok(state) if state.is_ok() => Ok(()),
            _ => Err(self.failed()),
        }
    }

    /// Sequence of the newest durable frame.
    pub(crate) fn durable_through(&self) -> Option<u64> {
        self.durable.borrow().as_ref().ok().copied().flatten()
    }

    fn failed(&self) -> StoreError {
        let reason = match &*self.durable.borrow() {
            Err(reason) => reason.clone(),
            Ok(_) => "the log's thread ended".into(),
        };
        StoreError::Failed { path: self.path.clone(), reason }
    }
}

/// Body of the log's thread: appends queued frames, syncs, reports the newest durable sequence.
fn append_until_closed(
    file: &mut File,
    mut waiting: mpsc::Receiver<v1::Frame>,
    report: &watch::Sender<Durability>,
) {
    while let Some(first) = waiting.blocking_recv() {
        match append_group(file, first, &mut waiting) {
            Ok(newest) => report.send_modify(|state| *state = Ok(Some(newest))),
            Err(reason) => {
                report.send_modify(|state| *state = Err(reason.to_string()));
                return;
            }
        }
    }
}

/// Writes `first` and all queued frames, then syncs once; returns the newest sequence.
fn append_group(
    file: &mut File,
    first: v1::Frame,
    waiting: &mut mpsc::Receiver<v1::Frame>,
) -> std::io::Result<u64> {
    let mut newest = first.sequence;
    let mut next = Some(first);
    while let Some(frame) = next {
        newest = frame.sequence;
        write_record(file, &FrameMessage { message: Some(Message::Frame(frame)) })?;
        next = waiting.try_recv().ok();
    }
    file.sync_data()?;
    Ok(newest)
}

/// Syncs the directory of `path`: without it a new file may be lost in a crash.
fn sync_directory(path: &Path) -> std::io::Result<()> {
    path.parent().map_or(Ok(()), |directory| File::open(directory)?.sync_all())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::record::Records;

    fn open_message() -> v1::OpenMap {
        v1::OpenMap { map: "kitchen".into(), depth_unit_metres: 0.001, ..Default::default() }
    }

    fn frame(sequence: u64) -> v1::Frame {
        v1::Frame { sequence, color: vec![sequence as u8; 100].into(), ..Default::default() }
    }

    fn sequences(path: &Path) -> Vec<u64> {
        let mut records = Records::open(path).unwrap();
        let mut found = Vec::new();
        while let Some(message) = records.next().unwrap() {
            match message {
                Message::Frame(frame) => found.push(frame.sequence),
                Message::Open(open) => assert_eq!(open, open_message()),
            }
        }
        found
    }

    async fn write(path: &Path, frames: std::ops::Range<u64>) {
        let log = Log::open(path.to_owned(), open_message()).unwrap();
        for sequence in frames.clone() {
            log.append(frame(sequence)).await.unwrap();
        }
        log.durable(frames.end - 1).await.unwrap();
        assert_eq!(log.durable_through(), Some(frames.end - 1));
    }

    #[tokio::test]
    async fn durable_frames_are_read_back_and_appended_to() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("kitchen.log");
        write(&path, 0..3).await;
        assert_eq!(sequences(&path), [0, 1, 2]);
        let log = Log::open(path.clone(), open_message()).unwrap();
        assert_eq!(log.durable_through(), Some(2));
        drop(log);
        write(&path, 3..5).await;
        assert_eq!(sequences(&path), [0, 1, 2, 3, 4]);
    }

    #[tokio::test]
    async fn only_incomplete_records_are_cut_off() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("kitchen.log");
        write(&path, 0..3).await;
        let whole = std::fs::read(&path).unwrap();
        assert_eq!(cut_torn_tail(&path).unwrap(), Some(2));
        assert_eq!(std::fs::read(&path).unwrap(), whole);
        for keep in [whole.len() - 1, whole.len() - 105] {
            std::fs::write(&path, &whole[..keep]).unwrap();
            assert_eq!(cut_torn_tail(&path).unwrap(), Some(1), "{keep} bytes");
            assert_eq!(sequences(&path), [0, 1]);
        }
        let mut flipped = whole.clone();
        *flipped.last_mut().unwrap() ^= 1;
        std::fs::write(&path, &flipped).unwrap();
        assert_eq!(cut_torn_tail(&path).unwrap(), Some(1));
        write(&path, 2..4).await;
        assert_eq!(sequences(&path), [0, 1, 2, 3]);
    }

    #[tokio::test]
    async fn a_full_disk_is_reported() {
        assert!(Path::new("/dev/full").exists(), "this test needs /dev/full, which Linux has");
        let refused = Log::open("/dev/full".into(), open_message());
        assert!(refused.is_err(), "the device is full");
    }
}
