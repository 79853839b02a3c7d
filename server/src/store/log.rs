//! One map's log: appending, group commit, reading back.

use super::StoreError;
use lexsplat_proto::v1::{self, FrameMessage, frame_message::Message};
use prost::Message as _;
use sha2::{Digest as _, Sha256};
use std::fs::{File, OpenOptions};
use std::io::{BufReader, Read, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use tokio::sync::{mpsc, watch};

/// Frames that wait to be written; when full their sender waits.
const APPEND_BACKLOG: usize = 16;
/// Length and checksum.
const HEADER_BYTES: usize = 4 + 8;
/// A length above this is no record's: larger than any message that is taken.
const MAX_RECORD_BYTES: usize = 1 << 30;

type Durability = Result<Option<u64>, String>;

/// An open log. Dropping it writes what waits.
pub struct Log {
    path: PathBuf,
    frames: mpsc::Sender<v1::Frame>,
    durable: watch::Receiver<Durability>,
}

impl Log {
    /// Opens or makes the log at `path`, cuts a torn tail, and notes that `open` begins here.
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

    /// Hands over a frame to be written; waits while too many wait.
    ///
    /// # Errors
    /// [`StoreError::Failed`] if an earlier one could not be written.
    pub async fn append(&self, frame: v1::Frame) -> Result<(), StoreError> {
        self.frames.send(frame).await.map_err(|_| self.failed())
    }

    /// Waits until the frame is durable.
    ///
    /// # Errors
    /// [`StoreError::Failed`] if it could not be written.
    pub async fn durable(&self, sequence: u64) -> Result<(), StoreError> {
        let reached = |state: &Durability| match state {
            Ok(through) => through.is_some_and(|through| through >= sequence),
            Err(_) => true,
        };
        match self.durable.clone().wait_for(reached).await {
            Ok(state) if state.is_ok() => Ok(()),
            _ => Err(self.failed()),
        }
    }

    /// The newest sequence that is durable.
    pub fn durable_through(&self) -> Option<u64> {
        self.durable.borrow().as_ref().ok().copied().flatten()
    }

    fn failed(&self) -> StoreError {
        let reason = match &*self.durable.borrow() {
            Err(reason) => reason.clone(),
            Ok(_) => "its thread ended".into(),
        };
        StoreError::Failed { path: self.path.clone(), reason }
    }
}

/// The log's thread: appends what waits, makes it durable, says so.
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

/// Writes `first` and all that wait behind it, then syncs once; the newest sequence.
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

fn write_record(file: &mut File, message: &FrameMessage) -> std::io::Result<()> {
    let payload = message.encode_to_vec();
    let length = u32::try_from(payload.len())
        .map_err(|_| std::io::Error::other("a message is longer than a record may be"))?;
    let mut record = Vec::with_capacity(HEADER_BYTES + payload.len());
    record.extend(length.to_le_bytes());
    record.extend(checksum(&payload));
    record.extend(payload);
    file.write_all(&record)
}

fn checksum(payload: &[u8]) -> [u8; 8] {
    let digest = Sha256::digest(payload);
    std::array::from_fn(|at| digest[at])
}

/// A new file's name is durable only when its directory is.
fn sync_directory(path: &Path) -> std::io::Result<()> {
    path.parent().map_or(Ok(()), |directory| File::open(directory)?.sync_all())
}

/// Reads a log's records until its end or the first that is torn.
pub(super) struct Records {
    path: PathBuf,
    file: BufReader<File>,
    /// Bytes of whole records read so far.
    pub(super) whole_bytes: u64,
}

impl Records {
    pub(super) fn open(path: &Path) -> Result<Self, StoreError> {
        let file = File::open(path).map_err(|reason| StoreError::io("open", path, reason))?;
        Ok(Self { path: path.to_owned(), file: BufReader::new(file), whole_bytes: 0 })
    }

    /// The next record; `None` at the end and before a torn one.
    pub(super) fn next(&mut self) -> Result<Option<Message>, StoreError> {
        let failed = |reason| StoreError::io("read", &self.path, reason);
        let mut header = [0; HEADER_BYTES];
        if !filled(&mut self.file, &mut header).map_err(failed)? {
            return Ok(None);
        }
        let [a, b, c, d, sum @ ..] = header;
        let length = u32::from_le_bytes([a, b, c, d]) as usize;
        if length > MAX_RECORD_BYTES {
            return Ok(None);
        }
        let mut payload = Vec::new();
        let mut rest = (&mut self.file).take(length as u64);
        rest.read_to_end(&mut payload).map_err(failed)?;
        if payload.len() < length || checksum(&payload) != sum {
            return Ok(None);
        }
        self.whole_bytes += (HEADER_BYTES + length) as u64;
        Ok(FrameMessage::decode(&payload[..]).ok().and_then(|message| message.message))
    }
}

/// Whether the buffer could be filled; false at the end of the file.
fn filled(file: &mut impl Read, buffer: &mut [u8]) -> std::io::Result<bool> {
    match file.read_exact(buffer) {
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => Ok(false),
        other => other.map(|()| true),
    }
}

/// Cuts what is torn off the end; the sequence of the newest frame that is whole.
pub(super) fn cut_torn_tail(path: &Path) -> Result<Option<u64>, StoreError> {
    let failed = |reason| StoreError::io("cut the torn end off", path, reason);
    let mut records = Records::open(path)?;
    let mut newest = None;
    while let Some(message) = records.next()? {
        if let Message::Frame(frame) = message {
            newest = Some(frame.sequence);
        }
    }
    let mut file = OpenOptions::new().write(true).open(path).map_err(failed)?;
    let length = file.seek(SeekFrom::End(0)).map_err(failed)?;
    if length > records.whole_bytes {
        let cut_bytes = length - records.whole_bytes;
        tracing::warn!(log = %path.display(), cut_bytes, "a torn end was cut off a frame log");
        file.set_len(records.whole_bytes).and_then(|()| file.sync_all()).map_err(failed)?;
    }
    Ok(newest)
}

#[cfg(test)]
mod tests {
    use super::*;

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
    async fn what_is_durable_is_read_back_and_appended_to() {
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
    async fn a_torn_tail_is_cut_and_a_whole_one_is_not() {
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
    async fn a_disk_that_refuses_is_not_called_durable() {
        if !Path::new("/dev/full").exists() {
            return;
        }
        let refused = Log::open("/dev/full".into(), open_message());
        assert!(refused.is_err(), "the device takes no bytes");
    }
}
