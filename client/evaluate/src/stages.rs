//! Stage times and memory from the server's Prometheus metrics: the difference of two texts for
//! each histogram `lexsplat_STAGE_seconds`. New stages are found by their names.

use serde::Serialize;
use std::collections::BTreeMap;

const PREFIX: &str = "lexsplat_";
const SUM: &str = "_seconds_sum";
const COUNT: &str = "_seconds_count";
/// The stage from the decoded frame to its acknowledgement; it includes the queue.
pub const WITH_WAITING: &str = "frame";
const PEAK_MEMORY: &str = "process_peak_resident_memory_bytes";

/// Times of a stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Stage {
    /// Number of runs.
    pub count: u64,
    /// Sum over all runs, seconds.
    pub seconds: f64,
    /// Mean of a run, milliseconds.
    pub mean_ms: f64,
}

/// Name (with labels, if the server gives any) and value of each line.
fn numbers(text: &str) -> impl Iterator<Item = (&str, f64)> {
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.filter_map(|line| {
        let (name, value) = line.rsplit_once(' ')?;
        Some((name, value.parse().ok()?))
    })
}

/// `lexsplat_render_seconds_sum{channel="color"}` is the sum of `render{channel="color"}`.
fn stage_name(metric: &str, suffix: &str) -> Option<String> {
    let rest = metric.strip_prefix(PREFIX)?;
    let (name, labels) = rest.split_at(rest.find('{').unwrap_or(rest.len()));
    Some(format!("{}{labels}", name.strip_suffix(suffix)?))
}

/// The stages that ran between two texts.
pub fn between(before: &str, after: &str) -> BTreeMap<String, Stage> {
    // Seconds and number of runs.
    let mut sums: BTreeMap<String, [f64; 2]> = BTreeMap::new();
    for (text, sign) in [(before, -1.0), (after, 1.0)] {
        for (name, value) in numbers(text) {
            for (at, suffix) in [SUM, COUNT].into_iter().enumerate() {
                if let Some(stage) = stage_name(name, suffix) {
                    sums.entry(stage).or_default()[at] += sign * value;
                }
            }
        }
    }
    let ran = sums.into_iter().filter(|(_, [_, count])| *count >= 1.0);
    ran.map(|(name, [seconds, count])| {
        (name, Stage { count: count as u64, seconds, mean_ms: seconds / count * 1e3 })
    })
    .collect()
}

/// Peak resident memory of the server, bytes, if it reports it.
pub fn peak_memory(text: &str) -> Option<u64> {
    numbers(text).find(|(name, _)| *name == PEAK_MEMORY).map(|(_, bytes)| bytes as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEFORE: &str = "# TYPE lexsplat_decode_seconds histogram\n\
        lexsplat_decode_seconds_sum 1.5\nlexsplat_decode_seconds_count 10\n\
        lexsplat_language_seconds_sum 3\nlexsplat_language_seconds_count 4\n";
    const AFTER: &str = "lexsplat_decode_seconds_bucket{le=\"0.1\"} 7\n\
        lexsplat_decode_seconds_sum 2.5\nlexsplat_decode_seconds_count 30\n\
        lexsplat_language_seconds_sum 3\nlexsplat_language_seconds_count 4\n\
        lexsplat_render_seconds_sum{channel=\"color\"} 0.5\n\
        lexsplat_render_seconds_count{channel=\"color\"} 5\n\
        lexsplat_maps 1\nprocess_peak_resident_memory_bytes 2097152\n";

    #[test]
    fn stages_are_what_ran_in_between() {
        let stages = between(BEFORE, AFTER);
        let names: Vec<&str> = stages.keys().map(String::as_str).collect();
        assert_eq!(names, ["decode", "render{channel=\"color\"}"], "language did not run");
        assert_eq!(stages["decode"], Stage { count: 20, seconds: 1.0, mean_ms: 50.0 });
        assert_eq!(between("", AFTER)["decode"].count, 30);
        assert!(between("", "").is_empty());
    }

    #[test]
    fn memory_is_found_or_not() {
        assert_eq!(peak_memory(AFTER), Some(2 << 20));
        assert_eq!(peak_memory(BEFORE), None);
    }
}
