//! `lexsplat bench`: a load test of a running server. Prints latencies, counted from the times that
//! frames and queries were due.

use crate::access::AccessOptions;
use crate::bench::{self, Latencies, Plan, Report};
use crate::dataset::DatasetSpec;
use crate::files::save;
use crate::output::is_standard;
use anyhow::{Result, ensure};
use lexsplat_client::dataset::{Dataset, FrameRange};
use lexsplat_evaluate::table::{Column, table};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;

/// Seed of the first robot's synthetic room; every robot has another one.
const FIRST_SEED: u64 = 100;
/// Objects in the rooms.
const TEXTS: &str = "chair,table,lamp,book,cup";

/// Put load on a server and measure the latency of frames and queries
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
                        lexsplat bench --streams 2 --queries-per-second 5 --seconds 30\n  \
                        lexsplat bench --dataset replica:room0 --frames-per-second 30 --json load.json")]
pub struct Bench {
    /// Robots, each with a map of its own
    #[arg(long, value_name = "N", default_value = "1")]
    streams: NonZeroUsize,
    /// Queries per second over all maps, about views and the whole map in turn; 0: none
    #[arg(long, value_name = "Q", default_value_t = 2.0)]
    queries_per_second: f64,
    /// Duration of the load, seconds
    #[arg(long, value_name = "S", default_value_t = 20.0)]
    seconds: f64,
    /// Frames per second of each robot
    #[arg(long, value_name = "F", default_value_t = 10.0)]
    frames_per_second: f64,
    /// Data set that every robot sends; without it each has its own synthetic room
    #[arg(long, value_name = "KIND:PATH")]
    dataset: Option<DatasetSpec>,
    /// Frames of the data set that are used, back and forth
    #[arg(long, value_name = "N", default_value_t = 120)]
    frames: usize,
    /// Query texts, used in turn
    #[arg(long, value_name = "WORDS", value_delimiter = ',', default_value = TEXTS)]
    texts: Vec<String>,
    /// The server's gRPC address
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:50051")]
    grpc: String,
    /// The server's HTTP address
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8080")]
    http: String,
    #[command(flatten)]
    access: AccessOptions,
    /// Also write the report to this file; -: to standard output, instead of the tables
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub async fn run(arguments: &Bench) -> Result<()> {
    let rate = |name: &str, value: f64, least: f64| -> Result<()> {
        let fits = value.is_finite() && value >= least && value <= 10_000.0;
        ensure!(fits, "--{name}: expected {least} to 10000, found {value}");
        Ok(())
    };
    rate("queries-per-second", arguments.queries_per_second, 0.0)?;
    rate("frames-per-second", arguments.frames_per_second, 0.01)?;
    rate("seconds", arguments.seconds, 0.1)?;
    ensure!(arguments.texts.iter().all(|text| !text.trim().is_empty()), "--texts: one is empty");
    let plan = Plan {
        grpc: arguments.grpc.clone(),
        http: arguments.http.clone(),
        access: arguments.access.read()?,
        prefix: format!("bench-{}", std::process::id()),
        frames_per_second: arguments.frames_per_second,
        queries_per_second: arguments.queries_per_second,
        seconds: arguments.seconds,
        texts: arguments.texts.clone(),
    };
    note!("reading or rendering frames");
    let datasets = datasets(arguments)?;
    let report = bench::run(&plan, datasets).await?;
    match &arguments.json {
        Some(path) if is_standard(path) => say!("{}", serde_json::to_string_pretty(&report)?)?,
        Some(path) => {
            say_part!("{}", described(&report))?;
            save(path, serde_json::to_vec_pretty(&report)?)?;
        }
        None => say_part!("{}", described(&report))?,
    }
    Ok(())
}

fn datasets(arguments: &Bench) -> Result<Vec<Arc<dyn Dataset>>> {
    let stride = NonZeroUsize::MIN;
    let range = FrameRange { end: Some(arguments.frames), stride, ..FrameRange::default() };
    let open = |at: usize| -> Result<Arc<dyn Dataset>> {
        let spec = match &arguments.dataset {
            Some(spec) => spec.clone(),
            None => format!("synthetic:{}", FIRST_SEED + at as u64).parse()?,
        };
        Ok(Arc::from(spec.open(range)?))
    };
    (0..arguments.streams.get()).map(open).collect()
}

fn described(report: &Report) -> String {
    let (frames, queries) = (&report.frames, &report.queries);
    let row = |what: &str, due: f64, done: f64, latency: &Latencies| {
        let rates = [due, done].map(|rate| format!("{rate:.1}"));
        let times = [latency.p50, latency.p90, latency.p99, latency.max];
        let times = times.map(|millis| format!("{millis:.0}"));
        let count = latency.count.to_string();
        [vec![what.to_owned(), count], rates.to_vec(), times.to_vec()].concat()
    };
    let columns = [
        Column::left(""),
        Column::right("count"),
        Column::right("due/s"),
        Column::right("done/s"),
        Column::right("p50 ms"),
        Column::right("p90 ms"),
        Column::right("p99 ms"),
        Column::right("max ms"),
    ];
    let half = queries.due_per_second / 2.0;
    let share = |latency: &Latencies| {
        queries.answered_per_second * latency.count as f64 / (queries.answered.max(1)) as f64
    };
    let (view, space) = (&queries.view_latency_ms, &queries.space_latency_ms);
    let rows = [
        row("frames", frames.due_per_second, frames.acknowledged_per_second, &frames.latency_ms),
        row("queries", queries.due_per_second, queries.answered_per_second, &queries.latency_ms),
        row("  of a view", half, share(view), view),
        row("  of space", half, share(space), space),
    ];
    let mebibytes =
        |bytes: Option<u64>| bytes.map_or("unknown".into(), |bytes| format!("{} MiB", bytes >> 20));
    let mut text = format!(
        "{} robots, {:.1} s, {}; latencies count from when a frame or a question was due\n{}",
        report.streams,
        report.seconds,
        report.adapter,
        table(&columns, &rows)
    );
    text += &format!(
        "frames: {} tracked, {} lost, {} refused, {} dropped; queries: {} failed, {} not asked\n",
        frames.tracked,
        frames.lost,
        frames.refused,
        frames.dropped,
        queries.failed,
        queries.not_asked
    );
    text += &format!(
        "server's memory {}, at most {}\n",
        mebibytes(report.resident_bytes),
        mebibytes(report.peak_resident_bytes)
    );
    if let Some(reason) = &queries.first_failure {
        text += &format!("first failed query: {reason}\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{FrameReport, QueryReport};
    use std::time::Duration;

    #[test]
    fn reports_are_described_with_units_and_failures() {
        let latency_ms = Latencies::of(vec![Duration::from_millis(40); 3]);
        let report = Report {
            adapter: "llvmpipe".into(),
            streams: 2,
            seconds: 10.0,
            frames: FrameReport { tracked: 3, latency_ms, ..FrameReport::default() },
            queries: QueryReport {
                failed: 1,
                first_failure: Some("no such frame".into()),
                ..QueryReport::default()
            },
            resident_bytes: Some(512 << 20),
            peak_resident_bytes: None,
        };
        let text = described(&report);
        assert!(text.starts_with("2 robots, 10.0 s, llvmpipe;"), "{text}");
        assert!(text.contains("p99 ms") && text.contains("3 tracked, 0 lost"), "{text}");
        assert!(text.contains("memory 512 MiB, at most unknown"), "{text}");
        assert!(text.ends_with("first failed query: no such frame\n"), "{text}");
    }
}
