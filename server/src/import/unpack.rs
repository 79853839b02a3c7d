//! Unpacking a zip from somebody else, and finding the recording in it.

use super::error::ImportError;
use super::room::Room;
use lexsplat_client::layout::Layout;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// Folders in folders that are searched for a recording.
const DEPTH: usize = 4;
/// Characters of a name that messages tell.
const LONGEST_TOLD: usize = 100;
/// Folders that macOS adds to zips.
const NOISE: &str = "__MACOSX";

/// Whether a zip is a file of Record3D, which is read as it is.
pub(super) fn is_record3d(zip: &Path) -> bool {
    let Ok(file) = File::open(zip) else { return false };
    let Ok(archive) = ZipArchive::new(BufReader::new(file)) else { return false };
    archive.index_for_name("metadata").is_some()
        && archive.file_names().flatten().any(|name| name.starts_with("rgbd/"))
}

/// Unpacks the files of a zip into a new folder. Links and names that leave the folder are refused.
///
/// # Errors
/// [`ImportError::Refused`], [`ImportError::TooLarge`], [`ImportError::NoRoom`], [`ImportError::Io`].
pub(super) fn unpack(zip: &Path, folder: &Path, room: &Room) -> Result<(), ImportError> {
    let wrong = |reason: String| ImportError::Refused(format!("the zip: {reason}"));
    let file = File::open(zip).map_err(ImportError::Io)?;
    let mut archive =
        ZipArchive::new(BufReader::new(file)).map_err(|error| wrong(error.to_string()))?;
    let limits = &room.limits;
    if archive.len() as u64 > limits.max_files {
        let most = limits.max_files;
        return Err(wrong(format!(
            "it has {} files, at most {most} may be (imports.max_files)",
            archive.len()
        )));
    }
    std::fs::create_dir(folder).map_err(ImportError::Io)?;
    if archive.is_empty() {
        return Err(wrong("it is empty".into()));
    }
    let mut left = limits.max_bytes;
    for at in 0..archive.len() {
        let mut entry = archive.by_index(at).map_err(|error| wrong(error.to_string()))?;
        let name = entry.name().map_err(|error| wrong(error.to_string()))?.into_owned();
        let name = shortened(&name);
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
