//! Unpacking a zip from somebody else, and finding the recording in it.

use super::config::ImportsConfig;
use super::error::ImportError;
use super::room::Room;
use lexsplat_client::layout::Layout;
use std::fmt::Display;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use zip::ZipArchive;

/// Folders in folders that are searched for a recording.
const DEPTH: usize = 4;
/// Bytes of the list of files that are read for each of `imports.max_files`, and beside them.
const BYTES_A_FILE: u64 = 256;
const LIST_BYTES: u64 = 1 << 20;
const TOO_MANY: &str = "it has more files than may be (imports.max_files)";
/// Characters of a name that messages tell.
const LONGEST_TOLD: usize = 100;
/// Folders that macOS adds to zips.
const NOISE: &str = "__MACOSX";

/// A zip whose list of files was read.
pub(super) type Zip = ZipArchive<BufReader<Metered>>;

/// A file of which so many bytes may be read.
pub(super) struct Metered {
    file: File,
    left: Arc<AtomicU64>,
}

impl Read for Metered {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let read = self.file.read(buffer)?;
        let left = self.left.load(Ordering::Relaxed);
        let left = left.checked_sub(read as u64).ok_or_else(|| std::io::Error::other(TOO_MANY))?;
        self.left.store(left, Ordering::Relaxed);
        Ok(read)
    }
}

impl Seek for Metered {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.file.seek(to)
    }
}

fn wrong(reason: impl Display) -> ImportError {
    ImportError::Refused(format!("the zip: {reason}"))
}

/// Reads the list of files of a zip. One that is too long is not read to its end: it would fill the memory.
///
/// # Errors
/// [`ImportError::Refused`], [`ImportError::Io`].
pub(super) fn open(zip: &Path, limits: &ImportsConfig) -> Result<Zip, ImportError> {
    let left = Arc::new(AtomicU64::new(limits.max_files.saturating_mul(BYTES_A_FILE) + LIST_BYTES));
    let file = File::open(zip).map_err(ImportError::Io)?;
    let file = BufReader::new(Metered { file, left: left.clone() });
    let archive = ZipArchive::new(file).map_err(wrong)?;
    if archive.len() as u64 > limits.max_files {
        return Err(wrong(TOO_MANY));
    }
    left.store(u64::MAX, Ordering::Relaxed);
    Ok(archive)
}

/// Whether a zip is a file of Record3D, which is read as it is.
pub(super) fn is_record3d(archive: &Zip) -> bool {
    archive.index_for_name("metadata").is_some()
        && archive.file_names().flatten().any(|name| name.starts_with("rgbd/"))
}

/// Unpacks the files of a zip into a new folder. Links and names that leave the folder are refused.
///
/// # Errors
/// [`ImportError::Refused`], [`ImportError::TooLarge`], [`ImportError::NoRoom`], [`ImportError::Io`].
pub(super) fn unpack(mut archive: Zip, folder: &Path, room: &Room) -> Result<(), ImportError> {
    std::fs::create_dir(folder).map_err(ImportError::Io)?;
    if archive.is_empty() {
        return Err(wrong("it is empty"));
    }
    let mut left = room.limits.max_bytes;
    for at in 0..archive.len() {
        let mut entry = archive.by_index(at).map_err(wrong)?;
        let name = shortened(&entry.name().map_err(wrong)?);
        let inside = entry.enclosed_name().filter(|_| !entry.is_symlink());
        let Some(inside) = inside else {
            return Err(wrong(format!(
                "{name:?}: expected a file in a folder, found a link or a path that leaves it"
            )));
        };
        if entry.is_dir() || inside.starts_with(NOISE) {
            continue;
        }
        let path = folder.join(inside);
        let parent = path.parent().unwrap_or(folder);
        // A file may be in the way.
        std::fs::create_dir_all(parent).map_err(|error| wrong(format!("{name:?}: {error}")))?;
        if path.exists() {
            return Err(wrong(format!("{name:?} is there twice")));
        }
        let damaged =
            |error: &std::io::Error| wrong(format!("{name:?} cannot be unpacked: {error}"));
        left -= room.copy(&mut entry, &path, left, damaged).map_err(|error| match error {
            ImportError::Io(error) if error.kind() == std::io::ErrorKind::InvalidFilename => {
                damaged(&error)
            }
            other => other,
        })?;
    }
    Ok(())
}

/// A name for messages.
fn shortened(name: &str) -> String {
    match name.char_indices().nth(LONGEST_TOLD) {
        Some((end, _)) => format!("{}…", &name[..end]),
        None => name.to_owned(),
    }
}

/// The one recording in a folder or its folders.
///
/// # Errors
/// What was looked for, if there is none or more than one.
pub(super) fn find(folder: &Path) -> Result<(Layout, PathBuf), String> {
    let mut found = Vec::new();
    search(folder, DEPTH, &mut found);
    match &found[..] {
        [one] => Ok(one.clone()),
        [] => Err(Layout::of(folder).err().unwrap_or_default()),
        many => {
            let names = many.iter().take(5).map(|(_, path)| path.display().to_string());
            let names = names.collect::<Vec<_>>().join(", ");
            Err(format!(
                "expected one recording, found {} ({names}): send them one by one",
                many.len()
            ))
        }
    }
}

fn search(folder: &Path, depth: usize, found: &mut Vec<(Layout, PathBuf)>) {
    if let Ok(layout) = Layout::of(folder) {
        found.push((layout, folder.to_owned()));
        return;
    }
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() && depth > 0 {
            search(&path, depth - 1, found);
        } else if let Ok(layout) = Layout::of(&path) {
            found.push((layout, path));
        }
    }
}
