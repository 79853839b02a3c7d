//! **Layouts** of recordings: what a file or folder is, and opening it.

use crate::bags;
use crate::dataset::{
    Dataset, DatasetError, Folder, Nerfstudio, R3d, Replica, Root, ScanNet, SevenScenes, Tum,
};
use crate::rig::Wanted;
use std::fmt;
use std::io::Read as _;
use std::path::{Path, PathBuf};

/// A layout of files that can be read as a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// A folder in Replica layout.
    Replica,
    /// A folder in TUM RGB-D layout.
    Tum,
    /// The folder of one sequence in 7-Scenes layout.
    SevenScenes,
    /// A folder in nerfstudio layout, with depth.
    Nerfstudio,
    /// A folder that `recording.toml` describes.
    Folder,
    /// An MCAP file, or a folder of them.
    Mcap,
    /// A bag of ROS 2.
    Rosbag2,
    /// A `.r3d` file of Record3D.
    R3d,
    /// A `.sens` file of ScanNet.
    ScanNet,
}

/// Layouts of one file, with its extension and the bytes that it begins with.
const FILES: [(Layout, &str, &[u8]); 4] = [
    (Layout::Mcap, "mcap", mcap::MAGIC),
    (Layout::Rosbag2, "db3", b"SQLite format 3\0"),
    (Layout::R3d, "r3d", b"PK\x03\x04"),
    // Version 4 of the format.
    (Layout::ScanNet, "sens", &[4, 0, 0, 0]),
];
/// Bytes of the longest of them.
const BEGINNING: u64 = 16;

impl Layout {
    /// Every layout.
    pub const ALL: [Self; 9] = [
        Self::Replica,
        Self::Tum,
        Self::SevenScenes,
        Self::Nerfstudio,
        Self::Folder,
        Self::Mcap,
        Self::Rosbag2,
        Self::R3d,
        Self::ScanNet,
    ];

    /// Its name on the command line and in answers.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Replica => "replica",
            Self::Tum => "tum",
            Self::SevenScenes => "7scenes",
            Self::Nerfstudio => "nerfstudio",
            Self::Folder => "folder",
            Self::Mcap => "mcap",
            Self::Rosbag2 => "rosbag2",
            Self::R3d => "r3d",
            Self::ScanNet => "scannet",
        }
    }

    /// The layout of a file by its extension, or of a folder by the files in it.
    ///
    /// # Errors
    /// What was looked for, if it is none.
    pub fn of(path: &Path) -> Result<Self, String> {
        if path.is_file() { of_extension(path) } else { of_folder(path) }
    }

    /// The layout of a file by the bytes that it begins with, whatever its name. Any zip may be of Record3D.
    ///
    /// # Errors
    /// The system's, if the file cannot be read.
    pub fn of_content(file: &Path) -> std::io::Result<Option<Self>> {
        let mut beginning = Vec::new();
        std::fs::File::open(file)?.take(BEGINNING).read_to_end(&mut beginning)?;
        let found = FILES.iter().find(|(.., magic)| beginning.starts_with(magic));
        Ok(found.map(|(layout, ..)| *layout))
    }

    /// Opens a recording from somebody who may not read other files of this machine: its lists may name files
    /// in its folder only, see [`Root::closed`].
    ///
    /// # Errors
    /// [`DatasetError`] if it cannot be used.
    pub fn open_closed(self, path: &Path) -> Result<Box<dyn Dataset>, DatasetError> {
        let root = Root::closed(path);
        Ok(match self {
            Self::Replica => Box::new(Replica::open(path)?),
            Self::Tum => Box::new(Tum::open(root)?),
            Self::SevenScenes => Box::new(SevenScenes::open(path)?),
            Self::Nerfstudio => Box::new(Nerfstudio::open(root)?),
            Self::Folder => Box::new(Folder::open(root)?),
            Self::Mcap => bags::mcap(path, &Wanted::default())?,
            Self::Rosbag2 => bags::rosbag2(path, &Wanted::default())?,
            Self::R3d => Box::new(R3d::open(path)?),
            Self::ScanNet => Box::new(ScanNet::open(path)?),
        })
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

fn is(path: &Path, kind: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(kind))
}

fn of_extension(path: &Path) -> Result<Layout, String> {
    if is(path, "bag") {
        return Err(format!(
            "{}: a bag of ROS 1: convert it (pip install rosbags, rosbags-convert --src FILE --dst FOLDER)",
            path.display()
        ));
    }
    let found = FILES.iter().find(|(_, extension, _)| is(path, extension));
    found.map(|(layout, ..)| *layout).ok_or_else(|| {
        let path = path.display();
        format!("{path}: expected a folder, or a file of the kind .mcap, .db3, .r3d or .sens")
    })
}

fn of_folder(folder: &Path) -> Result<Layout, String> {
    let names = std::fs::read_dir(folder)
        .map_err(|error| format!("cannot read {}: {error}", folder.display()))?;
    let names: Vec<PathBuf> = names.flatten().map(|entry| entry.path()).collect();
    let has = |name: &str| folder.join(name).is_file();
    let has_kind = |kind: &str| names.iter().any(|path| is(path, kind));
    let is_scene = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str());
        name.is_some_and(|name| name.starts_with("frame-") && name.contains(".color."))
    };
    let layouts = [
        (Layout::Folder, has("recording.toml")),
        (Layout::Nerfstudio, has("transforms.json")),
        (Layout::Tum, has("rgb.txt") || has("associations.txt")),
        (Layout::Replica, folder.join("results").is_dir()),
        (Layout::SevenScenes, names.iter().any(is_scene)),
        (Layout::Rosbag2, has("metadata.yaml") || has_kind("db3")),
        (Layout::Mcap, has_kind("mcap")),
    ];
    let found = layouts.into_iter().find(|(_, is_there)| *is_there);
    found.map(|(layout, _)| layout).ok_or_else(|| {
        format!(
            "{}: expected recording.toml (folder), transforms.json (nerfstudio), rgb.txt (tum), results/ \
             (replica), frame-000000.color.jpg (7scenes), metadata.yaml (rosbag2) or a file of the kind \
             .mcap or .db3, found none",
            folder.display()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_known_by_its_first_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("upload");
        let of = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            Layout::of_content(&path).unwrap()
        };
        for (layout, _, beginning) in FILES {
            assert_eq!(of(&[beginning, b"and more"].concat()), Some(layout));
            assert_eq!(of(&beginning[..beginning.len() - 1]), None, "{layout}: cut off");
            assert!(beginning.len() as u64 <= BEGINNING);
        }
        assert_eq!((of(b""), of(b"#ROSBAG V2.0\n")), (None, None));
        assert!(Layout::of_content(folder.path()).is_err());
    }
}
