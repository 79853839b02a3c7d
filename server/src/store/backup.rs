//! A backup: the files of a map's folder in one tar, and back.
//!
//! A backup is taken while frames are recorded. A recording only grows, so what it has at the beginning is
//! what the backup gets; a part of a frame at the end is left out by readers.

use super::checkpoints::{self, CheckpointFault, CheckpointReader};
use super::disk::{Disk, DiskFile};
use super::error::StoreError;
use super::examine::FileReport;
use super::recording::{files, is_recording};
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Name of an empty file at the end of the tar. Without it the tar was cut off.
const END: &str = "end-of-backup";

/// Why a backup cannot be put in place.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BackupFault {
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The archive is not what it should be; the message names the file in it.
    #[error("{0}")]
    Refused(String),
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
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        for (name, file, bytes) in self.0 {
            let mut header = tar::Header::new_gnu();
            header.set_size(bytes);
            header.set_mode(0o644);
            header.set_mtime(now);
            tar.append_data(&mut header, name, Exactly { file, left: bytes })?;
        }
        let mut header = tar::Header::new_gnu();
        header.set_size(0);
        header.set_mode(0o644);
        header.set_mtime(now);
        tar.append_data(&mut header, END, std::io::empty())?;
        tar.into_inner()?.flush()
    }
}

/// The first bytes of a file. If it has become shorter, that is an error: the archive would be wrong.
struct Exactly {
    file: File,
    left: u64,
}

impl Read for Exactly {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let wanted = buffer.len().min(usize::try_from(self.left).unwrap_or(usize::MAX));
        let read = self.file.read(&mut buffer[..wanted])?;
        if read == 0 && wanted > 0 {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        self.left -= read as u64;
        Ok(read)
    }
}

/// Unpacks a backup into a folder, which must not exist, and checks every file. After an error the folder is
/// gone.
///
/// # Errors
/// [`BackupFault`].
pub(super) fn unpack(disk: &dyn Disk, folder: &Path, tar: impl Read) -> Result<(), BackupFault> {
    let io = |reason| StoreError::io("write", folder, reason);
    disk.create_folder(folder).map_err(io)?;
    let unpacked = unpack_files(disk, folder, tar).and_then(|()| check(folder));
    let synced = unpacked.and_then(|()| Ok(disk.sync_folder(folder).map_err(io)?));
    synced.inspect_err(|_| {
        // What is left is removed at the next start.
        let _ = disk.remove_folder(folder);
    })
}

fn unpack_files(disk: &dyn Disk, folder: &Path, tar: impl Read) -> Result<(), BackupFault> {
    let unreadable = |error: std::io::Error| {
        BackupFault::Refused(format!("expected a tar of recordings and a checkpoint: {error}"))
    };
    let mut archive = tar::Archive::new(tar);
    let mut is_whole = false;
    // Raw: names that are longer than a header, which would be read into memory, are refused.
    for entry in archive.entries().map_err(unreadable)?.raw(true) {
        let mut entry = entry.map_err(unreadable)?;
        let path = entry.path().map_err(unreadable)?.into_owned();
        if path.as_os_str() == END {
            is_whole = true;
            continue;
        }
        let name = path.to_str().filter(|name| is_recording(name) || checkpoints::is_one(name));
        let Some(name) = name.filter(|_| entry.header().entry_type().is_file()) else {
            let found = format!("a backup has recordings and a checkpoint: found {path:?}");
            return Err(BackupFault::Refused(found));
        };
        let path = folder.join(name);
        let io = |reason| StoreError::io("write", &path, reason);
        let mut file = match disk.create(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {
                return Err(BackupFault::Refused(format!("the backup has {name} twice")));
            }
            created => created.map_err(io)?,
        };
        copy(&mut entry, &mut *file, &path)?;
        file.sync().map_err(io)?;
    }
    if is_whole {
        return Ok(());
    }
    Err(BackupFault::Refused("the end of the backup is missing".into()))
}

/// Copies to a file; tells an archive that breaks off from a disk that is full.
fn copy(from: &mut impl Read, to: &mut dyn DiskFile, path: &Path) -> Result<(), BackupFault> {
    let mut block = vec![0; 1 << 18];
    loop {
        let broken = |error| BackupFault::Refused(format!("the backup breaks off: {error}"));
        let read = from.read(&mut block).map_err(broken)?;
        if read == 0 {
            return Ok(());
        }
        to.write_all(&block[..read]).map_err(|reason| StoreError::io("write", path, reason))?;
    }
}

/// Checks every file of a folder: a backup has a recording with frames, and nothing that is damaged.
fn check(folder: &Path) -> Result<(), BackupFault> {
    let mut frames = 0;
    for path in files(folder)? {
        let name = path.file_name().unwrap_or_default().display().to_string();
        let report = FileReport::read(&path)?;
        if !report.damages.is_empty() {
            return Err(BackupFault::Refused(format!("{name} in the backup is damaged")));
        }
        frames += report.frames;
    }
    if frames == 0 {
        return Err(BackupFault::Refused("no frame is in the backup".into()));
    }
    for path in checkpoints::list(folder)? {
        let name = path.file_name().unwrap_or_default().display().to_string();
        match CheckpointReader::open(&path).and_then(CheckpointReader::finish) {
            Ok(()) => {}
            Err(CheckpointFault::Store(error)) => return Err(error.into()),
            Err(fault) => {
                return Err(BackupFault::Refused(format!("{name} in the backup: {fault}")));
            }
        }
    }
    Ok(())
}
