//! The records of a log file: writing, reading, cutting off a partly written one.

use super::error::StoreError;
use lexsplat_proto::v1::{FrameMessage, frame_message::Message};
use prost::Message as _;
use sha2::{Digest as _, Sha256};
use std::fs::{File, OpenOptions};
use std::io::{BufReader, Read, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

/// Length and checksum.
const HEADER_BYTES: usize = 4 + 8;
/// A larger length cannot be that of a record: it is above every accepted message.
const MAX_RECORD_BYTES: usize = 1 << 30;

/// Appends a record; it is durable after the next sync.
pub(super) fn write_record(file: &mut File, message: &FrameMessage) -> std::io::Result<()> {
    let payload = message.encode_to_vec();
    let length = u32::try_from(payload.len())
        .map_err(|_| std::io::Error::other("the message is too long for a record"))?;
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

/// Reads the records of a log until its end or the first incomplete one.
pub(crate) struct Records {
    path: PathBuf,
    file: BufReader<File>,
    /// Bytes of the complete records read so far.
    whole_bytes: u64,
}

impl Records {
    pub(super) fn open(path: &Path) -> Result<Self, StoreError> {
        let file = File::open(path).map_err(|reason| StoreError::io("open", path, reason))?;
        Ok(Self { path: path.to_owned(), file: BufReader::new(file), whole_bytes: 0 })
    }

    /// The next record; `None` at the end and before an incomplete one.
    pub(crate) fn next(&mut self) -> Result<Option<Message>, StoreError> {
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

/// Fills the buffer; false if the file ends before.
fn filled(file: &mut impl Read, buffer: &mut [u8]) -> std::io::Result<bool> {
    match file.read_exact(buffer) {
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => Ok(false),
        other => other.map(|()| true),
    }
}

/// Cuts an incomplete record off the end; returns the sequence of the newest complete frame.
pub(super) fn cut_torn_tail(path: &Path) -> Result<Option<u64>, StoreError> {
    let failed = |reason| StoreError::io("cut an incomplete record off", path, reason);
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
        tracing::warn!(log = %path.display(), cut_bytes, "cut an incomplete record off a frame log");
        file.set_len(records.whole_bytes).and_then(|()| file.sync_all()).map_err(failed)?;
    }
    Ok(newest)
}
