//! A map as a file. In: a snapshot. Out: bytes of PLY, SPZ, glTF, npz, TUM text, PNG or npy.
//!
//! Knows neither gRPC nor HTTP; both edges use it. Everything is in the map's world, metres.

mod glb;
mod labels;
mod mesh;
mod npy;
mod npz;
mod picture;
mod ply;
mod splat;
mod spz;
mod tum;

pub use labels::{label_color, labelled_points_ply, labels_png};
pub use npy::npy;
pub use picture::{depth_png, heatmap_png, rgb_png};
pub use ply::scored_points_ply;
pub use tum::{seconds, trajectory};

use crate::pipeline::engine::Engine;
use crate::pipeline::query::{self, Query, QueryError};
use crate::pipeline::snapshot::MapSnapshot;
use std::str::FromStr;
use std::sync::Arc;

/// Files that a map can be exported as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// Gaussians with the property names that splat viewers read.
    SplatsPly,
    /// Gaussians, compressed (Niantic's SPZ).
    SplatsSpz,
    /// Gaussians in glTF (`KHR_gaussian_splatting`).
    SplatsGlb,
    /// Language codes and shapes, beside `splats.ply`.
    LanguageNpz,
    /// Gaussians' centres with their colors.
    PointsPly,
    /// A triangle mesh.
    MeshPly,
    /// `timestamp tx ty tz qx qy qz qw` of every tracked frame.
    TrajectoryTum,
}

/// Why there is no file.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// Nobody knows the format.
    #[error(
        "{found:?} is no export format: expected splats.ply, splats.spz, splats.glb, language.npz, \
         points.ply, mesh.ply or trajectory.tum"
    )]
    Unknown {
        /// What was asked for.
        found: String,
    },
    /// A mesh that cannot be made.
    #[error(transparent)]
    Mesh(#[from] QueryError),
    /// An option that the format does not take.
    #[error("{field}: only mesh.ply takes it, not {format}")]
    NotForFormat {
        /// `voxel` or `text`.
        field: &'static str,
        /// What was asked for.
        format: &'static str,
    },
    /// A bug.
    #[error("writing the file panicked: the server's log says where")]
    Panicked,
}

/// What can be chosen about a mesh.
#[derive(Clone, Debug, Default)]
pub struct MeshOptions {
    /// Side of a voxel, metres; `None`: [`query::DEFAULT_VOXEL_METRES`].
    pub voxel_metres: Option<f32>,
    /// A question, whose relevancy becomes a property of the vertices.
    pub question: Option<Query>,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::SplatsPly,
        Self::SplatsSpz,
        Self::SplatsGlb,
        Self::LanguageNpz,
        Self::PointsPly,
        Self::MeshPly,
        Self::TrajectoryTum,
    ];

    /// The file's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::SplatsPly => "splats.ply",
            Self::SplatsSpz => "splats.spz",
            Self::SplatsGlb => "splats.glb",
            Self::LanguageNpz => "language.npz",
            Self::PointsPly => "points.ply",
            Self::MeshPly => "mesh.ply",
            Self::TrajectoryTum => "trajectory.tum",
        }
    }

    /// Its media type.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::SplatsGlb => "model/gltf-binary",
            Self::TrajectoryTum => "text/plain; charset=utf-8",
            _ => "application/octet-stream",
        }
    }
}

impl FromStr for Format {
    type Err = ExportError;

    fn from_str(name: &str) -> Result<Self, ExportError> {
        let unknown = || ExportError::Unknown { found: name.chars().take(40).collect() };
        Self::ALL.into_iter().find(|format| format.name() == name).ok_or_else(unknown)
    }
}

/// Writes the file, off the async threads.
///
/// # Errors
/// [`ExportError`] names the option at fault, or what failed.
pub async fn file(
    engine: &Engine,
    snapshot: Arc<MapSnapshot>,
    format: Format,
    options: MeshOptions,
) -> Result<Vec<u8>, ExportError> {
    let write: fn(&MapSnapshot) -> Vec<u8> = match format {
        Format::MeshPly => return mesh_file(engine, snapshot, options).await,
        Format::SplatsPly => |snapshot| ply::splats_ply(&snapshot.gaussians),
        Format::SplatsSpz => |snapshot| spz::splats_spz(&snapshot.gaussians),
        Format::SplatsGlb => |snapshot| glb::splats_glb(&snapshot.gaussians),
        Format::LanguageNpz => npz::language_npz,
        Format::PointsPly => |snapshot| ply::points_ply(&snapshot.gaussians),
        Format::TrajectoryTum => |snapshot| trajectory(&snapshot.trajectory).into_bytes(),
    };
    let given = [("voxel", options.voxel_metres.is_some()), ("text", options.question.is_some())];
    if let Some((field, _)) = given.into_iter().find(|(_, given)| *given) {
        return Err(ExportError::NotForFormat { field, format: format.name() });
    }
    let written = tokio::task::spawn_blocking(move || write(&snapshot)).await;
    written.map_err(|_| ExportError::Panicked)
}

async fn mesh_file(
    engine: &Engine,
    snapshot: Arc<MapSnapshot>,
    options: MeshOptions,
) -> Result<Vec<u8>, ExportError> {
    let voxel = options.voxel_metres.unwrap_or(query::DEFAULT_VOXEL_METRES);
    let mesh = engine.mesh(snapshot, voxel, options.question).await?;
    let written = tokio::task::spawn_blocking(move || mesh::mesh_ply(&mesh)).await;
    written.map_err(|_| ExportError::Panicked)
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
        for format in Format::ALL {
            assert_eq!(format.name().parse::<Format>().unwrap(), format);
        }
        assert!("splats.obj".parse::<Format>().unwrap_err().to_string().contains("splats.ply"));
    }

    #[test]
    fn extremes_are_found() {
        assert_eq!(extremes(&[0.3, -1.0, 2.0]), (-1.0, 2.0));
        assert_eq!(extremes(&[]), (0.0, 0.0));
    }
}
