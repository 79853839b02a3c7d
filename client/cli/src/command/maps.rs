//! `lexsplat maps`: lists, describes, renames, deletes, saves and restores the maps of a server.

use crate::access::AccessOptions;
use crate::files::part_of;
use crate::output::{self, is_standard};
use anyhow::{Context as _, Result};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use lexsplat_client::http::{HttpClient, MapState, Status, Up};
use lexsplat_evaluate::table::{Column, table};
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// List, describe, rename, delete, save and restore the maps of a server
#[derive(Args)]
#[command(
    after_help = "Examples:\n  lexsplat maps ls\n  lexsplat maps backup kitchen kitchen.tar\n  \
                        lexsplat maps restore kitchen.tar kitchen-2"
)]
pub struct Maps {
    #[command(subcommand)]
    action: Action,
    /// The server's HTTP address
    #[arg(long, global = true, value_name = "ADDR", default_value = "127.0.0.1:8080")]
    http: String,
    #[command(flatten)]
    access: AccessOptions,
}

#[derive(Subcommand)]
enum Action {
    /// List all maps
    Ls {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Print the status of a map as JSON
    Show {
        /// The map
        map: String,
    },
    /// Give a map another name
    Mv {
        /// The map
        map: String,
        /// Its new name; no map may have it
        name: String,
    },
    /// Delete a map with its recording
    Rm {
        /// The map
        map: String,
    },
    /// Save a map's recording and its newest checkpoint in one file, while mapping goes on
    Backup {
        /// The map
        map: String,
        /// The file to write; an old one is replaced; -: standard output
        file: PathBuf,
    },
    /// Put a backup in place as a new map
    Restore {
        /// The file
        file: PathBuf,
        /// The new map's name; no map may have it
        map: String,
    },
}

/// Runs the command.
pub async fn run(arguments: &Maps) -> Result<()> {
    let client = HttpClient::with_access(&arguments.http, &arguments.access.read()?)?;
    match &arguments.action {
        Action::Ls { json } => {
            let maps = client.maps().await?;
            match json {
                true => say!("{}", serde_json::to_string_pretty(&maps)?)?,
                false => say_part!("{}", listed(&maps))?,
            }
        }
        Action::Show { map } => {
            say!("{}", serde_json::to_string_pretty(&client.status(map).await?)?)?;
        }
        Action::Mv { map, name } => {
            client.rename(map, name).await?;
            say!("{map} is {name} now")?;
        }
        Action::Rm { map } => client.delete(map).await?,
        Action::Backup { map, file } => backup(&client, map, file).await?,
        Action::Restore { file, map } => restore(&client, file, map).await?,
    }
    Ok(())
}

/// The maps as a table.
fn listed(maps: &[Status]) -> String {
    if maps.is_empty() {
        return "there is no map\n".into();
    }
    let columns = ["map", "state", "up"].map(Column::left).into_iter();
    let numbers = ["frames", "lost", "keyframes", "Gaussians", "MB"].map(Column::right);
    let row = |map: &Status| {
        let megabytes = (map.gpu_bytes + map.keyframe_bytes) as f64 / 1e6;
        vec![
            map.name.clone(),
            state(map),
            map.up.as_ref().map_or("-".into(), up),
            map.frames_received.to_string(),
            map.frames_lost.to_string(),
            map.keyframes.to_string(),
            map.gaussians.to_string(),
            format!("{megabytes:.0}"),
        ]
    };
    table(&columns.chain(numbers).collect::<Vec<_>>(), &maps.iter().map(row).collect::<Vec<_>>())
}

/// The axis that is nearest to up, and where up is known from.
fn up(up: &Up) -> String {
    let largest = |a: &usize, b: &usize| up.direction[*a].abs().total_cmp(&up.direction[*b].abs());
    let axis = (0..3).max_by(largest).unwrap_or_default();
    let sign = if up.direction[axis] < 0.0 { "-" } else { "" };
    format!("{sign}{} ({})", ["x", "y", "z"][axis], up.source)
}

fn state(map: &Status) -> String {
    match (map.state, &map.loading) {
        (MapState::Failed, _) => "failed".into(),
        (MapState::Loading, Some(loading)) if loading.frames_total > 0 => {
            format!("loading, {} of {} frames", loading.frames_done, loading.frames_total)
        }
        (MapState::Loading, _) => "waits to be loaded".into(),
        (MapState::Ready, _) if map.settled && map.refinement == "refining" => "refining".into(),
        (MapState::Ready, _) if map.settled && map.refinement == "converged" => "converged".into(),
        (MapState::Ready, _) if map.settled => "settled".into(),
        (MapState::Ready, _) => "working".into(),
    }
}

/// Writes a file, or standard output for `-`.
async fn backup(client: &HttpClient, map: &str, path: &Path) -> Result<()> {
    let bar = ProgressBar::new_spinner();
    bar.set_style(ProgressStyle::with_template("{spinner} {bytes}  {bytes_per_sec}")?);
    let done = match is_standard(path) {
        true => {
            let write = |part: &[u8]| -> Result<()> {
                bar.inc(part.len() as u64);
                Ok(output::bytes(part)?)
            };
            client.backup(map, write).await
        }
        false => backup_to(client, map, path, &bar).await,
    };
    bar.finish_and_clear();
    done?;
    if !is_standard(path) {
        say!("wrote {} ({:.1} MB)", path.display(), bar.position() as f64 / 1e6)?;
    }
    Ok(())
}

/// Writes to a temporary file beside it first, so that the file is always complete.
async fn backup_to(client: &HttpClient, map: &str, path: &Path, bar: &ProgressBar) -> Result<()> {
    let part = part_of(path);
    let cannot = || format!("cannot write {}", path.display());
    let mut file = File::create(&part).with_context(cannot)?;
    let written = client
        .backup(map, |bytes| {
            bar.inc(bytes.len() as u64);
            file.write_all(bytes).with_context(cannot)
        })
        .await;
    let done = written
        .and_then(|()| file.sync_all().with_context(cannot))
        .and_then(|()| std::fs::rename(&part, path).with_context(cannot));
    if done.is_err() {
        // A part of a backup is of no use. An error here is told by the one before.
        let _ = std::fs::remove_file(&part);
    }
    done
}

async fn restore(client: &HttpClient, path: &Path, map: &str) -> Result<()> {
    let file = tokio::fs::File::open(path).await;
    let file = file.with_context(|| format!("cannot read {}", path.display()))?;
    let restored = client.restore(map, file).await?;
    restored.warnings.iter().for_each(|warning| note!("warning: {warning}"));
    say!("map {map} is there with {} frames; the server loads it now", restored.frames)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use serde_json::json;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        maps: Maps,
    }

    #[test]
    fn commands_are_read() {
        let read = |words: &[&str]| Line::try_parse_from([&["maps"], words].concat());
        let line = read(&["backup", "kitchen", "k.tar", "--http", "robot:80"]).unwrap();
        assert_eq!(line.maps.http, "robot:80");
        assert!(matches!(line.maps.action, Action::Backup { map, .. } if map == "kitchen"));
        for wrong in [&["backup", "kitchen"][..], &["show"], &["restore", "k.tar"], &[]] {
            assert!(read(wrong).is_err(), "{wrong:?}");
        }
    }

    fn status(extra: serde_json::Value) -> Status {
        let mut value = json!({"name": "room", "revision": 1, "frames_received": 60,
            "frames_tracked": 58, "frames_lost": 2, "frames_dropped": 0, "frames_refused": 0,
            "keyframes": 9, "gaussians": 48213, "gpu_bytes": 20_000_000, "keyframe_bytes": 0,
            "tracking_state": "tracking", "olae_version": 1, "queue_depth": 0,
            "queue_capacity": 8, "settled": true});
        let fields = extra.as_object().unwrap().clone();
        value.as_object_mut().unwrap().extend(fields);
        serde_json::from_value(value).unwrap()
    }

    #[test]
    fn maps_are_listed_with_their_states() {
        assert!(listed(&[]).contains("no map"));
        let text = listed(&[status(json!({}))]);
        assert!(text.contains("settled") && text.contains("48213"), "{text}");
        let known =
            json!({"up": {"direction": [0.1, -0.99, 0.1], "source": "floor", "confidence": 0.8}});
        assert!(listed(&[status(known)]).contains("-y (floor)"));
        let loading = json!({"state": "loading", "settled": false,
            "loading": {"frames_done": 12, "frames_total": 60}});
        assert_eq!(state(&status(loading)), "loading, 12 of 60 frames");
        assert_eq!(state(&status(json!({"state": "failed", "failure": "full"}))), "failed");
        assert_eq!(state(&status(json!({"settled": false, "refinement": "waiting"}))), "working");
        assert_eq!(state(&status(json!({"refinement": "refining"}))), "refining");
        assert_eq!(state(&status(json!({"refinement": "converged"}))), "converged");
        assert_eq!(state(&status(json!({"refinement": "off"}))), "settled");
    }
}
