//! `lexsplat-server check`: reads the recordings and checkpoints of a data directory and says what is
//! damaged. It changes nothing, and needs no graphics adapter and no networks.

use crate::store::{self, MapReport};
use std::io::Write;
use std::path::Path;

/// Writes a line for each map and for each damaged file. Returns whether there is a map and nothing is
/// damaged: a directory without one is probably the wrong one.
///
/// # Errors
/// If the directory cannot be listed, or nothing can be written.
pub fn inspect(data: &Path, out: &mut impl Write) -> anyhow::Result<bool> {
    let reports = store::examine(data)?;
    if reports.is_empty() {
        writeln!(out, "no map is in {}: is this the server's --data-dir?", data.display())?;
        return Ok(false);
    }
    for MapReport { map, files, frames, checkpoint, damages } in &reports {
        let checkpoint = match checkpoint {
            Some(through) => format!("checkpoint through frame {through}"),
            None => "no checkpoint".to_owned(),
        };
        let verdict = if damages.is_empty() { "good" } else { "DAMAGED" };
        writeln!(out, "{map}: {frames} frames in {files} recording(s), {checkpoint}: {verdict}")?;
        for damage in damages {
            writeln!(out, "  {damage}")?;
        }
    }
    Ok(reports.iter().all(|report| report.damages.is_empty()))
}
