//! Reading one file of a recording, past damage if there is any.
//!
//! A file is a header, chunks, and an index that only other programs need. A chunk whose checksum is wrong is
//! left out; so is everything up to the next chunk that looks whole. What a crash left of the last frame is
//! no damage: that frame was never acknowledged.

use super::error::StoreError;
use super::messages::{Assembler, Channel};
use lexsplat_proto::v1::{self, frame_message::Message};
use mcap::read::{ChunkReader, parse_record};
use mcap::records::{Record, op};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

/// Operation code and length of a record.
const RECORD_HEADER: u64 = 9;
/// Bytes of a chunk record before its data, where nothing is compressed.
const CHUNK_HEADER: usize = 8 + 8 + 8 + 4 + 4 + 8;
/// Bytes that are searched at once.
const BLOCK: usize = 1 << 20;

/// Bytes of a file that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Damage {
    pub path: PathBuf,
    pub from_byte: u64,
    pub to_byte: u64,
}

/// The next thing in a file.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "entries are handed on one by one, never stored")]
pub(crate) enum Entry {
    Message(Message),
    Damage(Damage),
}

/// Reads the messages of a file in their order.
pub(super) struct Reader {
    path: PathBuf,
    file: File,
    bytes: u64,
    /// Where the next record begins.
    at: u64,
    queue: VecDeque<Message>,
    opened: Option<v1::OpenMap>,
    is_at_end: bool,
    /// The file was finished: it ends with an index.
    is_finished: bool,
}

/// What is at a place in the file.
enum Found {
    Chunk(Vec<Message>),
    /// A record without frames.
    Other,
    End,
    /// The file ends within the record.
    Cut,
    Damaged,
}

impl Reader {
    /// Opens a file.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(super) fn open(path: &Path) -> Result<Self, StoreError> {
        let io = |reason| StoreError::io("open", path, reason);
        let mut file = File::open(path).map_err(io)?;
        let bytes = file.seek(SeekFrom::End(0)).map_err(io)?;
        let magic = mcap::MAGIC.len() as u64;
        let ends_well = bytes >= 2 * magic;
        let mut reader = Self {
            path: path.to_owned(),
            file,
            bytes,
            at: 0,
            queue: VecDeque::new(),
            opened: None,
            is_at_end: false,
            is_finished: false,
        };
        let end = if ends_well { reader.read(bytes - magic, magic as usize)? } else { Vec::new() };
        reader.is_finished = end == mcap::MAGIC;
        Ok(reader)
    }

    /// Chunks up to the first record that does not end in the file.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(super) fn count_chunks(&mut self) -> Result<u64, StoreError> {
        let (mut at, mut chunks) = (mcap::MAGIC.len() as u64, 0);
        while at + RECORD_HEADER <= self.bytes {
            let (code, length) = self.header(at)?;
            let end = (at + RECORD_HEADER).checked_add(length);
            let Some(end) = end.filter(|end| *end <= self.bytes && length <= LONGEST_RECORD) else {
                break;
            };
            chunks += u64::from(code == op::CHUNK);
            if code == op::DATA_END {
                break;
            }
            at = end;
        }
        Ok(chunks)
    }

    /// Whether the file was closed properly.
    pub(super) fn is_finished(&self) -> bool {
        self.is_finished
    }

    /// The next message or damage; `None` at the end.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(super) fn next(&mut self) -> Result<Option<Entry>, StoreError> {
        loop {
            if let Some(message) = self.queue.pop_front() {
                if let Message::Open(open) = &message {
                    if self.opened.as_ref() == Some(open) {
                        continue;
                    }
                    self.opened = Some(open.clone());
                }
                return Ok(Some(Entry::Message(message)));
            }
            if self.is_at_end {
                return Ok(None);
            }
            let from = self.at;
            match self.record()? {
                Found::Chunk(messages) => self.queue.extend(messages),
                Found::Other => {}
                Found::End => self.is_at_end = true,
                found @ (Found::Cut | Found::Damaged) => {
                    let next = self.find_chunk(from + 1)?;
                    self.at = next.unwrap_or(self.bytes);
                    self.is_at_end = next.is_none();
                    let is_torn =
                        matches!(found, Found::Cut) && next.is_none() && !self.is_finished;
                    if !is_torn {
                        let (path, to_byte) = (self.path.clone(), self.at);
                        return Ok(Some(Entry::Damage(Damage { path, from_byte: from, to_byte })));
                    }
                }
            }
        }
    }

    /// Reads what is at the current place and goes behind it.
    fn record(&mut self) -> Result<Found, StoreError> {
        if self.at == 0 {
            let magic = self.read(0, mcap::MAGIC.len().min(self.bytes as usize))?;
            if !mcap::MAGIC.starts_with(&magic) {
                return Ok(Found::Damaged);
            }
            if magic.len() < mcap::MAGIC.len() {
                return Ok(Found::Cut);
            }
            self.at = mcap::MAGIC.len() as u64;
        }
        if self.at == self.bytes {
            return Ok(Found::End);
        }
        if self.at + RECORD_HEADER > self.bytes {
            return Ok(Found::Cut);
        }
        let (code, length) = self.header(self.at)?;
        let end = (self.at + RECORD_HEADER).checked_add(length);
        let Some(end) = end.filter(|end| *end <= self.bytes) else {
            return self.too_long(code, length);
        };
        if length > LONGEST_RECORD {
            return Ok(Found::Damaged);
        }
        let found = match code {
            op::HEADER | op::CHUNK | op::MESSAGE_INDEX | op::DATA_END => {
                let body = self.read(self.at + RECORD_HEADER, length as usize)?;
                if code == op::CHUNK && is_unfinished_chunk(&body) {
                    return Ok(Found::Cut);
                }
                contents(code, &body)
            }
            _ => None,
        };
        let Some(found) = found else { return Ok(Found::Damaged) };
        self.at = end;
        Ok(found)
    }

    /// Tells a chunk that a crash cut off from a whole one with a wrong length: the length is there twice.
    fn too_long(&mut self, code: u8, length: u64) -> Result<Found, StoreError> {
        let body = self.at + RECORD_HEADER;
        if code != op::CHUNK || body + CHUNK_HEADER as u64 > self.bytes {
            return Ok(Found::Cut);
        }
        let header = self.read(body, CHUNK_HEADER)?;
        let is_cut = is_unfinished_chunk(&header) || is_plain_chunk(&header, length);
        Ok(if is_cut { Found::Cut } else { Found::Damaged })
    }

    /// Operation code and length of the record at a place.
    fn header(&mut self, at: u64) -> Result<(u8, u64), StoreError> {
        let header = self.read(at, RECORD_HEADER as usize)?;
        Ok(record_header(&header))
    }

    /// Where the next record begins, from `from` on, that looks like a chunk of a recording.
    fn find_chunk(&mut self, from: u64) -> Result<Option<u64>, StoreError> {
        let wanted = RECORD_HEADER as usize + CHUNK_HEADER;
        let mut start = from;
        while start + wanted as u64 <= self.bytes {
            let block = self.read(start, BLOCK.min((self.bytes - start) as usize))?;
            let looks_whole = |offset: &usize| {
                // Nearly all bytes are no beginning.
                if block[*offset] != op::CHUNK {
                    return false;
                }
                let (code, length) = record_header(&block[*offset..]);
                let end = (start + *offset as u64 + RECORD_HEADER).checked_add(length);
                let header = &block[*offset + RECORD_HEADER as usize..][..CHUNK_HEADER];
                code == op::CHUNK
                    && end.is_some_and(|end| end <= self.bytes)
                    && is_plain_chunk(header, length)
            };
            if let Some(offset) = (0..=block.len() - wanted).find(looks_whole) {
                return Ok(Some(start + offset as u64));
            }
            start += (block.len() - wanted + 1) as u64;
        }
        Ok(None)
    }

    fn read(&mut self, at: u64, bytes: usize) -> Result<Vec<u8>, StoreError> {
        let mut read = vec![0; bytes];
        let done =
            self.file.seek(SeekFrom::Start(at)).and_then(|_| self.file.read_exact(&mut read));
        done.map_err(|reason| StoreError::io("read", &self.path, reason))?;
        Ok(read)
    }
}

/// Operation code and length of a record.
fn record_header(bytes: &[u8]) -> (u8, u64) {
    let length = std::array::from_fn(|at| bytes[1 + at]);
    (bytes[0], u64::from_le_bytes(length))
}

/// Whether the header of a chunk record of this length says that the rest is data without compression.
fn is_plain_chunk(header: &[u8], length: u64) -> bool {
    let number = |at: usize| u64::from_le_bytes(std::array::from_fn(|byte| header[at + byte]));
    let (uncompressed, compressed) = (number(16), number(32));
    header[28..32] == [0; 4]
        && uncompressed == compressed
        && Some(length) == compressed.checked_add(CHUNK_HEADER as u64)
}

/// A longer record is damage, bytes: a frame is shorter.
const LONGEST_RECORD: u64 = 1 << 30;

/// Whether a chunk is being written: its length is the last that is put into its header.
fn is_unfinished_chunk(header: &[u8]) -> bool {
    header.get(32..CHUNK_HEADER).is_some_and(|length| length == [u8::MAX; 8])
}

/// What a record contains; `None` if it is damaged.
fn contents(code: u8, body: &[u8]) -> Option<Found> {
    match parse_record(code, body).ok()? {
        Record::Header(_) => Some(Found::Other),
        // Its length is written twice.
        Record::MessageIndex(index) => {
            (body.len() == 6 + 16 * index.records.len()).then_some(Found::Other)
        }
        Record::DataEnd(_) => (body.len() == 4).then_some(Found::End),
        Record::Chunk { header, data } => {
            if body.len() < CHUNK_HEADER || !is_plain_chunk(body, body.len() as u64) {
                return None;
            }
            let mut assembler = Assembler::default();
            let mut messages = Vec::new();
            for record in ChunkReader::new(header, &data).ok()? {
                let Record::Message { header, data } = record.ok()? else { continue };
                let channel = Channel::from_id(header.channel_id)?;
                messages.extend(assembler.take(channel, &data).ok()?);
            }
            Some(Found::Chunk(messages))
        }
        _ => None,
    }
}
