//! Logs and metrics.
//!
//! Logs go to standard error through `tracing`. Metrics are of two kinds: what happens (requests,
//! latencies) goes through the `metrics` facade into one recorder per process; what is (a map's
//! numbers) is read from the maps when somebody asks, see `http::health`.

use metrics_exporter_prometheus::{BuildError, Matcher, PrometheusBuilder, PrometheusHandle};
use serde::{Deserialize, Serialize};
use std::io::IsTerminal as _;
use std::sync::OnceLock;
use std::time::Instant;
use tracing_subscriber::EnvFilter;

/// Histogram: seconds a query took, by `edge`.
pub const QUERY_SECONDS: &str = "lexsplat_query_seconds";
/// Histogram: seconds a rendered picture took, by `channel`.
pub const RENDER_SECONDS: &str = "lexsplat_render_seconds";
/// Histogram: seconds that checking and decoding a frame took.
pub const DECODE_SECONDS: &str = "lexsplat_decode_seconds";
/// Histogram: seconds from a decoded frame to its acknowledgement, waiting in the queue included.
pub const FRAME_SECONDS: &str = "lexsplat_frame_seconds";
/// Histogram: seconds that the networks took for a keyframe.
pub const LANGUAGE_SECONDS: &str = "lexsplat_language_seconds";
/// Histogram: seconds that a frame's pose took; next to nothing where it is given.
pub const TRACKING_SECONDS: &str = "lexsplat_tracking_seconds";
/// Histogram: seconds that a keyframe's new Gaussians took.
pub const INSERTION_SECONDS: &str = "lexsplat_insertion_seconds";
/// Histogram: seconds that one optimiser step took.
pub const MAPPING_SECONDS: &str = "lexsplat_mapping_seconds";
/// Histogram: seconds that the online compressor took for a keyframe, its codes' way into the map included.
pub const COMPRESSION_SECONDS: &str = "lexsplat_compression_seconds";
/// Histogram: seconds that readers' copy of the map took.
pub const SNAPSHOT_SECONDS: &str = "lexsplat_snapshot_seconds";
/// Counter: frames that did not pass the checks, by `field`.
pub const REFUSED: &str = "lexsplat_refused_total";
/// Gauge: streams that are open.
pub const STREAMS: &str = "lexsplat_streams";

/// Bounds of the histograms' buckets, seconds.
const BUCKETS: [f64; 12] =
    [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0];

/// The process's one recorder.
static RECORDER: OnceLock<PrometheusHandle> = OnceLock::new();

/// Settings of the server's log, section `telemetry`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TelemetryConfig {
    /// What is logged: a level, or a comma-separated list of `target=level`.
    pub filter: String,
    /// Write one JSON object per line instead of text.
    pub json: bool,
}

impl Default for TelemetryConfig {
    fn default() -> Self {
        Self { filter: "info".into(), json: false }
    }
}

/// Why logging cannot start.
#[derive(Debug, thiserror::Error)]
pub enum TelemetryError {
    /// The filter does not parse.
    #[error(
        "telemetry.filter is {filter:?}: {reason}; expected for example \"info\" or \"lexsplat_server=debug\""
    )]
    Filter {
        /// What was given.
        filter: String,
        /// Why it does not parse.
        reason: tracing_subscriber::filter::ParseError,
    },
    /// Somebody else logs in this process.
    #[error("logging was started twice")]
    Twice(#[from] tracing_subscriber::util::TryInitError),
}

/// Starts logging to standard error; once per process, by the binary.
///
/// # Errors
/// [`TelemetryError`].
pub fn start_logs(config: &TelemetryConfig) -> Result<(), TelemetryError> {
    use tracing_subscriber::layer::SubscriberExt as _;
    use tracing_subscriber::util::SubscriberInitExt as _;
    let filter = EnvFilter::try_new(&config.filter)
        .map_err(|reason| TelemetryError::Filter { filter: config.filter.clone(), reason })?;
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal());
    let registry = tracing_subscriber::registry().with(filter);
    match config.json {
        true => registry.with(lines.json()).try_init()?,
        false => registry.with(lines).try_init()?,
    }
    Ok(())
}

/// The recorder's handle; the first call installs it.
pub fn recorder() -> &'static PrometheusHandle {
    RECORDER.get_or_init(|| {
        let recorder = builder().expect("the buckets are not empty").build_recorder();
        let handle = recorder.handle();
        if metrics::set_global_recorder(recorder).is_err() {
            tracing::warn!("another metrics recorder is installed: latencies are not in /metrics");
        }
        describe();
        handle
    })
}

/// Does the work and records how long it took.
pub fn timed<T>(stage: &'static str, work: impl FnOnce() -> T) -> T {
    let started = Instant::now();
    let done = work();
    metrics::histogram!(stage).record(started.elapsed());
    done
}

fn builder() -> Result<PrometheusBuilder, BuildError> {
    PrometheusBuilder::new().set_buckets_for_metric(Matcher::Suffix("_seconds".into()), &BUCKETS)
}

fn describe() {
    metrics::describe_histogram!(QUERY_SECONDS, "Seconds a query took");
    metrics::describe_histogram!(RENDER_SECONDS, "Seconds a rendered picture took");
    metrics::describe_histogram!(DECODE_SECONDS, "Seconds that checking and decoding a frame took");
    metrics::describe_histogram!(
        FRAME_SECONDS,
        "Seconds from a decoded frame to its acknowledgement"
    );
    metrics::describe_histogram!(LANGUAGE_SECONDS, "Seconds that the networks took for a keyframe");
    metrics::describe_histogram!(TRACKING_SECONDS, "Seconds that a frame's pose took");
    metrics::describe_histogram!(INSERTION_SECONDS, "Seconds that a keyframe's new Gaussians took");
    metrics::describe_histogram!(MAPPING_SECONDS, "Seconds that one optimiser step took");
    metrics::describe_histogram!(
        COMPRESSION_SECONDS,
        "Seconds that the online compressor took for a keyframe"
    );
    metrics::describe_histogram!(SNAPSHOT_SECONDS, "Seconds that readers' copy of the map took");
    metrics::describe_counter!(REFUSED, "Frames that did not pass the checks");
    metrics::describe_gauge!(STREAMS, "Streams that are open");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recorded_latency_is_in_the_text_and_an_unrecorded_is_not() {
        let handle = recorder();
        metrics::histogram!("lexsplat_test_seconds").record(0.02);
        let text = handle.render();
        assert!(text.contains("lexsplat_test_seconds_bucket{le=\"0.025\"} 1"), "{text}");
        assert!(text.contains("lexsplat_test_seconds_bucket{le=\"0.01\"} 0"), "{text}");
        assert!(!text.contains("lexsplat_other_seconds"), "{text}");
    }

    #[test]
    fn a_filter_that_does_not_parse_is_refused() {
        let config = TelemetryConfig { filter: "lexsplat=loud".into(), json: false };
        let error = start_logs(&config).unwrap_err().to_string();
        assert!(error.contains("telemetry.filter") && error.contains("loud"), "{error}");
    }
}
