//! Logs and metrics.
//!
//! Logs go to standard error through `tracing`. Counters and latencies go through the `metrics`
//! facade into the recorder of the process. The current numbers of the maps are not recorded:
//! `http::health` reads them from the maps when `/metrics` is requested.

use metrics_exporter_prometheus::{BuildError, Matcher, PrometheusBuilder, PrometheusHandle};
use serde::{Deserialize, Serialize};
use std::io::IsTerminal as _;
use std::sync::OnceLock;
use std::time::Instant;
use tracing_subscriber::EnvFilter;

/// Histogram: seconds per query, by `edge` ("grpc" or "http").
pub(crate) const QUERY_SECONDS: &str = "lexsplat_query_seconds";
/// Histogram: seconds per rendered image, by `channel`.
pub(crate) const RENDER_SECONDS: &str = "lexsplat_render_seconds";
/// Histogram: seconds to check, decode and register a frame.
pub(crate) const DECODE_SECONDS: &str = "lexsplat_decode_seconds";
/// Histogram: seconds to remove distortion from a frame and to register its depth; close to 0 if neither is
/// needed.
pub(crate) const REGISTRATION_SECONDS: &str = "lexsplat_registration_seconds";
/// Histogram: seconds from a decoded frame to its acknowledgement, with the time in the queue.
pub(crate) const FRAME_SECONDS: &str = "lexsplat_frame_seconds";
/// Histogram: seconds of the networks per keyframe.
pub(crate) const LANGUAGE_SECONDS: &str = "lexsplat_language_seconds";
/// Histogram: seconds to track a frame; close to 0 if its pose is given.
pub(crate) const TRACKING_SECONDS: &str = "lexsplat_tracking_seconds";
/// Histogram: seconds to examine whether a frame's poses and depth are as they should be.
pub(crate) const INPUT_CHECK_SECONDS: &str = "lexsplat_input_check_seconds";
/// Histogram: seconds to insert the new Gaussians of a keyframe.
pub(crate) const INSERTION_SECONDS: &str = "lexsplat_insertion_seconds";
/// Histogram: seconds per optimiser step.
pub(crate) const REFINEMENT_SECONDS: &str = "lexsplat_refinement_seconds";
pub(crate) const MAPPING_SECONDS: &str = "lexsplat_mapping_seconds";
/// Histogram: seconds of the online compressor per keyframe, with writing its codes into the map.
pub(crate) const COMPRESSION_SECONDS: &str = "lexsplat_compression_seconds";
/// Histogram: seconds to write a checkpoint.
pub(crate) const CHECKPOINT_SECONDS: &str = "lexsplat_checkpoint_seconds";
/// Histogram: seconds that a map stands still while its state is copied for a checkpoint.
pub(crate) const CHECKPOINT_COPY_SECONDS: &str = "lexsplat_checkpoint_copy_seconds";
/// Histogram: seconds to copy the map into a snapshot for queries.
pub(crate) const SNAPSHOT_SECONDS: &str = "lexsplat_snapshot_seconds";
/// Counter: frames that did not pass the checks, by `field`.
pub(crate) const REFUSED: &str = "lexsplat_refused_total";
/// Counter: loops that were closed and moved the map.
pub(crate) const CLOSED_LOOPS: &str = "lexsplat_closed_loops_total";
/// Histogram: seconds to look for a loop, and to close it, per keyframe.
pub(crate) const CLOSURE_SECONDS: &str = "lexsplat_closure_seconds";
/// Counter: calls that were ended because of an unfinished message, by `reason` ("bytes" or "time").
pub(crate) const UNFINISHED_ENDED: &str = "lexsplat_unfinished_ended_total";
/// Counter: calls that were refused, by `reason` ("unknown" or "forbidden").
pub(crate) const CALLS_REFUSED: &str = "lexsplat_calls_refused_total";
/// Gauge: open connections, by `port` ("grpc" or "http").
pub(crate) const CONNECTIONS: &str = "lexsplat_connections";
/// Counter: connections that did not end well, by `port` and `reason`: "too_many" (of
/// `connections.max`), "timed_out", "handshake" (no TLS), "broken".
pub(crate) const CONNECTIONS_ENDED: &str = "lexsplat_connections_ended_total";
/// Gauge: open streams.
pub(crate) const STREAMS: &str = "lexsplat_streams";

/// Gauge: 1 while a fleet's server is connected with NATS, else 0.
pub(crate) const FLEET_BUS_CONNECTED: &str = "lexsplat_fleet_bus_connected";
/// Histogram: seconds until the fleet's log has a frame.
pub(crate) const FLEET_PUBLISH_SECONDS: &str = "lexsplat_fleet_publish_seconds";
/// Gauge: seconds for which the oldest frame of a gateway has waited for its acknowledgement.
pub(crate) const FLEET_OLDEST_UNACKNOWLEDGED: &str = "lexsplat_fleet_oldest_unacknowledged_seconds";
/// Gauge: maps of the fleet that no worker has, as a gateway sees it.
pub(crate) const FLEET_UNOWNED_MAPS: &str = "lexsplat_fleet_unowned_maps";
/// Gauge: maps that a worker has.
pub(crate) const FLEET_MAPS_OWNED: &str = "lexsplat_fleet_maps_owned";
/// Counter: maps that a worker took.
pub(crate) const FLEET_TAKEOVERS: &str = "lexsplat_fleet_takeovers_total";
/// Counter: maps that a worker lost to another one.
pub(crate) const FLEET_LEASES_LOST: &str = "lexsplat_fleet_leases_lost_total";
/// Gauge: messages of the log that a map does not have yet, by `map`.
pub(crate) const FLEET_LOG_LAG: &str = "lexsplat_fleet_log_lag_frames";
/// Counter: checkpoints that a worker could not write.
pub(crate) const FLEET_CHECKPOINT_FAILURES: &str = "lexsplat_fleet_checkpoint_failures_total";

/// Upper bounds of the histogram buckets, seconds.
const BUCKETS: [f64; 12] =
    [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0];

/// The metrics recorder of the process.
static RECORDER: OnceLock<PrometheusHandle> = OnceLock::new();

/// Settings of the server's log, section `telemetry`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TelemetryConfig {
    /// A level, or a comma-separated list of `target=level`.
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
    /// The filter cannot be parsed.
    #[error(
        "telemetry.filter is {filter:?}: {reason}; expected for example \"info\" or \"lexsplat_server=debug\""
    )]
    Filter {
        /// The configured filter.
        filter: String,
        /// Error of the parser.
        reason: tracing_subscriber::filter::ParseError,
    },
    /// Logging was started before in this process.
    #[error("logging was started twice")]
    Twice(#[from] tracing_subscriber::util::TryInitError),
}

/// Starts logging to standard error. Call it once per process.
///
/// # Errors
/// [`TelemetryError`] if the filter cannot be parsed or logging was started before.
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

/// The metrics recorder; the first call installs it.
pub(crate) fn recorder() -> &'static PrometheusHandle {
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

/// Runs `work` and records its duration in the histogram `stage`.
pub(crate) fn timed<T>(stage: &'static str, work: impl FnOnce() -> T) -> T {
    let started = Instant::now();
    let done = work();
    metrics::histogram!(stage).record(started.elapsed());
    done
}

fn builder() -> Result<PrometheusBuilder, BuildError> {
    PrometheusBuilder::new().set_buckets_for_metric(Matcher::Suffix("_seconds".into()), &BUCKETS)
}

fn describe() {
    metrics::describe_histogram!(QUERY_SECONDS, "Seconds per query");
    metrics::describe_histogram!(RENDER_SECONDS, "Seconds per rendered image");
    metrics::describe_histogram!(DECODE_SECONDS, "Seconds to check, decode and register a frame");
    metrics::describe_histogram!(
        FRAME_SECONDS,
        "Seconds from a decoded frame to its acknowledgement"
    );
    metrics::describe_histogram!(LANGUAGE_SECONDS, "Seconds of the networks per keyframe");
    metrics::describe_histogram!(
        REGISTRATION_SECONDS,
        "Seconds to remove distortion and to register depth"
    );
    metrics::describe_histogram!(TRACKING_SECONDS, "Seconds to track a frame");
    metrics::describe_histogram!(
        INPUT_CHECK_SECONDS,
        "Seconds to examine a frame's poses and depth"
    );
    metrics::describe_histogram!(
        INSERTION_SECONDS,
        "Seconds to insert the new Gaussians of a keyframe"
    );
    metrics::describe_histogram!(REFINEMENT_SECONDS, "Seconds per step of refinement");
    metrics::describe_histogram!(MAPPING_SECONDS, "Seconds per optimiser step");
    metrics::describe_histogram!(
        COMPRESSION_SECONDS,
        "Seconds of the online compressor per keyframe"
    );
    metrics::describe_histogram!(
        SNAPSHOT_SECONDS,
        "Seconds to copy the map into a snapshot for queries"
    );
    metrics::describe_histogram!(CHECKPOINT_SECONDS, "Seconds to copy and write a checkpoint");
    metrics::describe_histogram!(
        CHECKPOINT_COPY_SECONDS,
        "Seconds that a map stands still while its state is copied for a checkpoint"
    );
    metrics::describe_histogram!(CLOSURE_SECONDS, "Seconds to look for a loop and to close it");
    metrics::describe_counter!(CLOSED_LOOPS, "Loops that were closed and moved the map");
    metrics::describe_counter!(REFUSED, "Frames that did not pass the checks");
    metrics::describe_counter!(CALLS_REFUSED, "Calls whose caller is unknown or may not make them");
    metrics::describe_gauge!(CONNECTIONS, "Open connections");
    metrics::describe_counter!(CONNECTIONS_ENDED, "Connections that did not end well");
    metrics::describe_gauge!(STREAMS, "Open streams");
    describe_fleet();
}

fn describe_fleet() {
    metrics::describe_gauge!(FLEET_BUS_CONNECTED, "1 while the server is connected with NATS");
    metrics::describe_histogram!(FLEET_PUBLISH_SECONDS, "Seconds until the log has a frame");
    metrics::describe_gauge!(
        FLEET_OLDEST_UNACKNOWLEDGED,
        "Seconds for which the oldest frame has waited for its acknowledgement"
    );
    metrics::describe_gauge!(FLEET_UNOWNED_MAPS, "Maps that no worker has");
    metrics::describe_gauge!(FLEET_MAPS_OWNED, "Maps that this worker has");
    metrics::describe_counter!(FLEET_TAKEOVERS, "Maps that this worker took");
    metrics::describe_counter!(FLEET_LEASES_LOST, "Maps that this worker lost to another one");
    metrics::describe_gauge!(FLEET_LOG_LAG, "Messages of the log that a map does not have yet");
    metrics::describe_counter!(FLEET_CHECKPOINT_FAILURES, "Checkpoints that were not written");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_recorded_latencies_are_in_the_text() {
        let handle = recorder();
        metrics::histogram!("lexsplat_test_seconds").record(0.02);
        let text = handle.render();
        assert!(text.contains("lexsplat_test_seconds_bucket{le=\"0.025\"} 1"), "{text}");
        assert!(text.contains("lexsplat_test_seconds_bucket{le=\"0.01\"} 0"), "{text}");
        assert!(!text.contains("lexsplat_other_seconds"), "{text}");
    }

    #[test]
    fn a_filter_that_cannot_be_parsed_is_refused() {
        let config = TelemetryConfig { filter: "lexsplat=loud".into(), json: false };
        let error = start_logs(&config).unwrap_err().to_string();
        assert!(error.contains("telemetry.filter") && error.contains("loud"), "{error}");
    }
}
