//! Choices of the command line that several commands share, with the texts of their `--help`.

use clap::ValueEnum;
use lexsplat_client::stream;

/// Where the poses of the map come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Poses {
    /// From the data set
    Given,
    /// The server tracks the camera; the data set only gives the pose of the first frame
    #[value(alias = "estimated")]
    Estimate,
}

impl From<Poses> for stream::Poses {
    fn from(poses: Poses) -> Self {
        match poses {
            Poses::Given => Self::Given,
            Poses::Estimate => Self::Estimate,
        }
    }
}

/// Where the map's language comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Encoder {
    /// The server's networks encode each keyframe
    Bundle,
    /// The data set's masks: each pixel's language is the name of its class
    Oracle,
}

impl From<Encoder> for stream::Encoder {
    fn from(encoder: Encoder) -> Self {
        match encoder {
            Encoder::Bundle => Self::Bundle,
            Encoder::Oracle => Self::Oracle,
        }
    }
}
