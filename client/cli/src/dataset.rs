//! `KIND:PATH` as users write it on the command line, and opening the data set that it names.

use crate::files::plain;
use lexsplat_client::bags;
use lexsplat_client::dataset::{
    Dataset, DatasetError, Distortion, Folder, FrameRange, FrameRate, Nerfstudio, R3d, Replica,
    ScanNet, SevenScenes, Tum, with_poses,
};
use lexsplat_client::layout::Layout;
use lexsplat_client::rig::Wanted;
use lexsplat_client::stream::Poses;
use lexsplat_synthetic::{SyntheticDataset, Walk};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Seed of the synthetic room if none is given.
const DEFAULT_SEED: u64 = 7;

/// Which data set: `replica:PATH`, `tum:PATH`, `7scenes:PATH`, `nerfstudio:PATH`, `folder:PATH`, `mcap:PATH`,
/// `rosbag2:PATH`, `r3d:FILE`, `scannet:FILE`, `synthetic` or `synthetic:SEED`. Behind the path may be
/// options: `mcap:PATH?color=/topic&depth=/topic`, `replica:PATH?frames_per_second=10`.
#[derive(Clone, Debug, PartialEq)]
pub enum DatasetSpec {
    /// A folder in Replica layout.
    Replica(PathBuf, FrameRate),
    /// A folder in TUM RGB-D layout.
    Tum(PathBuf),
    /// The folder of one sequence in 7-Scenes layout.
    SevenScenes(PathBuf, FrameRate),
    /// A folder in nerfstudio layout, with depth.
    Nerfstudio(PathBuf, FrameRate),
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
            Self::Replica(path, rate) => Box::new(Replica::open(path)?.at_rate(*rate)),
            Self::Tum(path) => Box::new(Tum::open(path)?),
            Self::SevenScenes(path, rate) => Box::new(SevenScenes::open(path)?.at_rate(*rate)),
            Self::Nerfstudio(path, rate) => Box::new(Nerfstudio::open(path)?.at_rate(*rate)),
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
    let (path, options) = with_options(text);
    let layout = Layout::of(&path)?;
    of_layout(layout, path, options).map_err(|error| error.to_string())
}

/// A path; `~/` at its beginning is the home folder, which shells do not put behind `KIND:`.
fn path(text: &str) -> PathBuf {
    match (text.strip_prefix("~/"), std::env::home_dir()) {
        (Some(rest), Some(home)) => home.join(rest),
        _ => text.into(),
    }
}

/// A path, and the options behind a `?`.
fn with_options(text: &str) -> (PathBuf, &str) {
    match text.rsplit_once('?') {
        Some((before, options)) if options.contains('=') && !Path::new(text).exists() => {
            (path(before), options)
        }
        _ => (path(text), ""),
    }
}

/// The data set of a layout with options.
fn of_layout(layout: Layout, path: PathBuf, options: &str) -> Result<DatasetSpec, SpecError> {
    let wanted = || Ok(Box::new(Wanted::parse(options).map_err(SpecError::Options)?));
    let rate = || rate(options).map_err(SpecError::Options);
    let plain = match layout {
        Layout::Replica => return Ok(DatasetSpec::Replica(path, rate()?)),
        Layout::SevenScenes => return Ok(DatasetSpec::SevenScenes(path, rate()?)),
        Layout::Nerfstudio => return Ok(DatasetSpec::Nerfstudio(path, rate()?)),
        Layout::Mcap => return Ok(DatasetSpec::Mcap(path, wanted()?)),
        Layout::Rosbag2 => return Ok(DatasetSpec::Rosbag2(path, wanted()?)),
        Layout::Tum => DatasetSpec::Tum(path),
        Layout::Folder => DatasetSpec::Folder(path),
        Layout::R3d => DatasetSpec::R3d(path),
        Layout::ScanNet => DatasetSpec::ScanNet(path),
    };
    match options {
        "" => Ok(plain),
        _ => Err(SpecError::Options(format!("expected no options of {layout}, found {options:?}"))),
    }
}

/// How many frames a second a data set without times has.
const RATE: &str = "frames_per_second";

fn rate(options: &str) -> Result<FrameRate, String> {
    let mut rate = FrameRate::default();
    for option in options.split('&').filter(|option| !option.is_empty()) {
        rate = match option.split_once('=') {
            Some((RATE, value)) => {
                let number = value.parse::<f64>();
                number
                    .map_err(|_| format!("{RATE}: expected a number, found {value:?}"))?
                    .try_into()?
            }
            _ => return Err(format!("expected one of {RATE}, found {option:?}")),
        };
    }
    Ok(rate)
}

/// Says on standard error what was assumed when a data set was opened, what was left out, and what the
/// server is to do with its lenses.
pub fn tell(dataset: &dyn Dataset) {
    let say = |words: &str| note!("lexsplat: {}", plain(words));
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
            ("synthetic", None) => Ok(Self::Synthetic { seed: DEFAULT_SEED }),
            ("synthetic", Some(seed)) => {
                Ok(Self::Synthetic { seed: seed.parse().map_err(|_| unknown())? })
            }
            (_, None) => Err(unknown()),
            (kind, Some(text)) => {
                let layout = Layout::ALL.into_iter().find(|layout| layout.name() == kind);
                let (path, options) = with_options(text);
                of_layout(layout.ok_or_else(unknown)?, path, options)
            }
        }
    }
}

impl fmt::Display for DatasetSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Replica(path, rate) => timed(f, "replica", path, *rate),
            Self::Tum(path) => write!(f, "tum:{}", path.display()),
            Self::SevenScenes(path, rate) => timed(f, "7scenes", path, *rate),
            Self::Nerfstudio(path, rate) => timed(f, "nerfstudio", path, *rate),
            Self::Folder(path) => write!(f, "folder:{}", path.display()),
            Self::R3d(path) => write!(f, "r3d:{}", path.display()),
            Self::ScanNet(path) => write!(f, "scannet:{}", path.display()),
            Self::Mcap(path, wanted) => written(f, "mcap", path, wanted),
            Self::Rosbag2(path, wanted) => written(f, "rosbag2", path, wanted),
            Self::Synthetic { seed } => write!(f, "synthetic:{seed}"),
        }
    }
}

fn timed(f: &mut fmt::Formatter<'_>, kind: &str, path: &Path, rate: FrameRate) -> fmt::Result {
    write!(f, "{kind}:{}", path.display())?;
    if rate == FrameRate::default() { Ok(()) } else { write!(f, "?{RATE}={rate}") }
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
            "replica:a?frames_per_second=12.5",
            "7scenes:a?frames_per_second=10",
            "nerfstudio:a?frames_per_second=1",
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
        for (text, expected) in [
            ("mcap:a?hue=/a", "expected one of color, depth, info"),
            ("rosbag2:a?registered=maybe", "registered: expected yes or no, found maybe"),
            ("replica:a?color=/a", "expected one of frames_per_second, found \"color=/a\""),
            ("7scenes:a?frames_per_second=fast", "frames_per_second: expected a number"),
            ("nerfstudio:a?frames_per_second=0", "frames_per_second: expected 0.001 to 10000"),
            (
                "tum:a?frames_per_second=3",
                "expected no options of tum, found \"frames_per_second=3\"",
            ),
            ("folder:a?world=map", "expected no options of folder"),
            ("r3d:a?x=1", "expected no options of r3d"),
            ("scannet:a?x=1", "expected no options of scannet"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.starts_with(&format!("dataset: {expected}")), "{text}: {error}");
        }
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
