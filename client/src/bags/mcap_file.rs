//! MCAP files, with chunks of zstd, lz4 or none. They are read record by record, without their index, so that
//! one that was cut off is read as far as it goes.

use super::store::{Channel, Message, Place, Store};
use crate::dataset::DatasetError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, parse_record};
use std::collections::HashMap;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Operation code and length of a record.
const RECORD_HEADER: u64 = 9;
/// Longer records and chunks are not read, bytes.
const LONGEST: u64 = 1 << 29;
/// Chunks of more bytes are not decompressed; writers end them at one to a few megabytes.
const LONGEST_CHUNK: u64 = 1 << 28;
/// Chunks that are kept: color and depth of a frame may lie in two.
const KEPT: usize = 3;
/// Place of a message outside of chunks.
const ALONE: u32 = u32::MAX;

/// An MCAP file.
pub(super) struct McapFile {
    path: PathBuf,
    /// The chunks that were read last.
    kept: Mutex<Vec<Chunk>>,
}

/// The messages of a chunk.
struct Chunk {
    at: u64,
    messages: Vec<Vec<u8>>,
}

/// The schemas and channels so far.
#[derive(Default)]
struct Names {
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, Channel>,
}

impl Names {
    /// Takes a schema or channel.
    fn take(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let (topic, encoding) = (channel.topic, channel.message_encoding);
                self.channels.insert(channel.id, Channel { topic, encoding, schema });
            }
            _ => {}
        }
    }
}

impl McapFile {
    /// A file, which is not read yet.
    pub(super) fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), kept: Mutex::new(Vec::new()) }
    }

    fn failed(&self, source: std::io::Error) -> DatasetError {
        DatasetError::File { path: self.path.clone(), source }
    }

    /// The open file and its length.
    fn open(&self) -> Result<(File, u64), DatasetError> {
        let mut file = File::open(&self.path).map_err(|error| self.failed(error))?;
        let bytes = file.seek(SeekFrom::End(0)).map_err(|error| self.failed(error))?;
        let magic = self.bytes(&mut file, 0, (MAGIC.len() as u64).min(bytes))?;
        if magic != MAGIC {
            let reason = "expected an MCAP file, found other bytes at its beginning";
            return Err(DatasetError::content(&self.path, reason));
        }
        Ok((file, bytes))
    }

    fn bytes(&self, file: &mut File, at: u64, length: u64) -> Result<Vec<u8>, DatasetError> {
        let mut bytes = vec![0; length as usize];
        let read = file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut bytes));
        read.map_err(|error| self.failed(error))?;
        Ok(bytes)
    }

    /// The messages of the chunk or record at a place.
    fn load(&self, at: u64) -> Result<Chunk, DatasetError> {
        let (mut file, bytes) = self.open()?;
        let damaged =
            |reason: String| DatasetError::content(&self.path, format!("byte {at}: {reason}"));
        let header = self.bytes(&mut file, at, RECORD_HEADER)?;
        let (code, length) = record_header(&header);
        if length > LONGEST.min(bytes - at) {
            return Err(damaged("expected a record, found other bytes".into()));
        }
        let record = self.bytes(&mut file, at, RECORD_HEADER + length)?;
        let mut messages = Vec::new();
        match code {
            op::CHUNK => chunk(&record, |record| {
                if let Record::Message { data, .. } = record {
                    messages.push(data.into_owned());
                }
            })
            .map_err(|error| damaged(error.to_string()))?,
            _ => match parse_record(code, &record[RECORD_HEADER as usize..]) {
                Ok(Record::Message { data, .. }) => messages.push(data.into_owned()),
                _ => return Err(damaged("expected a message, found other bytes".into())),
            },
        }
        Ok(Chunk { at, messages })
    }
}

impl Store for McapFile {
    fn scan(&self, take: &mut dyn FnMut(Message<'_>)) -> Result<Vec<String>, DatasetError> {
        let (mut file, bytes) = self.open()?;
        let (mut names, mut problems) = (Names::default(), Vec::new());
        let mut at = MAGIC.len() as u64;
        let told = |at: u64, reason: String| {
            format!("{}: byte {at} of {bytes}: {reason}", self.path.display())
        };
        loop {
            if at + RECORD_HEADER > bytes {
                problems.push(told(at, "it was not closed, and is read as far as it goes".into()));
                break;
            }
            let (code, length) = record_header(&self.bytes(&mut file, at, RECORD_HEADER)?);
            let end = (at + RECORD_HEADER).checked_add(length).filter(|end| *end <= bytes);
            let Some(end) = end.filter(|_| code != 0) else {
                problems
                    .push(told(at, "it is cut off or damaged here, and read up to here".into()));
                break;
            };
            match code {
                op::DATA_END | op::FOOTER => break,
                op::CHUNK | op::SCHEMA | op::CHANNEL | op::MESSAGE if length <= LONGEST => {
                    let record = self.bytes(&mut file, at, RECORD_HEADER + length)?;
                    if let Err(error) = shown(&record, at, &mut names, take) {
                        problems.push(told(at, format!("left out: {error}")));
                    }
                }
                op::CHUNK | op::MESSAGE => {
                    problems.push(told(at, format!("left out: {length} bytes in one piece")));
                }
                _ => {}
            }
            at = end;
        }
        Ok(problems)
    }

    fn read(&self, place: Place) -> Result<Vec<u8>, DatasetError> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if !kept.iter().any(|chunk| chunk.at == place.at) {
            kept.truncate(KEPT - 1);
            kept.insert(0, self.load(place.at)?);
        }
        let chunk = kept.iter().find(|chunk| chunk.at == place.at).expect("it was put there");
        let nth = if place.nth == ALONE { 0 } else { place.nth as usize };
        chunk.messages.get(nth).cloned().ok_or_else(|| {
            let reason =
                format!("byte {}: expected more messages: has the file changed?", place.at);
            DatasetError::content(&self.path, reason)
        })
    }
}

/// Takes what is in a record: names, and messages.
fn shown(
    record: &[u8],
    at: u64,
    names: &mut Names,
    take: &mut dyn FnMut(Message<'_>),
) -> mcap::McapResult<()> {
    let mut nth = 0;
    let mut one = |record: Record<'_>, is_alone: bool| {
        let Record::Message { header, data } = record else { return names.take(record) };
        let place = Place { at, nth: if is_alone { ALONE } else { nth } };
        nth += 1;
        if let Some(channel) = names.channels.get(&header.channel_id) {
            take(Message { channel, nanos: header.log_time, place, data: &data });
        }
    };
    match record[0] {
        op::CHUNK => chunk(record, |record| one(record, false)),
        code => {
            one(parse_record(code, &record[RECORD_HEADER as usize..])?, true);
            Ok(())
        }
    }
}

/// Calls `each` with the records of a chunk, if its checksum is right.
fn chunk(record: &[u8], mut each: impl FnMut(Record<'_>)) -> mcap::McapResult<()> {
    // Before anything is decompressed: a few bytes can stand for a gigabyte.
    if let Record::Chunk { header, .. } =
        parse_record(op::CHUNK, &record[RECORD_HEADER as usize..])?
        && header.uncompressed_size > LONGEST_CHUNK
    {
        return Err(mcap::McapError::ChunkTooLarge(header.uncompressed_size));
    }
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(LONGEST as usize);
    let (mut reader, mut rest) = (LinearReader::new_with_options(options), record);
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(wanted) => {
                let (now, later) = rest.split_at(wanted.min(rest.len()));
                reader.insert(now.len()).copy_from_slice(now);
                reader.notify_read(now.len());
                rest = later;
            }
            LinearReadEvent::Record { data, opcode } => each(parse_record(opcode, data)?),
        }
    }
    Ok(())
}

/// Operation code and length of a record.
fn record_header(bytes: &[u8]) -> (u8, u64) {
    (bytes[0], u64::from_le_bytes(std::array::from_fn(|at| bytes[1 + at])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chunk_that_says_that_it_is_huge_is_not_decompressed() {
        let saying = |bytes: u64| {
            let body = [
                &[0; 16][..],
                &bytes.to_le_bytes(),
                &[0; 4],
                &4_u32.to_le_bytes(),
                b"zstd",
                &0_u64.to_le_bytes(),
            ]
            .concat();
            let header = [&[op::CHUNK][..], &(body.len() as u64).to_le_bytes()].concat();
            chunk(&[header, body].concat(), |_| {}).err().map(|error| error.to_string())
        };
        let refused = saying(1 << 30).unwrap();
        assert!(refused.contains("1073741824"), "{refused}");
        // Control: a usual size is another error at most.
        assert_ne!(saying(1 << 20).as_ref(), Some(&refused));
    }
}
