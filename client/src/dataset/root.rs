//! The folder of a recording, and the files in it that its lists name.

use std::path::{Component, Path, PathBuf};

/// The folder of a recording. The lists of a **closed** one may name files inside only: it comes from
/// somebody who may not read other files of this machine.
#[derive(Clone, Debug)]
pub struct Root {
    folder: PathBuf,
    is_closed: bool,
}

impl Root {
    /// A folder with files from elsewhere. There must be no links in it: they are followed.
    #[must_use]
    pub fn closed(folder: &Path) -> Self {
        Self { folder: folder.into(), is_closed: true }
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// The file that a list names. Folders may be separated by backslashes, unless a file's name has them.
    ///
    /// # Errors
    /// What was expected, if the file is outside of a closed folder.
    pub(super) fn listed(&self, name: &str) -> Result<PathBuf, String> {
        let as_written = self.folder.join(name);
        let path = match name.contains('\\') && !as_written.exists() {
            true => self.folder.join(name.replace('\\', "/")),
            false => as_written,
        };
        let is_inside = path.strip_prefix(&self.folder).is_ok_and(|inside| {
            inside.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
        });
        match is_inside || !self.is_closed {
            true => Ok(path),
            false => Err(format!("expected a file in the folder of the recording, found {name:?}")),
        }
    }
}

impl From<&Path> for Root {
    /// A folder of one's own: lists may name any file.
    fn from(folder: &Path) -> Self {
        Self { folder: folder.into(), is_closed: false }
    }
}

impl From<&PathBuf> for Root {
    /// As of a [`Path`].
    fn from(folder: &PathBuf) -> Self {
        folder.as_path().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_closed_folder_is_not_left() {
        let folder = Path::new("/data/walk");
        let (closed, own) = (Root::closed(folder), Root::from(folder));
        for inside in ["rgb/1.png", "./rgb/1.png", "rgb\\1.png", "a..b", "/data/walk/x"] {
            let path = closed.listed(inside).unwrap();
            assert!(path.starts_with(folder), "{inside}");
            assert_eq!(own.listed(inside).as_ref(), Ok(&path));
        }
        assert_eq!(closed.listed("rgb\\1.png").unwrap(), folder.join("rgb/1.png"));
        for outside in ["../x", "rgb/../../x", "/etc/passwd", "..\\x", "..", "/data/walk/../x"] {
            let refused = closed.listed(outside).unwrap_err();
            assert!(refused.contains("in the folder of the recording"), "{refused}");
            assert!(own.listed(outside).is_ok(), "{outside}");
        }
    }
}
