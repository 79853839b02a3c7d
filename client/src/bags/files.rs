//! The files of a recording: one, or those of a folder in their order.

use super::mcap_file::McapFile;
use super::sqlite::SqliteFile;
use super::store::{Message, Place, Store};
use crate::dataset::{DatasetError, natural_order};
use std::path::{Path, PathBuf};

/// Files with messages, one after the other.
pub(super) struct Files(Vec<Box<dyn Store>>);

/// Where a message lies: the file, and the place in it.
pub(super) type FilePlace = (usize, Place);

impl Files {
    /// MCAP: a file, or the files of a folder.
    ///
    /// # Errors
    /// [`DatasetError`] if there is none.
    pub(super) fn mcap(path: &Path) -> Result<Self, DatasetError> {
        let files = match path.is_dir() {
            true => with_extension(path, "mcap")?,
            false => vec![path.to_owned()],
        };
        if files.is_empty() {
            return Err(DatasetError::content(path, "expected .mcap files, found none"));
        }
        Ok(Self(files.iter().map(|path| Box::new(McapFile::new(path)) as _).collect()))
    }

    /// A bag of ROS 2: a `.db3` file, or a folder with `.db3` or `.mcap` files.
    ///
    /// # Errors
    /// [`DatasetError`] if there is none.
    pub(super) fn rosbag2(path: &Path) -> Result<Self, DatasetError> {
        let is_mcap = path.extension().is_some_and(|extension| extension == "mcap");
        if is_mcap {
            return Self::mcap(path);
        }
        if !path.is_dir() {
            return Ok(Self(vec![Box::new(SqliteFile::open(path)?)]));
        }
        let files = with_extension(path, "db3")?;
        if !files.is_empty() {
            let opened = files.iter().map(|path| Ok(Box::new(SqliteFile::open(path)?) as _));
            return Ok(Self(opened.collect::<Result<_, DatasetError>>()?));
        }
        if !with_extension(path, "mcap")?.is_empty() {
            return Self::mcap(path);
        }
        let reason = match &with_extension(path, "zstd")?[..] {
            [] => "expected .db3 or .mcap files, found none".to_owned(),
            [first, ..] => {
                format!("the files are compressed: decompress each (zstd -d {})", first.display())
            }
        };
        Err(DatasetError::content(path, reason))
    }

    /// Shows every message of every file; see [`Store::scan`].
    ///
    /// # Errors
    /// [`DatasetError`] if nothing can be read.
    pub(super) fn scan(
        &self,
        mut take: impl FnMut(usize, Message<'_>),
    ) -> Result<Vec<String>, DatasetError> {
        let mut problems = Vec::new();
        for (at, file) in self.0.iter().enumerate() {
            match file.scan(&mut |message| take(at, message)) {
                Ok(found) => problems.extend(found),
                Err(error) if self.0.len() == 1 => return Err(error),
                Err(error) => problems.push(format!("left out: {}", error.whole())),
            }
        }
        Ok(problems)
    }

    /// See [`Store::read`].
    ///
    /// # Errors
    /// As there.
    pub(super) fn read(&self, (file, place): FilePlace) -> Result<Vec<u8>, DatasetError> {
        self.0[file].read(place)
    }
}

/// The files of a folder with an extension; numbers in their names count.
fn with_extension(folder: &Path, extension: &str) -> Result<Vec<PathBuf>, DatasetError> {
    let failed = |source| DatasetError::File { path: folder.into(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.extension().is_some_and(|other| other == extension) {
            found.push(path);
        }
    }
    found.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    Ok(found)
}
