//! A backup: the files of a map's folder in one tar, and back.
//!
//! A backup is taken while frames are recorded. A recording only grows, so what it has at the beginning is
//! what the backup gets; a part of a frame at the end is left out by readers. At the end of the tar there
//! is a list of checksums, in the format of `sha256sum`: a tar that lacks a file, or a part of one, is
//! refused.

use super::checkpoints::{self, CheckpointFault, CheckpointReader};
use super::disk::{Disk, DiskFile};
use super::error::StoreError;
use super::examine::FileReport;
use super::recording::{files, is_recording};
use super::room::Reservation;
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Name of the file at the end of the tar with the checksums of the others. Without it the tar was cut off.
const END: &str = "end-of-backup";
/// A longer list of checksums is refused.
const MAX_END_BYTES: u64 = 1 << 20;
/// Bytes that are copied at once.
const BLOCK: usize = 256 << 10;

/// Why a backup cannot be put in place.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BackupFault {
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The archive is not what it should be; the message names the file in it.
    #[error("{0}")]
    Refused(String),
    /// The archive comes too slowly.
    #[error("the backup breaks off: {0}")]
    Slow(String),
}

/// The files of a backup, opened: they can be read even if the server replaces them meanwhile.
pub(crate) struct Backup(Vec<(String, File, u64)>);

impl Backup {
    /// Opens the recordings in a map's folder, and the newest checkpoint.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(super) fn open(folder: &Path) -> Result<Self, StoreError> {
        let mut paths = checkpoints::list(folder)?;
        paths.truncate(1);
        // After the checkpoint: then every frame that it has is in them.
        paths.extend(files(folder)?);
        let open = |path: PathBuf| {
            let io = |reason| StoreError::io("read", &path, reason);
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            let file = File::open(&path).map_err(io)?;
            let bytes = file.metadata().map_err(io)?.len();
            Ok((name.to_owned(), file, bytes))
        };
        Ok(Self(paths.into_iter().map(open).collect::<Result<_, _>>()?))
    }

    /// Whether there is nothing to back up.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Writes the tar.
    ///
    /// # Errors
    /// The system's error.
    pub(crate) fn write(self, out: impl Write) -> std::io::Result<()> {
        let mut tar = tar::Builder::new(out);
        let mut header = tar::Header::new_gnu();
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        header.set_mode(0o644);
        header.set_mtime(now);
        let mut checksums = String::new();
        for (name, file, bytes) in self.0 {
            header.set_size(bytes);
            let mut contents = Exactly { file, left: bytes, hash: Sha256::new() };
            tar.append_data(&mut header, &name, &mut contents)?;
            checksums += &format!("{}  {name}\n", hex(contents.hash));
        }
        header.set_size(checksums.len() as u64);
        tar.append_data(&mut header, END, checksums.as_bytes())?;
        tar.into_inner()?.flush()
    }
}

fn hex(hash: Sha256) -> String {
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The first bytes of a file, and their checksum. If it has become shorter, that is an error: the archive
/// would be wrong.
struct Exactly {
    file: File,
    left: u64,
    hash: Sha256,
}

impl Read for Exactly {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let wanted = buffer.len().min(usize::try_from(self.left).unwrap_or(usize::MAX));
        let read = self.file.read(&mut buffer[..wanted])?;
        if read == 0 && wanted > 0 {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        self.hash.update(&buffer[..read]);
        self.left -= read as u64;
        Ok(read)
    }
}

/// What a backup had.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Unpacked {
    pub frames: u64,
    /// What of it is not used, in words.
    pub warnings: Vec<String>,
}

/// Unpacks a backup into a folder, which must not exist, and checks every file. After an error the folder is
/// gone.
///
/// # Errors
/// [`BackupFault`].
pub(super) fn unpack(
    disk: &dyn Disk,
    folder: &Path,
    room: &mut Reservation<'_>,
    tar: impl Read,
) -> Result<Unpacked, BackupFault> {
    let io = |reason| StoreError::io("write", folder, reason);
    disk.create_folder(folder).map_err(io)?;
    let unpacked = unpack_files(disk, folder, room, tar).and_then(|()| check(disk, folder));
    let synced = unpacked
        .and_then(|unpacked| disk.sync_folder(folder).map(|()| unpacked).map_err(|e| io(e).into()));
    synced.inspect_err(|_| {
        // What is left is removed at the next start.
        let _ = disk.remove_folder(folder);
    })
}

fn unpack_files(
    disk: &dyn Disk,
    folder: &Path,
    room: &mut Reservation<'_>,
    tar: impl Read,
) -> Result<(), BackupFault> {
    let mut archive = tar::Archive::new(tar);
    let mut checksums = BTreeMap::new();
    // Raw: names that are longer than a header, which would be read into memory, are refused.
    for entry in archive.entries().map_err(unreadable)?.raw(true) {
        let mut entry = entry.map_err(unreadable)?;
        let path = entry.path().map_err(unreadable)?.into_owned();
        if path.as_os_str() == END {
            return expect_checksums(entry, checksums);
        }
        let name = path.to_str().filter(|name| is_recording(name) || checkpoints::is_one(name));
        let Some(name) = name.filter(|_| entry.header().entry_type().is_file()) else {
            let found = format!("a backup has recordings and a checkpoint: found {path:?}");
            return Err(BackupFault::Refused(found));
        };
        let path = folder.join(name);
        let io = |reason| StoreError::io("write", &path, reason);
        // Before the first byte of it is written.
        room.grow(entry.size())?;
        let mut file = match disk.create(&path) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                return Err(BackupFault::Refused(format!("the backup has {name} twice")));
            }
            created => created.map_err(io)?,
        };
        let checksum = copy(&mut entry, &mut *file, &path)?;
        file.sync().map_err(io)?;
        checksums.insert(name.to_owned(), checksum);
    }
    Err(BackupFault::Refused("the end of the backup is missing".into()))
}

/// Why an archive cannot be read, without what is in it: that may be anything.
fn unreadable(error: std::io::Error) -> BackupFault {
    match error.kind() {
        ErrorKind::TimedOut | ErrorKind::UnexpectedEof => broken(error),
        _ => BackupFault::Refused(
            "expected a tar of recordings and a checkpoint; this is none, or it is damaged".into(),
        ),
    }
}

/// Why an archive ends too early.
fn broken(error: std::io::Error) -> BackupFault {
    match error.kind() {
        ErrorKind::TimedOut => BackupFault::Slow(error.to_string()),
        _ => BackupFault::Refused(format!("the backup breaks off: {error}")),
    }
}

/// Compares the checksums of the files with the list at the end of the archive.
fn expect_checksums(
    list: impl Read,
    mut found: BTreeMap<String, String>,
) -> Result<(), BackupFault> {
    let mut expected = String::new();
    list.take(MAX_END_BYTES).read_to_string(&mut expected).map_err(unreadable)?;
    let refused = |name: &str, what| BackupFault::Refused(format!("{name} in the backup {what}"));
    for (checksum, name) in expected.lines().filter_map(|line| line.split_once("  ")) {
        match found.remove(name) {
            Some(found) if found == checksum => {}
            Some(_) => return Err(refused(name, "is not whole: its checksum is wrong")),
            None => return Err(refused(name, "is missing")),
        }
    }
    found.keys().next().map_or(Ok(()), |name| Err(refused(name, "has no checksum at its end")))
}

/// Copies to a file and returns the checksum; tells an archive that breaks off from a disk that is full.
fn copy(from: &mut impl Read, to: &mut dyn DiskFile, path: &Path) -> Result<String, BackupFault> {
    let mut block = vec![0; BLOCK];
    let mut hash = Sha256::new();
    loop {
        let read = from.read(&mut block).map_err(broken)?;
        if read == 0 {
            return Ok(hex(hash));
        }
        hash.update(&block[..read]);
        to.write_all(&block[..read]).map_err(|reason| StoreError::io("write", path, reason))?;
    }
}

/// Checks every file of a folder: a backup has a recording with frames, one checkpoint at most, and nothing
/// that is damaged. A checkpoint of another version is removed: the map can be made of its frames.
fn check(disk: &dyn Disk, folder: &Path) -> Result<Unpacked, BackupFault> {
    let mut unpacked = Unpacked { frames: 0, warnings: Vec::new() };
    let name = |path: &Path| path.file_name().unwrap_or_default().display().to_string();
    for path in files(folder)? {
        let report = FileReport::read(&path)?;
        if !report.damages.is_empty() {
            return Err(BackupFault::Refused(format!("{} in the backup is damaged", name(&path))));
        }
        unpacked.frames += report.frames;
    }
    if unpacked.frames == 0 {
        return Err(BackupFault::Refused("no frame is in the backup".into()));
    }
    let checkpoints = checkpoints::list(folder)?;
    if checkpoints.len() > 1 {
        return Err(BackupFault::Refused("more than one checkpoint is in the backup".into()));
    }
    for path in checkpoints {
        match CheckpointReader::open(&path).and_then(CheckpointReader::finish) {
            Ok(()) => {}
            Err(CheckpointFault::Store(error)) => return Err(error.into()),
            Err(fault @ CheckpointFault::OtherVersion(_)) => {
                disk.remove(&path).map_err(|reason| StoreError::io("remove", &path, reason))?;
                unpacked.warnings.push(format!(
                    "the backup's checkpoint is not used, and the map is made of its frames: {fault}"
                ));
            }
            Err(fault) => {
                let refused = format!("{} in the backup: {fault}", name(&path));
                return Err(BackupFault::Refused(refused));
            }
        }
    }
    Ok(unpacked)
}
