//! `KIND:PATH` as users write it on the command line, and opening the data set that it names.

use crate::files::plain;
use lexsplat_client::bags;
use lexsplat_client::dataset::{
    Dataset, DatasetError, Distortion, Folder, FrameRange, Nerfstudio, R3d, Replica, ScanNet,
    SevenScenes, Tum, with_poses,
};
use lexsplat_client::rig::Wanted;
use lexsplat_client::stream::Poses;
use lexsplat_synthetic::{SyntheticDataset, Walk};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Seed of the synthetic room if none is given.
const DEFAULT_SEED: u64 = 7;

/// Which data set: `replica:PATH`, `tum:PATH`, `7scenes:PATH`, `nerfstudio:PATH`, `folder:PATH`, `mcap:PATH`,
/// `rosbag2:PATH`, `r3d:FILE`, `scannet:FILE`, `synthetic` or `synthetic:SEED`. Behind the path of `mcap` and
/// `rosbag2` may be options: `mcap:PATH?color=/topic&depth=/topic`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DatasetSpec {
    /// A folder in Replica layout.
    Replica(PathBuf),
    /// A folder in TUM RGB-D layout.
    Tum(PathBuf),
    /// The folder of one sequence in 7-Scenes layout.
    SevenScenes(PathBuf),
    /// A folder in nerfstudio layout, with depth.
    Nerfstudio(PathBuf),
    /// A folder that `recording.toml` describes.
    Folder(PathBuf),
    /// A `.r3d` file of Record3D.
    R3d(PathBuf),
    /// A `.sens` file of ScanNet.
    ScanNet(PathBuf),
    /// An MCAP file, or a folder of them.
    Mcap(PathBuf, Box<Wanted>),
    /// A bag of ROS 2.
    Rosbag2(PathBuf, Box<Wanted>),
    /// A rendered room; no file is read.
    Synthetic {
        /// Which room.
        seed: u64,
    },
}

/// Why a text names no data set.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum SpecError {
    /// Neither a known kind nor a complete specification.
    #[error(
        "dataset: expected replica:PATH, tum:PATH, 7scenes:PATH, nerfstudio:PATH, folder:PATH, mcap:PATH, rosbag2:PATH, r3d:FILE, scannet:FILE, synthetic or synthetic:SEED, found {found:?}"
    )]
    Unknown {
        /// The text that was given.
        found: String,
    },
    /// Options that are not known.
    #[error("dataset: {0}")]
    Options(String),
}

impl DatasetSpec {
    /// Opens its frames with poses: checks that the files are there and reads poses, but no pictures.
    ///
    /// # Errors
    /// [`DatasetError`], also if `range` leaves no frames.
    pub fn open(&self, range: FrameRange) -> Result<Box<dyn Dataset>, DatasetError> {
        range.of(self.whole(0.0, Poses::Given)?)
    }

    /// Opens all of its frames; those with poses, if poses are to be given. Rendered rooms are seen by a
    /// camera that shakes by `shake_radians`; recordings stay as they are.
    ///
    /// # Errors
    /// [`DatasetError`] if the data set cannot be used.
    pub fn whole(
        &self,
        shake_radians: f64,
        poses: Poses,
    ) -> Result<Box<dyn Dataset>, DatasetError> {
        let all = self.all(shake_radians)?;
        match poses {
            Poses::Given => with_poses(all),
            Poses::Estimate => Ok(all),
        }
    }

    fn all(&self, shake_radians: f64) -> Result<Box<dyn Dataset>, DatasetError> {
        Ok(match self {
            Self::Replica(path) => Box::new(Replica::open(path)?),
            Self::Tum(path) => Box::new(Tum::open(path)?),
            Self::SevenScenes(path) => Box::new(SevenScenes::open(path)?),
            Self::Nerfstudio(path) => Box::new(Nerfstudio::open(path)?),
            Self::Folder(path) => Box::new(Folder::open(path)?),
            Self::R3d(path) => Box::new(R3d::open(path)?),
            Self::ScanNet(path) => Box::new(ScanNet::open(path)?),
            Self::Mcap(path, wanted) => bags::mcap(path, wanted)?,
            Self::Rosbag2(path, wanted) => bags::rosbag2(path, wanted)?,
            Self::Synthetic { seed } => {
                Box::new(SyntheticDataset::of(&Walk { shake_radians, ..Walk::new(*seed) }))
            }
        })
    }
}

/// The kind of a file by its name, or of a folder by the files in it. Options may follow, see
/// [`DatasetSpec`].
///
/// # Errors
/// What was looked for, if it is of no known kind.
pub fn recognised(text: &str) -> Result<DatasetSpec, String> {
    let (path, wanted) = with_options(text).map_err(|error| error.to_string())?;
    let is = |path: &Path, kind: &str| {
        path.extension().is_some_and(|found| found.eq_ignore_ascii_case(kind))
    };
    let names = || std::fs::read_dir(&path).into_iter().flatten().flatten();
    let has = |kind: &str| names().any(|entry| is(&entry.path(), kind));
    if path.is_file() && is(&path, "bag") {
        return Err(format!(
            "{}: a bag of ROS 1: convert it (pip install rosbags, rosbags-convert --src FILE --dst FOLDER)",
            path.display()
        ));
    }
    if path.is_file() && is(&path, "mcap") {
        Ok(DatasetSpec::Mcap(path, wanted))
    } else if path.is_file() && is(&path, "db3") {
        Ok(DatasetSpec::Rosbag2(path, wanted))
    } else if path.is_file() && is(&path, "r3d") {
        Ok(DatasetSpec::R3d(path))
    } else if path.is_file() && is(&path, "sens") {
        Ok(DatasetSpec::ScanNet(path))
    } else {
        recognised_folder(&path).or_else(|error| match &path {
            path if path.join("metadata.yaml").is_file() || has("db3") => {
                Ok(DatasetSpec::Rosbag2(path.clone(), wanted))
            }
            path if has("mcap") => Ok(DatasetSpec::Mcap(path.clone(), wanted)),
            _ => Err(error),
        })
    }
}

fn recognised_folder(folder: &Path) -> Result<DatasetSpec, String> {
    let has = |name: &str| folder.join(name).is_file();
    let is_scene = |name: &std::ffi::OsStr| {
        name.to_str().is_some_and(|name| name.starts_with("frame-") && name.contains(".color."))
    };
    let names = std::fs::read_dir(folder)
        .map_err(|error| format!("cannot read {}: {error}", folder.display()))?;
    let has_scene = names.flatten().any(|entry| is_scene(&entry.file_name()));
    Ok(match folder.to_path_buf() {
        path if has("recording.toml") => DatasetSpec::Folder(path),
        path if has("transforms.json") => DatasetSpec::Nerfstudio(path),
        path if has("rgb.txt") || has("associations.txt") => DatasetSpec::Tum(path),
        path if folder.join("results").is_dir() => DatasetSpec::Replica(path),
        path if has_scene => DatasetSpec::SevenScenes(path),
        path => {
            return Err(format!(
                "{}: expected recording.toml (folder), transforms.json (nerfstudio), rgb.txt (tum), results/ \
                 (replica), frame-000000.color.jpg (7scenes), metadata.yaml (rosbag2) or a file of the kind \
                 .mcap or .db3, found none",
                path.display()
            ));
        }
    })
}

/// A path; `~/` at its beginning is the home folder, which shells do not put behind `KIND:`.
fn path(text: &str) -> PathBuf {
    match (text.strip_prefix("~/"), std::env::home_dir()) {
        (Some(rest), Some(home)) => home.join(rest),
        _ => text.into(),
    }
}

/// A path, and options behind a `?`.
fn with_options(text: &str) -> Result<(PathBuf, Box<Wanted>), SpecError> {
    match text.rsplit_once('?') {
        Some((before, options)) if options.contains('=') && !Path::new(text).exists() => {
            Ok((path(before), Box::new(Wanted::parse(options).map_err(SpecError::Options)?)))
        }
        _ => Ok((path(text), Box::default())),
    }
}

/// Says on standard error what was assumed when a data set was opened, what was left out, and what the
/// server is to do with its lenses.
pub fn tell(dataset: &dyn Dataset) {
    let say = |words: &str| eprintln!("lexsplat: {}", plain(words));
    dataset.notes().iter().for_each(|note| say(note));
    if let [first, ..] = dataset.skipped() {
        say(&format!("{} frames left out: {first}", dataset.skipped().len()));
    }
    let cameras = dataset.cameras();
    if cameras.color.distortion != Distortion::None {
        say("the lens of color is bent: the server straightens its pictures");
    }
    if cameras.depth.is_some() {
        say("depth has a camera of its own: the server registers it to color");
    }
}

impl FromStr for DatasetSpec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let unknown = || SpecError::Unknown { found: text.to_owned() };
        let (kind, rest) = match text.split_once(':') {
            Some((_, "")) => return Err(unknown()),
            Some((kind, rest)) => (kind, Some(rest)),
            None => (text, None),
        };
        match (kind, rest) {
            ("replica", Some(text)) => Ok(Self::Replica(path(text))),
            ("tum", Some(text)) => Ok(Self::Tum(path(text))),
            ("7scenes", Some(text)) => Ok(Self::SevenScenes(path(text))),
            ("nerfstudio", Some(text)) => Ok(Self::Nerfstudio(path(text))),
            ("folder", Some(text)) => Ok(Self::Folder(path(text))),
            ("r3d", Some(text)) => Ok(Self::R3d(path(text))),
            ("scannet", Some(text)) => Ok(Self::ScanNet(path(text))),
            ("synthetic", None) => Ok(Self::Synthetic { seed: DEFAULT_SEED }),
            ("synthetic", Some(seed)) => {
                Ok(Self::Synthetic { seed: seed.parse().map_err(|_| unknown())? })
            }
            ("mcap", Some(text)) => {
                with_options(text).map(|(path, wanted)| Self::Mcap(path, wanted))
            }
            ("rosbag2", Some(text)) => {
                with_options(text).map(|(path, wanted)| Self::Rosbag2(path, wanted))
            }
            _ => Err(unknown()),
        }
    }
}

impl fmt::Display for DatasetSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Replica(path) => write!(f, "replica:{}", path.display()),
            Self::Tum(path) => write!(f, "tum:{}", path.display()),
            Self::SevenScenes(path) => write!(f, "7scenes:{}", path.display()),
            Self::Nerfstudio(path) => write!(f, "nerfstudio:{}", path.display()),
            Self::Folder(path) => write!(f, "folder:{}", path.display()),
            Self::R3d(path) => write!(f, "r3d:{}", path.display()),
            Self::ScanNet(path) => write!(f, "scannet:{}", path.display()),
            Self::Mcap(path, wanted) => written(f, "mcap", path, wanted),
            Self::Rosbag2(path, wanted) => written(f, "rosbag2", path, wanted),
            Self::Synthetic { seed } => write!(f, "synthetic:{seed}"),
        }
    }
}

fn written(f: &mut fmt::Formatter<'_>, kind: &str, path: &Path, wanted: &Wanted) -> fmt::Result {
    write!(f, "{kind}:{}", path.display())?;
    if *wanted == Wanted::default() { Ok(()) } else { write!(f, "?{wanted}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::num::NonZeroUsize;

    #[test]
    fn specs_are_read_and_written() {
        let parse = |text: &str| text.parse::<DatasetSpec>();
        for text in [
            "replica:a/b",
            "tum:a:b",
            "7scenes:/x",
            "nerfstudio:p",
            "folder:q",
            "r3d:a.r3d",
            "scannet:a.sens",
            "mcap:a.mcap",
            "mcap:a.mcap?color=/rgb&pose=none",
            "rosbag2:bag?world=odom&registered=no",
            "synthetic:12",
        ] {
            assert_eq!(parse(text).unwrap().to_string(), text);
        }
        assert_eq!(parse("synthetic").unwrap(), DatasetSpec::Synthetic { seed: 7 });
        for text in ["", "replica", "replica:", "synthetic:x", "scan:a", "7scene:a"] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.starts_with("dataset: expected replica:PATH"), "{text}: {error}");
        }
        let home = std::env::home_dir().unwrap();
        assert_eq!(parse("tum:~/desk").unwrap(), DatasetSpec::Tum(home.join("desk")));
        assert_eq!(parse("tum:a/~/desk").unwrap(), DatasetSpec::Tum("a/~/desk".into()));
        assert_eq!(parse("mcap:what?").unwrap(), DatasetSpec::Mcap("what?".into(), Box::default()));
        let error = parse("mcap:a?hue=/a").unwrap_err().to_string();
        assert!(error.starts_with("dataset: expected one of color, depth, info"), "{error}");
    }

    #[test]
    fn a_synthetic_room_opens_without_a_folder_and_a_missing_folder_is_an_error() {
        let stride = NonZeroUsize::new(149).unwrap();
        let range = FrameRange { stride, ..FrameRange::default() };
        let part = DatasetSpec::Synthetic { seed: 5 }.open(range).unwrap();
        assert_eq!((part.name(), part.len(), part.sequence(1)), ("synthetic-5", 2, 149));
        let missing = tempfile::tempdir().unwrap().path().join("missing");
        for kind in [
            "replica",
            "tum",
            "7scenes",
            "nerfstudio",
            "folder",
            "mcap",
            "rosbag2",
            "r3d",
            "scannet",
        ] {
            let spec: DatasetSpec = format!("{kind}:{}", missing.display()).parse().unwrap();
            let error = spec.open(FrameRange::default()).err().unwrap().to_string();
            assert!(error.contains("cannot read") && error.contains("missing"), "{error}");
        }
    }
}
