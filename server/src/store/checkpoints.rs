//! Checkpoint files: whole states of maps beside their recordings.
//!
//! ```text
//! DATA/kitchen.map/checkpoint-0007.lexsplat
//!
//! LXSPCKPT   8 bytes
//! version    4 bytes, little-endian
//! length     4 bytes, little-endian: of the label
//! label      JSON: the map, what made the state, and the frame that it is through
//! state      compressed by zstd
//! checksum   32 bytes: SHA-256 of everything before
//! ```
//!
//! A file appears under its name when it is on disk as a whole. Then older ones are removed.

use super::directory::BEING_WRITTEN;
use super::disk::{Disk, DiskFile};
use super::error::StoreError;
use super::room::{Reservation, Room};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"LXSPCKPT";
const VERSION: u32 = 1;
const PREFIX: &str = "checkpoint-";
const ENDING: &str = ".lexsplat";
const CHECKSUM_BYTES: u64 = 32;
const MAX_LABEL_BYTES: u32 = 1 << 16;
/// Pictures hardly become smaller with a higher level, and a restart should be fast.
const LEVEL: i32 = 1;
/// Bytes that are written at once.
const BLOCK: usize = 256 << 10;

/// What a checkpoint is of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Label {
    pub map: String,
    /// Of what made the state; only the same can go on with it.
    pub fingerprint: String,
    /// Sequence number of the newest frame in it.
    pub through: u64,
    /// Frames in it.
    pub frames: u64,
}

/// Why a checkpoint is of no use.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CheckpointFault {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("it was written by another version ({0}; this one is {VERSION})")]
    OtherVersion(u32),
    #[error("it is damaged: {0}")]
    Damaged(String),
}

/// Whether a file of this name is a checkpoint.
pub(super) fn is_one(name: &str) -> bool {
    number(name, ENDING).is_some()
}

/// Numbers of files are smaller, so that there is always a next one.
const NUMBERS: u64 = 1_000_000_000;

/// The number in `checkpoint-NUMBER` with this ending.
fn number(name: &str, ending: &str) -> Option<u64> {
    let number = name.strip_prefix(PREFIX)?.strip_suffix(ending)?.parse().ok();
    number.filter(|number| *number < NUMBERS)
}

/// The checkpoints in a map's folder, newest first.
///
/// # Errors
/// [`StoreError::Io`].
pub(super) fn list(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let mut found = numbered(folder, ENDING)?;
    found.sort_by_key(|(number, _)| std::cmp::Reverse(*number));
    Ok(found.into_iter().map(|(_, path)| path).collect())
}

/// Files called `checkpoint-NUMBER` with this ending.
fn numbered(folder: &Path, ending: &str) -> Result<Vec<(u64, PathBuf)>, StoreError> {
    let failed = |reason| StoreError::io("list", folder, reason);
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = entry.file_name();
        if let Some(number) = name.to_str().and_then(|name| number(name, ending)) {
            found.push((number, entry.path()));
        }
    }
    Ok(found)
}

/// Writes a checkpoint and removes older ones when it is durable. `write` writes the state. Returns the bytes
/// of the file.
///
/// # Errors
/// [`StoreError::Io`], [`StoreError::Quota`]; then the older checkpoints are as they were.
pub(super) fn write(
    disk: &dyn Disk,
    folder: &Path,
    room: &Room,
    label: &Label,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<u64, StoreError> {
    for (_, left) in numbered(folder, &format!("{ENDING}{BEING_WRITTEN}"))? {
        disk.remove(&left).map_err(|reason| StoreError::io("remove", &left, reason))?;
    }
    let older = list(folder)?;
    let newest = numbered(folder, ENDING)?.into_iter().map(|(number, _)| number).max();
    let name = format!("{PREFIX}{:04}{ENDING}", newest.unwrap_or(0) + 1);
    let (path, unfinished) = (folder.join(&name), folder.join(format!("{name}{BEING_WRITTEN}")));
    let io = |reason| StoreError::io("write", &path, reason);
    let replaced = older.iter().filter_map(|path| Some(path.metadata().ok()?.len())).sum();
    let mut refused = None;
    let mut reserved = room.reserve_checkpoint(&label.map, replaced);
    let written = disk.create(&unfinished).and_then(|file| {
        let (reserved, refused) = (&mut reserved, &mut refused);
        let (file, bytes) = encode(Reserving { file, reserved, refused }, label, write)?;
        file.file.sync()?;
        Ok(bytes)
    });
    let renamed = written.and_then(|bytes| disk.rename(&unfinished, &path).map(|()| bytes));
    let bytes = renamed.inspect_err(|_| {
        // The disk may be full: a part of a file would take the last room.
        let _ = disk.remove(&unfinished);
    });
    let bytes = bytes.map_err(|reason| refused.unwrap_or_else(|| io(reason)))?;
    disk.sync_folder(folder).map_err(io)?;
    for old in older {
        disk.remove(&old).map_err(|reason| StoreError::io("remove", &old, reason))?;
    }
    Ok(bytes)
}

/// A file that may only grow while there is room.
struct Reserving<'a, 'room> {
    file: Box<dyn DiskFile>,
    reserved: &'a mut Reservation<'room>,
    /// Why there is none.
    refused: &'a mut Option<StoreError>,
}

impl Write for Reserving<'_, '_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if let Err(error) = self.reserved.grow(bytes.len() as u64) {
            *self.refused = Some(error);
            return Err(std::io::ErrorKind::QuotaExceeded.into());
        }
        self.file.write_all(bytes)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

/// Writes a checkpoint in its format. Returns what it was written to, and its bytes.
///
/// # Errors
/// Those of `file` and `write`.
pub(crate) fn encode<W: Write>(
    file: W,
    label: &Label,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> std::io::Result<(W, u64)> {
    let mut out =
        Hashing { inner: BufWriter::with_capacity(BLOCK, file), hash: Sha256::new(), bytes: 0 };
    let label = serde_json::to_vec(label)?;
    out.write_all(MAGIC)?;
    out.write_all(&VERSION.to_le_bytes())?;
    out.write_all(&(label.len() as u32).to_le_bytes())?;
    out.write_all(&label)?;
    let mut state = zstd::Encoder::new(&mut out, LEVEL)?;
    write(&mut state)?;
    state.finish()?;
    let Hashing { inner: mut file, hash, bytes } = out;
    file.write_all(&hash.finalize())?;
    let file = file.into_inner().map_err(std::io::IntoInnerError::into_error)?;
    Ok((file, bytes + CHECKSUM_BYTES))
}

/// A checkpoint that is being read. Its state may be used only after [`CheckpointReader::finish`].
pub(crate) struct CheckpointReader {
    label: Label,
    state: zstd::Decoder<'static, BufReader<Hashing<std::io::Take<File>>>>,
}

impl CheckpointReader {
    /// Opens a file and reads its label.
    ///
    /// # Errors
    /// [`CheckpointFault`].
    pub(crate) fn open(path: &Path) -> Result<Self, CheckpointFault> {
        let io = |reason| StoreError::io("read", path, reason);
        let file = File::open(path).map_err(io)?;
        let bytes = file.metadata().map_err(io)?.len();
        let covered = file.take(bytes.saturating_sub(CHECKSUM_BYTES));
        let mut file = Hashing { inner: covered, hash: Sha256::new(), bytes: 0 };
        let mut start = [0; 16];
        let short = |_| CheckpointFault::Damaged("its beginning is missing".into());
        file.read_exact(&mut start).map_err(short)?;
        if start[..8] != *MAGIC {
            return Err(CheckpointFault::Damaged("it does not begin like a checkpoint".into()));
        }
        let number = |at: usize| u32::from_le_bytes(std::array::from_fn(|byte| start[at + byte]));
        if number(8) != VERSION {
            // A flipped bit looks like another version too.
            return Err(whole(file).err().unwrap_or(CheckpointFault::OtherVersion(number(8))));
        }
        let mut label = vec![0; number(12).min(MAX_LABEL_BYTES) as usize];
        file.read_exact(&mut label).map_err(short)?;
        let label = serde_json::from_slice(&label)
            .map_err(|error| CheckpointFault::Damaged(format!("its label: {error}")))?;
        let state = zstd::Decoder::new(file).map_err(io)?;
        Ok(Self { label, state })
    }

    pub(crate) fn label(&self) -> &Label {
        &self.label
    }

    /// Reads to the end and compares the checksum.
    ///
    /// # Errors
    /// [`CheckpointFault::Damaged`].
    pub(crate) fn finish(self) -> Result<(), CheckpointFault> {
        let mut file = self.state.finish();
        let copied = std::io::copy(&mut file, &mut std::io::sink());
        copied.map_err(|error| CheckpointFault::Damaged(error.to_string()))?;
        whole(file.into_inner())
    }
}

/// Reads what is left of a file and compares its checksum, which stands at the end in every version.
fn whole(mut file: Hashing<std::io::Take<File>>) -> Result<(), CheckpointFault> {
    let damaged = |error: std::io::Error| CheckpointFault::Damaged(error.to_string());
    std::io::copy(&mut file, &mut std::io::sink()).map_err(damaged)?;
    let Hashing { inner, hash, .. } = file;
    let mut checksum = [0; CHECKSUM_BYTES as usize];
    inner.into_inner().read_exact(&mut checksum).map_err(damaged)?;
    if hash.finalize()[..] != checksum {
        return Err(CheckpointFault::Damaged("its checksum is wrong".into()));
    }
    Ok(())
}

impl Read for CheckpointReader {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.state.read(buffer)
    }
}

/// Computes the checksum of what passes through.
struct Hashing<T> {
    inner: T,
    hash: Sha256,
    bytes: u64,
}

impl<T: Write> Write for Hashing<T> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.inner.write(bytes)?;
        self.hash.update(&bytes[..written]);
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.inner.flush()
    }
}

impl<T: Read> Read for Hashing<T> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.hash.update(&buffer[..read]);
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::RecordingConfig;
    use super::super::disk::RealDisk;
    use super::*;

    fn label(through: u64) -> Label {
        Label { map: "kitchen".into(), fingerprint: "f".into(), through, frames: through + 1 }
    }

    fn room(folder: &Path, max_bytes: u64) -> Room {
        Room::new(folder, RecordingConfig { max_bytes, ..RecordingConfig::default() })
    }

    fn save(folder: &Path, through: u64, state: &[u8]) -> Result<u64, StoreError> {
        write(&RealDisk, folder, &room(folder, 0), &label(through), |out| out.write_all(state))
    }

    fn load(path: &Path) -> Result<(Label, Vec<u8>), CheckpointFault> {
        let mut reader = CheckpointReader::open(path)?;
        let mut state = Vec::new();
        let read = reader.read_to_end(&mut state);
        let label = reader.label().clone();
        reader.finish()?;
        read.map_err(|error| CheckpointFault::Damaged(error.to_string()))?;
        Ok((label, state))
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn the_newest_comes_back_and_older_ones_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        assert!(list(folder.path()).unwrap().is_empty());
        let state: Vec<u8> = (0..100_000u32).flat_map(u32::to_le_bytes).collect();
        let bytes = save(folder.path(), 3, &state[..9]).unwrap();
        assert_eq!(bytes, list(folder.path()).unwrap()[0].metadata().unwrap().len());
        save(folder.path(), 7, &state).unwrap();
        let left = list(folder.path()).unwrap();
        assert_eq!(names(folder.path()), ["checkpoint-0002.lexsplat"]);
        assert_eq!(load(&left[0]).unwrap(), (label(7), state));
    }

    #[test]
    fn a_failed_write_leaves_the_older_one() {
        let folder = tempfile::tempdir().unwrap();
        save(folder.path(), 3, b"good").unwrap();
        let full = |out: &mut dyn Write| {
            out.write_all(&[1; 1000])?;
            Err(std::io::Error::from(std::io::ErrorKind::StorageFull))
        };
        let unlimited = room(folder.path(), 0);
        assert!(write(&RealDisk, folder.path(), &unlimited, &label(4), full).is_err());
        let noise: Vec<u8> =
            (0..9000u64).map(|at| ((at * at * 2_654_435_761) >> 24) as u8).collect();
        let large = |out: &mut dyn Write| out.write_all(&noise);
        let refused = write(&RealDisk, folder.path(), &room(folder.path(), 1000), &label(4), large);
        let refused = refused.unwrap_err().to_string();
        assert!(refused.contains("recording.max_bytes"), "{refused}");
        assert_eq!(names(folder.path()), ["checkpoint-0001.lexsplat"]);
        assert_eq!(load(&list(folder.path()).unwrap()[0]).unwrap().1, b"good");
        // What a crash left is removed by the next one.
        std::fs::write(folder.path().join("checkpoint-0002.lexsplat.unfinished"), "half").unwrap();
        save(folder.path(), 5, b"better").unwrap();
        assert_eq!(names(folder.path()), ["checkpoint-0002.lexsplat"]);
    }

    #[test]
    fn every_flipped_bit_and_every_cut_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        save(folder.path(), 3, &b"some state of a map".repeat(20)).unwrap();
        let path = list(folder.path()).unwrap().remove(0);
        let whole = std::fs::read(&path).unwrap();
        load(&path).unwrap();
        for at in 0..whole.len() {
            let mut flipped = whole.clone();
            flipped[at] ^= 1 << (at % 8);
            std::fs::write(&path, &flipped).unwrap();
            let fault = load(&path).expect_err("it is damaged");
            assert!(matches!(fault, CheckpointFault::Damaged(_)), "bit in byte {at}: {fault}");
            std::fs::write(&path, &whole[..at]).unwrap();
            assert!(load(&path).is_err(), "cut at {at}");
        }
        let longer = [&whole[..], &[0]].concat();
        std::fs::write(&path, longer).unwrap();
        assert!(load(&path).is_err(), "a byte more");
    }
}
