//! `lexsplat export`: saves a map as a file.

use crate::access::AccessOptions;
use crate::files::save_whole;
use crate::output::{self, is_standard};
use crate::waiting::{self, Waiting};
use anyhow::Result;
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use lexsplat_client::http::{HttpClient, MapFile};
use std::path::PathBuf;

/// Save a map as a file
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  lexsplat export --map kitchen --format ply kitchen.ply\n  \
                        lexsplat export --map kitchen --format mesh --voxel 0.03 --text cup kitchen.ply\n  \
                        lexsplat export --map kitchen --format spz --up y kitchen.spz")]
pub struct Export {
    /// The map
    #[arg(long, value_name = "NAME")]
    map: String,
    /// What to write
    #[arg(long, value_enum)]
    format: Format,
    /// Mesh: side of a voxel, metres (the server's default is 0.02)
    #[arg(long, value_name = "METRES")]
    voxel: Option<f32>,
    /// Mesh: a text; its relevancy becomes a property of the vertices
    #[arg(long, value_name = "WORDS")]
    text: Option<String>,
    /// The axis of the file that points up, or map: the map's own coordinates, which is the default for all
    /// but glb
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true,
          value_parser = ["x", "y", "z", "-x", "-y", "-z", "map"])]
    up: Option<String>,
    /// The server's HTTP address
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8080")]
    http: String,
    #[command(flatten)]
    access: AccessOptions,
    #[command(flatten)]
    waiting: Waiting,
    /// The file to write; an old one is replaced; -: standard output
    file: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Gaussians as splat viewers read them
    Ply,
    /// Centres of the Gaussians with their colors, as PLY
    Points,
    /// Camera poses: timestamp tx ty tz qx qy qz qw
    Tum,
    /// Gaussians, 32 bytes each, what is most to be seen first: web viewers stream it
    Splat,
    /// Gaussians, compressed
    Spz,
    /// Gaussians in glTF
    Glb,
    /// Triangles with colors and language, as PLY
    Mesh,
    /// Language codes and shapes of the Gaussians, in the order of ply, as npz
    Language,
}

impl Format {
    /// Name of the file in the export route.
    fn file(self) -> &'static str {
        match self {
            Self::Ply => "splats.ply",
            Self::Points => "points.ply",
            Self::Splat => "splats.splat",
            Self::Spz => "splats.spz",
            Self::Glb => "splats.glb",
            Self::Mesh => "mesh.ply",
            Self::Language => "language.npz",
            Self::Tum => "trajectory.tum",
        }
    }
}

/// Runs the command.
pub async fn run(arguments: &Export) -> Result<()> {
    let Export { map, format, voxel, text, up, http, access, waiting, file } = arguments;
    let client = waiting.client(http, &access.read()?)?;
    let mut options = Vec::new();
    options.extend(voxel.map(|metres| ("voxel_metres", metres.to_string())));
    options.extend(text.clone().map(|text| ("text", text)));
    options.extend(up.clone().map(|axis| ("up", axis)));
    let MapFile { bytes, of } = download(&client, map, format.file(), &options).await?;
    waiting::note(&of);
    if is_standard(file) {
        return Ok(output::bytes(&bytes)?);
    }
    save_whole(file, &bytes)?;
    say!("wrote {} ({:.1} MB)", file.display(), bytes.len() as f64 / 1e6)?;
    Ok(())
}

async fn download(
    client: &HttpClient,
    map: &str,
    name: &str,
    options: &[(&str, String)],
) -> Result<MapFile> {
    let bar = ProgressBar::new(0);
    bar.set_style(ProgressStyle::with_template(
        "{bar:30} {bytes}/{total_bytes}, {eta} left  {bytes_per_sec}",
    )?);
    let progress = |done: u64, total: Option<u64>| {
        bar.set_length(total.unwrap_or(done));
        bar.set_position(done);
    };
    let file = client.export(map, name, options, progress).await;
    bar.finish_and_clear();
    Ok(file?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        export: Export,
    }

    #[test]
    fn formats_are_read_and_others_are_not() {
        let file = |format: &str| {
            let line = ["export", "--map", "m", "--format", format, "out"];
            Line::try_parse_from(line).map(|line| line.export.format.file())
        };
        assert_eq!(file("ply").unwrap(), "splats.ply");
        assert_eq!(file("mesh").unwrap(), "mesh.ply");
        assert_eq!(file("tum").unwrap(), "trajectory.tum");
        assert!(file("obj").is_err());
        let up = |axis: &str| {
            let line = ["export", "--map", "m", "--format", "ply", "--up", axis, "out"];
            Line::try_parse_from(line).map(|line| line.export.up)
        };
        assert_eq!(up("-y").unwrap().as_deref(), Some("-y"));
        assert!(up("up").is_err());
        assert!(Line::try_parse_from(["export", "--format", "ply", "out"]).is_err(), "no map");
    }
}
