//! The routes.

use super::answer_cache::AnswerCache;
use super::browser::{Browsers, protect};
use super::config::{ANY, HttpConfig};
use super::error::Problem;
use super::event_log::EventLogs;
use super::file_cache::FileCache;
use super::guard::guard;
use super::state::Shared;
use super::{
    answers, backup, events, export, health, import, map, openapi, query, render, session,
};
use crate::access::Gate;
use crate::import::Imports;
use crate::maps::RecordedMaps;
use crate::web;
use axum::Router;
use axum::http::{HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse as _, Response};
use axum::routing::{get, post};
use std::any::Any;
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::classify::ServerErrorsFailureClass;
use tower_http::cors::{AllowOrigin, CorsLayer};
use tower_http::trace::TraceLayer;

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
    let cors = cors(&config.cors_origins);
    let browsers = Arc::new(Browsers {
        hosts: config.hosts.clone(),
        origins: config.cors_origins.clone(),
        is_private: gate.asks(),
    });
    let shared = Arc::new(Shared {
        answers: AnswerCache::new(config.recent_answers, config.recent_answers_bytes),
        event_logs: EventLogs::new(config.event_backlog),
        last_file: FileCache::default(),
        maps,
        imports,
        gate: gate.clone(),
        config,
        body_limit,
        stopping,
    });
    let router = Router::new()
        .route("/healthz", get(health::healthz))
        .route("/readyz", get(health::readyz))
        .route("/metrics", get(health::metrics))
        .route("/openapi.json", get(openapi::document))
        .route("/v1/session", post(session::log_in).delete(session::log_out))
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
        .fallback(not_found)
        .with_state(shared)
        .merge(web::router())
        .layer(from_fn_with_state(gate, guard))
        .layer(CatchPanicLayer::custom(panicked))
        .layer(from_fn_with_state(browsers, protect))
        .layer(TraceLayer::new_for_http().on_failure(failed));
    match cors {
        Some(cors) => router.layer(cors),
        None => router,
    }
}

async fn not_found(uri: axum::http::Uri) -> Problem {
    Problem::not_found(format!("no route {}: GET /openapi.json lists all routes", uri.path()))
}

/// Logs an answer with a status of 500 or above. 503 is none: the client is told to try again, and does.
fn failed(class: ServerErrorsFailureClass, latency: Duration, _span: &tracing::Span) {
    let unavailable = StatusCode::SERVICE_UNAVAILABLE;
    if !matches!(class, ServerErrorsFailureClass::StatusCode(code) if code == unavailable) {
        tracing::error!(%class, ?latency, "a response failed");
    }
}

/// The answer to a request after its handler panicked. The panic's message is only in the server's log.
fn panicked(_panic: Box<dyn Any + Send>) -> Response {
    Problem::internal("a handler panicked: see the server's log").into_response()
}

/// The CORS headers for the configured origins; `None` if only pages of this server may use it.
fn cors(origins: &[String]) -> Option<CorsLayer> {
    if origins.is_empty() {
        return None;
    }
    let allowed = match origins.iter().any(|origin| origin == ANY) {
        true => AllowOrigin::any(),
        false => AllowOrigin::list(
            origins.iter().filter_map(|origin| HeaderValue::from_str(origin).ok()),
        ),
    };
    Some(
        CorsLayer::new()
            .allow_origin(allowed)
            .allow_methods([Method::GET, Method::POST, Method::PATCH, Method::DELETE])
            .allow_headers([
                header::AUTHORIZATION,
                header::CONTENT_TYPE,
                header::ACCEPT,
                header::RANGE,
            ])
            .expose_headers([
                header::ETAG,
                header::CONTENT_RANGE,
                header::RETRY_AFTER,
                HeaderName::from_static("lexsplat-revision"),
                HeaderName::from_static("lexsplat-through"),
                HeaderName::from_static("lexsplat-settled"),
                HeaderName::from_static("lexsplat-converged"),
            ]),
    )
}
