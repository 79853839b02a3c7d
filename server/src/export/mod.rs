//! A map as a file. In: a snapshot. Out: bytes of PLY, TUM text, PNG or npy.
//!
//! Knows neither gRPC nor HTTP; both edges use it. Everything is in the map's world, metres.

mod npy;
mod picture;
mod ply;
mod tum;

pub use npy::npy;
pub use picture::{depth_png, heatmap_png, rgb_png};
pub use ply::scored_points_ply;
pub use tum::{seconds, trajectory};

use crate::pipeline::snapshot::MapSnapshot;
use std::str::FromStr;

/// Files that a map can be exported as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// Gaussians with the property names that splat viewers read.
    SplatsPly,
    /// Gaussians' centres with their colours.
    PointsPly,
    /// `timestamp tx ty tz qx qy qz qw` of every tracked frame.
    TrajectoryTum,
    /// Compressed splats.
    SplatsSpz,
    /// Splats in glTF.
    SplatsGlb,
    /// A triangle mesh.
    MeshPly,
}

/// Why there is no file.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// Nobody knows the format.
    #[error(
        "{found:?} is no export format: expected splats.ply, points.ply, trajectory.tum, splats.spz, \
         splats.glb or mesh.ply"
    )]
    Unknown {
        /// What was asked for.
        found: String,
    },
    /// It will be there.
    #[error("exporting {format} is not there yet: splats.ply and points.ply are")]
    NotYet {
        /// What was asked for.
        format: &'static str,
    },
}

impl Format {
    /// The file's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::SplatsPly => "splats.ply",
            Self::PointsPly => "points.ply",
            Self::TrajectoryTum => "trajectory.tum",
            Self::SplatsSpz => "splats.spz",
            Self::SplatsGlb => "splats.glb",
            Self::MeshPly => "mesh.ply",
        }
    }
}

impl FromStr for Format {
    type Err = ExportError;

    fn from_str(name: &str) -> Result<Self, ExportError> {
        let all = [
            Self::SplatsPly,
            Self::PointsPly,
            Self::TrajectoryTum,
            Self::SplatsSpz,
            Self::SplatsGlb,
            Self::MeshPly,
        ];
        let unknown = || ExportError::Unknown { found: name.chars().take(40).collect() };
        all.into_iter().find(|format| format.name() == name).ok_or_else(unknown)
    }
}

/// Writes the file; slow for large maps, so call it off the async threads.
///
/// # Errors
/// [`ExportError::NotYet`].
pub fn write(format: Format, snapshot: &MapSnapshot) -> Result<Vec<u8>, ExportError> {
    match format {
        Format::SplatsPly => Ok(ply::splats_ply(&snapshot.gaussians)),
        Format::PointsPly => Ok(ply::points_ply(&snapshot.gaussians)),
        Format::TrajectoryTum => Ok(trajectory(&snapshot.trajectory).into_bytes()),
        Format::SplatsSpz | Format::SplatsGlb | Format::MeshPly => {
            Err(ExportError::NotYet { format: format.name() })
        }
    }
}

/// The least and the greatest; `(0, 0)` of nothing.
pub fn extremes(values: &[f32]) -> (f32, f32) {
    let first = values.first().copied().unwrap_or_default();
    values.iter().fold((first, first), |(min, max), value| (min.min(*value), max.max(*value)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back_and_others_are_not() {
        for name in
            ["splats.ply", "points.ply", "trajectory.tum", "splats.spz", "splats.glb", "mesh.ply"]
        {
            assert_eq!(name.parse::<Format>().unwrap().name(), name);
        }
        assert!("splats.obj".parse::<Format>().unwrap_err().to_string().contains("splats.ply"));
    }

    #[test]
    fn extremes_are_found() {
        assert_eq!(extremes(&[0.3, -1.0, 2.0]), (-1.0, 2.0));
        assert_eq!(extremes(&[]), (0.0, 0.0));
    }
}
