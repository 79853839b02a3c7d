//! Writing one file of a recording.

use super::disk::{Disk, DiskFile};
use super::error::StoreError;
use super::messages::{self, Channel, Recorded, Sizes};
use lexsplat_proto::v1;
use mcap::WriteOptions;
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Written into each file as the program that made it.
const LIBRARY: &str = concat!("lexsplat ", env!("CARGO_PKG_VERSION"));
/// An opening message up to this size is repeated in each chunk, so that damage to one chunk leaves the
/// others readable.
const REPEATED_OPENING_BYTES: usize = 16 << 10;

/// A file that is being written. Each frame is a chunk of its own with a checksum.
pub(super) struct Writer {
    disk: Arc<dyn Disk>,
    path: PathBuf,
    mcap: mcap::Writer<Target>,
    file: Box<dyn DiskFile>,
    sizes: Sizes,
    opening: Vec<Recorded>,
    /// Channels that the file describes already.
    known: Vec<Channel>,
    /// Set after an error: nothing more is written, not even the index that `mcap` writes when it is
    /// dropped.
    is_closed: Arc<AtomicBool>,
    /// Time of the newest frame that has one, for those that have none, nanoseconds.
    newest_time: u64,
    /// Bytes up to the end of the newest durable frame.
    durable_bytes: u64,
}

impl Writer {
    /// Creates a file; it must not exist.
    ///
    /// # Errors
    /// [`StoreError::Io`], [`StoreError::Mcap`].
    pub(super) fn create(
        disk: &Arc<dyn Disk>,
        path: &Path,
        open: &v1::OpenMap,
    ) -> Result<Self, StoreError> {
        let file = disk.create(path).map_err(|reason| StoreError::io("create", path, reason))?;
        Self::begin(disk, path, open, file).inspect_err(|_| {
            // On a full disk nothing is in it.
            let _ = disk.remove(path);
        })
    }

    fn begin(
        disk: &Arc<dyn Disk>,
        path: &Path,
        open: &v1::OpenMap,
        file: Box<dyn DiskFile>,
    ) -> Result<Self, StoreError> {
        let same = file.another().map_err(|reason| StoreError::io("open", path, reason))?;
        let is_closed = Arc::new(AtomicBool::new(false));
        let options = WriteOptions::new().compression(None).chunk_size(None).library(LIBRARY);
        let mcap = options
            .create(Target { file: same, is_closed: is_closed.clone() })
            .map_err(|reason| StoreError::mcap(path, reason))?;
        Ok(Self {
            disk: disk.clone(),
            path: path.to_owned(),
            mcap,
            file,
            sizes: Sizes::of(open),
            opening: messages::of_opening(open),
            known: Vec::new(),
            is_closed,
            newest_time: 0,
            durable_bytes: 0,
        })
    }

    /// Appends a frame. It is on disk when this returns. After an error the file takes no more frames.
    ///
    /// # Errors
    /// [`StoreError::Io`], [`StoreError::Mcap`].
    pub(super) fn append(&mut self, frame: v1::Frame) -> Result<(), StoreError> {
        let written = self.write(frame);
        if written.is_err() {
            self.is_closed.store(true, Ordering::Relaxed);
            // Best effort: a part of a frame at the end is left out by readers, too.
            let _ = match self.durable_bytes {
                0 => self.disk.remove(&self.path),
                bytes => self.file.set_len(bytes),
            };
        }
        written
    }

    fn write(&mut self, frame: v1::Frame) -> Result<(), StoreError> {
        if frame.timestamp_nanos > 0 {
            self.newest_time = frame.timestamp_nanos;
        }
        let log_time = self.newest_time;
        // MCAP has 32 bits for it; the frame's own message has all of them.
        let sequence = frame.sequence as u32;
        let opening_bytes: usize = self.opening.iter().map(|message| message.data.len()).sum();
        let opening = std::mem::take(&mut self.opening);
        let repeats = if self.known.is_empty() {
            opening.len()
        } else if opening_bytes <= REPEATED_OPENING_BYTES {
            // The calibration is for other programs, which read the first one.
            1
        } else {
            0
        };
        let written = opening[..repeats]
            .iter()
            .chain(&messages::of_frame(frame, self.sizes))
            .try_for_each(|message| self.put(message, sequence, log_time));
        self.opening = opening;
        written.and_then(|()| self.mcap.flush()).map_err(|reason| self.failed(reason))?;
        self.file.sync().map_err(|reason| StoreError::io("write to", &self.path, reason))?;
        let end = self.file.stream_position();
        self.durable_bytes =
            end.map_err(|reason| StoreError::io("write to", &self.path, reason))?;
        Ok(())
    }

    fn put(&mut self, message: &Recorded, sequence: u32, log_time: u64) -> mcap::McapResult<()> {
        let Recorded { channel, data } = message;
        let id = channel.id();
        if !self.known.contains(channel) {
            let (name, descriptors) = channel.schema();
            self.mcap.add_schema_with_id(id, &name, "protobuf", &descriptors)?;
            self.mcap.add_channel_with_id(id, id, channel.topic(), "protobuf", &BTreeMap::new())?;
            self.known.push(*channel);
        }
        let header = MessageHeader { channel_id: id, sequence, log_time, publish_time: log_time };
        self.mcap.write_to_known_channel(&header, data)
    }

    /// Writes the index that makes the file quick to open. Without it every frame can be read, too.
    ///
    /// # Errors
    /// [`StoreError::Io`], [`StoreError::Mcap`].
    pub(super) fn finish(mut self) -> Result<(), StoreError> {
        self.mcap.finish().map_err(|reason| StoreError::mcap(&self.path, reason))?;
        self.file.sync().map_err(|reason| StoreError::io("write to", &self.path, reason))
    }

    fn failed(&self, reason: mcap::McapError) -> StoreError {
        StoreError::mcap(&self.path, reason)
    }
}

/// The file as `mcap` sees it.
struct Target {
    file: Box<dyn DiskFile>,
    is_closed: Arc<AtomicBool>,
}

impl Write for Target {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if self.is_closed.load(Ordering::Relaxed) {
            return Err(std::io::Error::other("an earlier write failed"));
        }
        self.file.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Target {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.file.seek(to)
    }
}
