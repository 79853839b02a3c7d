//! Exports of maps and of answers as files. In: a snapshot or an answer. Out: bytes of PLY, SPZ,
//! glTF, npz, TUM text, PNG or npy.
//!
//! Both edges use it; it depends on neither gRPC nor HTTP. Positions are in the map's world,
//! metres.

mod dot_splat;
mod glb;
mod labels;
mod mesh;
mod npy;
mod npz;
mod ply;
mod png;
mod splat;
mod spz;
mod trajectory_json;
mod tum;
mod upright;

pub use labels::{label_color, labelled_points_ply, labels_png};
pub use npy::npy;
pub use ply::scored_points_ply;
pub use png::{depth_png, heatmap_png, rgb_png};
pub use tum::{seconds, trajectory};
pub use upright::FileUp;

use crate::pipeline::engine::Engine;
use crate::pipeline::query::{self, Client, Query, QueryError};
use crate::pipeline::snapshot::MapSnapshot;
use nalgebra::Vector3;
use std::str::FromStr;
use std::sync::Arc;
pub(crate) use trajectory_json::TrajectoryEntry;
use trajectory_json::trajectory_json;
use upright::{turn, turned};

/// File formats of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// Gaussians with the property names of splat viewers.
    SplatsPly,
    /// Gaussians, 32 bytes each, what is most to be seen first.
    SplatsSplat,
    /// Gaussians, compressed (Niantic's SPZ).
    SplatsSpz,
    /// Gaussians in glTF (`KHR_gaussian_splatting`).
    SplatsGlb,
    /// Language heads: codes and shapes.
    LanguageNpz,
    /// Centres of the Gaussians, with colors.
    PointsPly,
    /// Triangle mesh.
    MeshPly,
    /// `timestamp tx ty tz qx qy qz qw` of every tracked frame.
    TrajectoryTum,
    /// Poses of every tracked frame with covariances.
    TrajectoryJson,
}

/// Why a file cannot be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The format is unknown.
    #[error(
        "{found:?} is no export format: expected splats.ply, splats.splat, splats.spz, splats.glb, \
         language.npz, points.ply, mesh.ply, trajectory.tum or trajectory.json"
    )]
    Unknown {
        /// Name in the request.
        found: String,
    },
    /// The mesh cannot be built.
    #[error(transparent)]
    Mesh(#[from] QueryError),
    /// The format does not have this option.
    #[error("{field}: only mesh.ply takes it, not {format}")]
    NotForFormat {
        /// `voxel` or `text`.
        field: &'static str,
        /// Name of the format.
        format: &'static str,
    },
    /// The map is too far from the origin for the format.
    #[error(transparent)]
    TooFar(#[from] spz::TooFar),
    /// The export panicked.
    #[error("writing the file panicked: the server's log says where")]
    Panicked,
}

/// Options of a file.
#[derive(Clone, Debug, Default)]
pub struct FileOptions {
    /// Of a mesh: side of a voxel, metres; `None`: [`query::DEFAULT_VOXEL_METRES`].
    pub voxel_metres: Option<f32>,
    /// Of a mesh: query for the relevancy of the vertices.
    pub question: Option<Query>,
    /// Which way is up; `None`: as the format demands, otherwise as in the map.
    pub up: Option<FileUp>,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 9] = [
        Self::SplatsPly,
        Self::SplatsSplat,
        Self::SplatsSpz,
        Self::SplatsGlb,
        Self::LanguageNpz,
        Self::PointsPly,
        Self::MeshPly,
        Self::TrajectoryTum,
        Self::TrajectoryJson,
    ];

    /// File name.
    pub fn name(self) -> &'static str {
        match self {
            Self::SplatsPly => "splats.ply",
            Self::SplatsSplat => "splats.splat",
            Self::SplatsSpz => "splats.spz",
            Self::SplatsGlb => "splats.glb",
            Self::LanguageNpz => "language.npz",
            Self::PointsPly => "points.ply",
            Self::MeshPly => "mesh.ply",
            Self::TrajectoryTum => "trajectory.tum",
            Self::TrajectoryJson => "trajectory.json",
        }
    }

    /// Which way is up if nobody says so: glTF defines it, the others do not.
    fn usual_up(self) -> FileUp {
        match self {
            Self::SplatsGlb => FileUp::Axis(Vector3::y_axis()),
            _ => FileUp::Map,
        }
    }

    /// Media type.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::SplatsGlb => "model/gltf-binary",
            Self::TrajectoryTum => "text/plain; charset=utf-8",
            Self::TrajectoryJson => "application/json",
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

/// Writes a map as a file, on a blocking thread.
///
/// # Errors
/// [`ExportError`] names the option at fault, or the failure.
pub async fn file(
    engine: &Engine,
    client: &Client,
    snapshot: Arc<MapSnapshot>,
    format: Format,
    options: FileOptions,
) -> Result<Vec<u8>, ExportError> {
    let up = options.up.unwrap_or(format.usual_up());
    let write: fn(&MapSnapshot, FileUp) -> Result<Vec<u8>, ExportError> = match format {
        Format::MeshPly => return mesh_file(engine, client, snapshot, up, options).await,
        Format::SplatsPly => |map, up| Ok(ply::splats_ply(&turned(map, up).gaussians)),
        Format::SplatsSplat => |map, up| Ok(dot_splat::splats_splat(&turned(map, up).gaussians)),
        Format::SplatsSpz => |map, up| Ok(spz::splats_spz(&turned(map, up.for_spz()).gaussians)?),
        Format::SplatsGlb => |map, up| Ok(glb::splats_glb(&map.gaussians, &turn(map, up))),
        Format::LanguageNpz => |map, up| Ok(npz::language_npz(&turned(map, up))),
        Format::PointsPly => |map, up| Ok(ply::points_ply(&turned(map, up).gaussians)),
        Format::TrajectoryJson => |map, up| Ok(trajectory_json(&turned(map, up).trajectory)),
        Format::TrajectoryTum => |map, up| Ok(trajectory(&turned(map, up).trajectory).into_bytes()),
    };
    let given =
        [("voxel_metres", options.voxel_metres.is_some()), ("text", options.question.is_some())];
    if let Some((field, _)) = given.into_iter().find(|(_, given)| *given) {
        return Err(ExportError::NotForFormat { field, format: format.name() });
    }
    let written = tokio::task::spawn_blocking(move || write(&snapshot, up)).await;
    written.map_err(|_| ExportError::Panicked)?
}

async fn mesh_file(
    engine: &Engine,
    client: &Client,
    snapshot: Arc<MapSnapshot>,
    up: FileUp,
    options: FileOptions,
) -> Result<Vec<u8>, ExportError> {
    let turned = tokio::task::spawn_blocking(move || Arc::new(turned(&snapshot, up).into_owned()));
    let snapshot = turned.await.map_err(|_| ExportError::Panicked)?;
    let voxel = options.voxel_metres.unwrap_or(query::DEFAULT_VOXEL_METRES);
    let mesh = engine.mesh(client, snapshot, voxel, options.question).await?;
    let written = tokio::task::spawn_blocking(move || mesh::mesh_ply(&mesh)).await;
    written.map_err(|_| ExportError::Panicked)
}

/// Minimum and maximum; `(0, 0)` for an empty slice.
pub fn extremes(values: &[f32]) -> (f32, f32) {
    let first = values.first().copied().unwrap_or_default();
    values.iter().fold((first, first), |(min, max), value| (min.min(*value), max.max(*value)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_parsed_and_unknown_ones_refused() {
        for format in Format::ALL {
            assert_eq!(format.name().parse::<Format>().unwrap(), format);
        }
        assert!("splats.obj".parse::<Format>().unwrap_err().to_string().contains("splats.ply"));
    }

    #[test]
    fn extremes_are_minimum_and_maximum() {
        assert_eq!(extremes(&[0.3, -1.0, 2.0]), (-1.0, 2.0));
        assert_eq!(extremes(&[]), (0.0, 0.0));
    }
}
