//! **Load** on a running server: robots that send frames and people who ask, both at a constant rate.
//!
//! In: a [`Plan`]. Out: a [`Report`]. Open loop: when a frame or a question is due does not depend on the
//! answers before it, and its latency counts from when it was due, not from when it could be sent, so
//! that a server that stalls cannot hide its stall (coordinated omission). Frames are read or rendered
//! before the clock starts. Nothing is computed here but times; the maps are deleted afterwards.

mod frames;
mod latency;
mod questions;

pub use latency::Latencies;

use frames::Robot;
use lexsplat_client::dataset::Dataset;
use lexsplat_client::http::{HttpClient, HttpError};
use lexsplat_client::stream::ClientError;
use questions::Asker;
use serde::Serialize;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio::task::JoinSet;

/// How much load, and where.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The server's gRPC address.
    pub grpc: String,
    /// The server's HTTP address.
    pub http: String,
    /// What the maps' names begin with.
    pub prefix: String,
    /// Frames per second of each robot.
    pub frames_per_second: f64,
    /// Questions per second, over all maps; 0: none.
    pub queries_per_second: f64,
    /// How long, from the first frame due.
    pub seconds: f64,
    /// What is asked, in turn: about a view, then about space.
    pub texts: Vec<String>,
}

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A stream broke.
    #[error(transparent)]
    Stream(#[from] ClientError),
    /// The HTTP side does not answer.
    #[error(transparent)]
    Http(#[from] HttpError),
    /// A bug.
    #[error("a task of the bench panicked")]
    Panicked,
}

/// What was seen. Latencies in milliseconds, from when a frame or a question was due.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// What the server renders on.
    pub adapter: String,
    /// Robots.
    pub streams: usize,
    /// From the first frame due to the last acknowledgement or answer.
    pub seconds: f64,
    /// Frames over all robots.
    pub frames: FrameReport,
    /// Questions over all maps.
    pub queries: QueryReport,
    /// The server's memory when the load ended; absent where it does not say.
    pub resident_bytes: Option<u64>,
    /// The most memory that the server has had.
    pub peak_resident_bytes: Option<u64>,
}

/// Frames of all robots.
#[derive(Clone, Debug, Default, Serialize)]
pub struct FrameReport {
    /// Due per second, over all robots.
    pub due_per_second: f64,
    /// Acknowledged per second.
    pub acknowledged_per_second: f64,
    /// Sent.
    pub sent: u64,
    /// Acknowledged with a pose.
    pub tracked: u64,
    /// Acknowledged without.
    pub lost: u64,
    /// Refused by a check.
    pub refused: u64,
    /// Accepted and never mapped, as the maps' statuses say.
    pub dropped: u64,
    /// Until the acknowledgement.
    pub latency_ms: Latencies,
}

/// Questions of all askers.
#[derive(Clone, Debug, Default, Serialize)]
pub struct QueryReport {
    /// Due per second.
    pub due_per_second: f64,
    /// Answered per second.
    pub answered_per_second: f64,
    /// Answered.
    pub answered: u64,
    /// Refused, or not answered.
    pub failed: u64,
    /// Not asked, as too many were waiting already.
    pub not_asked: u64,
    /// The first failure.
    pub first_failure: Option<String>,
    /// Until the answer, both kinds.
    pub latency_ms: Latencies,
    /// Until the answer about a view.
    pub view_latency_ms: Latencies,
    /// Until the answer about space.
    pub space_latency_ms: Latencies,
}

/// Puts the load on the server: a robot, and a map, for each data set.
///
/// # Errors
/// [`BenchError`] if a stream breaks or the server cannot be reached; failed questions are counted.
pub async fn run(plan: &Plan, datasets: Vec<Arc<dyn Dataset>>) -> Result<Report, BenchError> {
    let http = HttpClient::new(&plan.http)?;
    let adapter = http.health().await?.adapter;
    let maps: Vec<String> = (0..datasets.len()).map(|at| format!("{}-{at}", plan.prefix)).collect();
    let outcome = load(plan, &http, &maps, datasets).await;
    let mut dropped = 0;
    let metrics = http.metrics().await.unwrap_or_default();
    for map in &maps {
        if let Ok(status) = http.status(map).await {
            dropped += status.frames_dropped;
            http.delete(map).await?;
        }
    }
    let (seconds, mut frames, queries) = outcome?;
    frames.dropped = dropped;
    Ok(Report {
        adapter,
        streams: maps.len(),
        seconds,
        frames,
        queries,
        resident_bytes: gauge(&metrics, "process_resident_memory_bytes"),
        peak_resident_bytes: gauge(&metrics, "process_peak_resident_memory_bytes"),
    })
}

async fn load(
    plan: &Plan,
    http: &HttpClient,
    maps: &[String],
    datasets: Vec<Arc<dyn Dataset>>,
) -> Result<(f64, FrameReport, QueryReport), BenchError> {
    let mut robots = Vec::new();
    for (map, dataset) in maps.iter().zip(datasets) {
        robots.push(Robot::ready(plan, map, dataset).await?);
    }
    // Every robot has had an answer before the first question: an empty map is no load.
    let (first_acks, started) = watch::channel(0_usize);
    let first_acks = Arc::new(first_acks);
    let begin = tokio::time::Instant::now() + Duration::from_millis(50);
    let end = begin + Duration::from_secs_f64(plan.seconds);
    let mut sending = JoinSet::new();
    for robot in robots {
        sending.spawn(robot.run(begin, end, first_acks.clone()));
    }
    let asking = tokio::spawn(Asker::new(plan, http, maps).run(started, end));
    let mut frames = FrameReport {
        due_per_second: plan.frames_per_second * maps.len() as f64,
        ..FrameReport::default()
    };
    let mut latencies = Vec::new();
    while let Some(joined) = sending.join_next().await {
        let sent = joined.map_err(|_| BenchError::Panicked)??;
        frames.sent += sent.sent;
        frames.tracked += sent.tracked;
        frames.lost += sent.lost;
        frames.refused += sent.refused;
        latencies.extend(sent.latencies);
    }
    let acknowledged = latencies.len() as f64;
    let frame_seconds = begin.elapsed().as_secs_f64();
    frames.acknowledged_per_second = acknowledged / frame_seconds;
    frames.latency_ms = Latencies::of(latencies);
    drop(first_acks);
    let queries = asking.await.map_err(|_| BenchError::Panicked)?;
    Ok((begin.elapsed().as_secs_f64(), frames, queries))
}

/// A number of the server's Prometheus text.
fn gauge(metrics: &str, name: &str) -> Option<u64> {
    let line = metrics.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '))?;
    line.trim().parse::<f64>().ok().map(|value| value as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gauges_are_read_by_their_whole_name() {
        let text = "# HELP memory x\nmemory_total 7\nmemory 2.5e3\n";
        assert_eq!(gauge(text, "memory"), Some(2500));
        assert_eq!(gauge(text, "total"), None);
    }
}
