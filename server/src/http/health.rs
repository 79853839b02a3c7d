//! Liveness, readiness and metrics.

use super::error::Problem;
use super::state::State;
use super::to_json;
use crate::access::Caller;
use crate::pipeline::map::MapStatus;
use crate::telemetry;
use axum::http::header;
use axum::response::IntoResponse;
use axum::{Extension, Json};
use lexsplat_proto::json::{self, Health};
use std::fmt::Write as _;

fn health(state: &State, status: &str) -> Health {
    Health {
        status: status.into(),
        adapter: state.engine().adapter().into(),
        bundle: state.engine().bundle().into(),
        version: env!("CARGO_PKG_VERSION").into(),
        warnings: Vec::new(),
        loading: Vec::new(),
    }
}

/// Whether the process runs.
#[utoipa::path(get, path = "/healthz", operation_id = "get_health", tag = "health", responses((status = 200, body = Health)))]
pub(super) async fn healthz(state: State) -> Json<Health> {
    Json(health(&state, "alive"))
}

/// Whether the server takes requests: until it stops. Warnings tell of damaged recordings, and maps
/// that are still being loaded are listed. Both name maps: who may not use all of them sees the
/// number of warnings only.
#[utoipa::path(
    get, path = "/readyz", operation_id = "get_readiness", tag = "health",
    responses(
        (status = 200, body = Health),
        (status = 503, description = "the server is stopping", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn readyz(
    state: State,
    caller: Option<Extension<Caller>>,
) -> Result<Json<Health>, Problem> {
    if state.stopping.is_cancelled() {
        return Err(Problem::unavailable("the server is stopping"));
    }
    let warnings = state.maps.warnings();
    if caller.is_none_or(|Extension(caller)| caller.may_use_all().is_err()) {
        let count = warnings.len();
        let hidden = (count > 0).then(|| format!("{count}: who may use all maps sees them"));
        let warnings = hidden.into_iter().collect();
        return Ok(Json(Health { warnings, ..health(&state, "ready") }));
    }
    let loading = state.maps.loading().into_iter();
    Ok(Json(Health {
        warnings,
        loading: loading.map(|(map, progress)| to_json::map_loading(map, progress)).collect(),
        ..health(&state, "ready")
    }))
}

/// Metrics as Prometheus text.
#[utoipa::path(
    get, path = "/metrics", operation_id = "get_metrics", tag = "health",
    responses((status = 200, body = String, content_type = "text/plain")),
)]
pub(super) async fn metrics(state: State) -> impl IntoResponse {
    let recorder = telemetry::recorder();
    recorder.run_upkeep();
    let statuses: Vec<MapStatus> = state.engine().maps().iter().map(|map| map.status()).collect();
    let text = recorder.render() + &of_maps(&statuses) + &of_store(&state) + &of_process();
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text)
}

/// Key in `/proc/self/status`, name in Prometheus, and meaning.
const OF_PROCESS: [(&str, &str, &str); 2] = [
    ("VmRSS:", "process_resident_memory_bytes", "Resident memory of the process"),
    ("VmHWM:", "process_peak_resident_memory_bytes", "Peak resident memory of the process"),
];

/// What recordings use of the disk and what is free; empty if nothing is recorded.
fn of_store(state: &State) -> String {
    let Ok(Some(usage)) = state.maps.usage() else { return String::new() };
    let numbers = [
        ("lexsplat_recorded_bytes", "Bytes of all maps in the data directory", usage.total()),
        ("lexsplat_data_free_bytes", "Bytes that are free on its disk", usage.free),
    ];
    let text = numbers.map(|(name, meaning, value)| gauge(name, meaning, value));
    text.concat()
}

/// Memory and descriptors of the process; empty on systems without `/proc`.
pub(crate) fn of_process() -> String {
    let descriptors = std::fs::read_dir("/proc/self/fd").map_or_else(
        |_| String::new(),
        |open| gauge("process_open_fds", "Open file descriptors", open.count() as u64),
    );
    memory(&std::fs::read_to_string("/proc/self/status").unwrap_or_default()) + &descriptors
}

fn gauge(name: &str, meaning: &str, value: u64) -> String {
    format!("# HELP {name} {meaning}\n# TYPE {name} gauge\n{name} {value}\n")
}

fn memory(status: &str) -> String {
    let kibibytes = |line: &str, key: &str| -> Option<u64> {
        line.strip_prefix(key)?.trim().strip_suffix("kB")?.trim().parse().ok()
    };
    let number = |(key, name, meaning): &(&str, &str, &str)| {
        let bytes = status.lines().find_map(|line| kibibytes(line, key))? << 10;
        Some(gauge(name, meaning, bytes))
    };
    OF_PROCESS.iter().filter_map(number).collect()
}

type Value = fn(&MapStatus) -> u64;

/// Name, kind, meaning and value of each metric of a map.
const OF_MAP: [(&str, &str, &str, Value); 14] = [
    ("frames_received_total", "counter", "Frames that passed the checks", |s| s.frames_received),
    ("frames_tracked_total", "counter", "Frames with a pose", |s| s.frames_tracked),
    ("frames_lost_total", "counter", "Frames without a pose", |s| s.frames_lost),
    ("frames_dropped_total", "counter", "Frames accepted but never mapped", |s| s.frames_dropped),
    ("frames_refused_total", "counter", "Frames that did not pass the checks", |s| {
        s.frames_refused
    }),
    ("keyframes", "gauge", "Keyframes", |s| s.keyframes),
    ("gaussians", "gauge", "Gaussians", |s| s.gaussians),
    ("gpu_bytes", "gauge", "GPU memory of the Gaussians", |s| s.gpu_bytes),
    ("keyframe_bytes", "gauge", "Memory of the keyframes' images and language codes", |s| {
        s.keyframe_bytes
    }),
    ("revision", "gauge", "Revision of the newest snapshot", |s| s.revision),
    ("olae_version", "gauge", "Version of the online language compressor", |s| s.olae_version),
    ("queue_depth", "gauge", "Frames in the queue", |s| s.queue_depth as u64),
    ("queue_capacity", "gauge", "Capacity of the queue", |s| s.queue_capacity as u64),
    ("settled", "gauge", "1 when the mapper has nothing left to do", |s| u64::from(s.settled)),
];

/// The current metrics of all maps.
fn of_maps(statuses: &[MapStatus]) -> String {
    let mut text = format!(
        "# HELP lexsplat_maps Number of maps\n# TYPE lexsplat_maps gauge\nlexsplat_maps {}\n",
        statuses.len()
    );
    for (name, kind, meaning, value) in OF_MAP {
        let name = format!("lexsplat_map_{name}");
        let mut line = |line: std::fmt::Arguments<'_>| {
            text.write_fmt(line).expect("writing to a string does not fail");
        };
        line(format_args!("# HELP {name} {meaning}\n# TYPE {name} {kind}\n"));
        for status in statuses {
            // The names of maps have no characters that need escaping.
            line(format_args!("{name}{{map=\"{}\"}} {}\n", status.name, value(status)));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_in_bytes_and_missing_where_unknown() {
        let text = memory("Name:\tserver\nVmHWM:\t  2048 kB\nVmRSS:\t   1024 kB\n");
        assert!(text.contains("\nprocess_resident_memory_bytes 1048576\n"), "{text}");
        assert!(text.contains("\nprocess_peak_resident_memory_bytes 2097152\n"), "{text}");
        assert_eq!(memory("Name:\tserver\nVmRSS:\t many kB\n"), "");
    }

    #[test]
    fn open_descriptors_are_counted() {
        let count = || {
            let text = of_process();
            let line = text.lines().find_map(|line| line.strip_prefix("process_open_fds "));
            line.unwrap().parse::<u64>().unwrap()
        };
        // Other tests open files meanwhile, but not this many.
        let before = count();
        let held: Vec<_> =
            (0..200).map(|_| std::fs::File::open("/proc/self/status").unwrap()).collect();
        assert!(count() > before + 100);
        drop(held);
    }
}
