//! The outcome of a load test.

use super::latency::Latencies;
use serde::Serialize;
use std::time::Duration;

/// The outcome. Latencies are milliseconds from the time that a frame or a query was due.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Graphics adapter of the server.
    pub adapter: String,
    /// Number of robots.
    pub streams: usize,
    /// Seconds from the first frame due to the last acknowledgement or answer.
    pub seconds: f64,
    /// Frames of all robots.
    pub frames: FrameReport,
    /// Queries to all maps.
    pub queries: QueryReport,
    /// Resident memory of the server at the end of the load; absent if it does not report it.
    pub resident_bytes: Option<u64>,
    /// Peak resident memory of the server.
    pub peak_resident_bytes: Option<u64>,
}

/// Frames of all robots.
#[derive(Clone, Debug, Default, Serialize)]
pub struct FrameReport {
    /// Frames due per second, over all robots.
    pub due_per_second: f64,
    /// Frames acknowledged per second.
    pub acknowledged_per_second: f64,
    /// Frames sent.
    pub sent: u64,
    /// Frames acknowledged with a pose.
    pub tracked: u64,
    /// Frames acknowledged without a pose.
    pub lost: u64,
    /// Frames refused by the server's checks.
    pub refused: u64,
    /// Frames accepted but never mapped, from the maps' status.
    pub dropped: u64,
    /// Latency of the acknowledgement.
    pub latency_ms: Latencies,
}

/// Queries to all maps.
#[derive(Clone, Debug, Default, Serialize)]
pub struct QueryReport {
    /// Queries due per second.
    pub due_per_second: f64,
    /// Queries answered per second.
    pub answered_per_second: f64,
    /// Queries answered.
    pub answered: u64,
    /// Queries refused or not answered.
    pub failed: u64,
    /// Queries not asked because too many were waiting.
    pub not_asked: u64,
    /// Message of the first failure.
    pub first_failure: Option<String>,
    /// Latency of all answers.
    pub latency_ms: Latencies,
    /// Latency of answers about a view.
    pub view_latency_ms: Latencies,
    /// Latency of answers about the whole map.
    pub space_latency_ms: Latencies,
}

impl QueryReport {
    /// Counts a failure.
    pub fn fail(&mut self, reason: String) {
        self.failed += 1;
        self.first_failure.get_or_insert(reason);
    }

    /// Sets the answered queries from their latencies; `all` is the time that all of them took.
    pub fn set_answered(&mut self, view: Vec<Duration>, space: Vec<Duration>, all: Duration) {
        self.answered = (space.len() + view.len()) as u64;
        self.answered_per_second = self.answered as f64 / all.as_secs_f64().max(f64::MIN_POSITIVE);
        self.latency_ms = Latencies::of([&space[..], &view[..]].concat());
        self.view_latency_ms = Latencies::of(view);
        self.space_latency_ms = Latencies::of(space);
    }
}
