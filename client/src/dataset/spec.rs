//! `KIND:PATH` as users write it, and opening what it names.

use super::replica::Replica;
use super::seven_scenes::SevenScenes;
use super::synthetic::Synthetic;
use super::tum::Tum;
use super::{Dataset, DatasetError, FrameRange};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Seed of the synthetic room if none is given.
const DEFAULT_SEED: u64 = 7;

/// Which data set: `replica:PATH`, `tum:PATH`, `7scenes:PATH` or `synthetic[:SEED]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DatasetSpec {
    /// `results/frame%06d.jpg`, `results/depth%06d.png`, `traj.txt`, `cam_params.json`.
    Replica(PathBuf),
    /// `rgb.txt`, `depth.txt`, `groundtruth.txt`.
    Tum(PathBuf),
    /// `frame-%06d.color.*`, `.depth.png`, `.pose.txt`.
    SevenScenes(PathBuf),
    /// A rendered room; nothing is read.
    Synthetic {
        /// Which room.
        seed: u64,
    },
}

impl DatasetSpec {
    /// The same as [`str::parse`].
    ///
    /// # Errors
    /// [`DatasetError::Spec`] and [`DatasetError::NotYet`].
    pub fn parse(text: &str) -> Result<Self, DatasetError> {
        let unknown = || DatasetError::Spec { found: text.to_owned() };
        let (kind, rest) = match text.split_once(':') {
            Some((_, "")) => return Err(unknown()),
            Some((kind, rest)) => (kind, Some(rest)),
            None => (text, None),
        };
        match (kind, rest) {
            ("replica", Some(path)) => Ok(Self::Replica(path.into())),
            ("tum", Some(path)) => Ok(Self::Tum(path.into())),
            ("7scenes", Some(path)) => Ok(Self::SevenScenes(path.into())),
            ("synthetic", None) => Ok(Self::Synthetic { seed: DEFAULT_SEED }),
            ("synthetic", Some(seed)) => {
                Ok(Self::Synthetic { seed: seed.parse().map_err(|_| unknown())? })
            }
            ("mcap", Some(_)) => Err(DatasetError::NotYet { kind: "mcap" }),
            _ => Err(unknown()),
        }
    }

    /// Opens it: checks that the files are there and reads poses, but no pictures.
    ///
    /// # Errors
    /// [`DatasetError`], also if `range` leaves no frames.
    pub fn open(&self, range: FrameRange) -> Result<Box<dyn Dataset>, DatasetError> {
        let dataset: Box<dyn Dataset> = match self {
            Self::Replica(path) => Box::new(Replica::open(path)?),
            Self::Tum(path) => Box::new(Tum::open(path)?),
            Self::SevenScenes(path) => Box::new(SevenScenes::open(path)?),
            Self::Synthetic { seed } => Box::new(Synthetic::new(*seed)),
        };
        range.of(dataset)
    }
}

impl FromStr for DatasetSpec {
    type Err = DatasetError;

    fn from_str(text: &str) -> Result<Self, DatasetError> {
        Self::parse(text)
    }
}

impl fmt::Display for DatasetSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Replica(path) => write!(f, "replica:{}", path.display()),
            Self::Tum(path) => write!(f, "tum:{}", path.display()),
            Self::SevenScenes(path) => write!(f, "7scenes:{}", path.display()),
            Self::Synthetic { seed } => write!(f, "synthetic:{seed}"),
        }
    }
}
