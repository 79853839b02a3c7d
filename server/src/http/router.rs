//! The routes of a server with maps.

use super::answer_cache::AnswerCache;
use super::config::HttpConfig;
use super::event_log::EventLogs;
use super::file_cache::FileCache;
use super::shell::{Shell, shell};
use super::state::Shared;
use super::{answers, backup, events, export, health, import, map, openapi, query, render};
use crate::access::Gate;
use crate::import::Imports;
use crate::maps::RecordedMaps;
use axum::Router;
use axum::routing::{get, post};
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// The parts of the server that the routes use.
pub(crate) struct Context {
    pub(crate) maps: RecordedMaps,
    pub(crate) imports: Imports,
    /// Who may use which route.
    pub(crate) gate: Gate,
    pub(crate) config: HttpConfig,
    /// How long a request's body may take.
    pub(crate) body_limit: Duration,
    /// Cancelled when the server stops; ends the streams of events.
    pub(crate) stopping: CancellationToken,
}

/// All routes, those of the dashboard included.
pub(crate) fn router(context: Context) -> Router {
    let Context { maps, imports, gate, config, body_limit, stopping } = context;
    let of_shell = Shell { gate: gate.clone(), config: config.clone(), body_limit };
    let shared = Arc::new(Shared {
        answers: AnswerCache::new(config.recent_answers, config.recent_answers_bytes),
        event_logs: EventLogs::new(config.event_backlog),
        last_file: FileCache::default(),
        maps,
        imports,
        config,
        body_limit,
        stopping,
    });
    let router = Router::new()
        .route("/healthz", get(health::healthz))
        .route("/readyz", get(health::readyz))
        .route("/metrics", get(health::metrics))
        .route("/openapi.json", get(openapi::document))
        .route("/v1/maps", get(map::list).post(map::create))
        .route("/v1/maps/{name}", get(map::show).patch(map::rename).delete(map::delete))
        .route("/v1/maps/{name}/query", post(query::ask))
        .route("/v1/maps/{name}/queries/{query_id}/heatmap", get(answers::heatmap))
        .route("/v1/maps/{name}/queries/{query_id}/uncertainty", get(answers::uncertainty))
        .route("/v1/maps/{name}/queries/{query_id}/points", get(answers::points))
        .route("/v1/maps/{name}/queries/{query_id}/labels", get(answers::labels))
        .route("/v1/maps/{name}/frames", get(map::frames))
        .route("/v1/maps/{name}/trajectory", get(map::trajectory))
        .route("/v1/maps/{name}/render", get(render::of_frame).post(render::of_view))
        .route("/v1/maps/{name}/export/{file}", get(export::file))
        .route("/v1/maps/{name}/backup", get(backup::take).put(backup::put))
        .route("/v1/maps/{name}/import", get(import::show).post(import::begin).delete(import::stop))
        .route("/v1/maps/{name}/events", get(events::stream))
        .with_state(shared);
    shell(router, of_shell)
}
