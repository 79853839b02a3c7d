//! Running a load test.

use super::asker::Asker;
use super::latency::Latencies;
use super::plan::{BenchError, Plan};
use super::report::{FrameReport, QueryReport, Report};
use super::robot::Robot;
use lexsplat_client::dataset::Dataset;
use lexsplat_client::http::HttpClient;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio::task::JoinSet;

/// Puts the load on the server: one robot with its own map for each data set.
///
/// # Errors
/// [`BenchError`] if a stream breaks or the server cannot be reached. Failed queries are counted
/// instead.
pub async fn run(plan: &Plan, datasets: Vec<Arc<dyn Dataset>>) -> Result<Report, BenchError> {
    let http = HttpClient::with_access(&plan.http, &plan.access)?;
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
    // The first query waits until every robot has an acknowledgement: an empty map is no load.
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

/// A value of the server's Prometheus text.
fn gauge(metrics: &str, name: &str) -> Option<u64> {
    let line = metrics.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '))?;
    line.trim().parse::<f64>().ok().map(|value| value as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gauges_are_found_by_their_full_name() {
        let text = "# HELP memory x\nmemory_total 7\nmemory 2.5e3\n";
        assert_eq!(gauge(text, "memory"), Some(2500));
        assert_eq!(gauge(text, "total"), None);
    }
}
