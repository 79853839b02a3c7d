//! Edge out: HTTP. Questions, pictures, files and events of the maps as JSON, PNG, PLY and
//! server-sent events; errors are RFC 9457 problems.
//!
//! Checks of cameras, poses and questions are `ingest::convert`'s, so that both edges refuse alike.
//! Nothing here touches a live map: everything is read from snapshots and statuses.

mod answers;
mod config;
mod error;
mod events;
mod export;
mod extract;
mod health;
mod map;
mod openapi;
mod query;
mod range;
mod render;
mod segment;
mod view;

pub use answers::query_id;
pub use config::HttpConfig;
pub use error::Problem;

use crate::pipeline::engine::Engine;
use crate::store::Store;
use crate::web;
use answers::Answers;
use axum::Router;
use axum::http::{HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use events::Recorders;
use export::LastFile;
use std::any::Any;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::cors::{AllowOrigin, CorsLayer};
use tower_http::trace::TraceLayer;

/// What the routes work with.
pub struct Context {
    /// The pipeline.
    pub engine: Arc<Engine>,
    /// Where deleted maps must be forgotten, too.
    pub store: Store,
    /// Limits.
    pub config: HttpConfig,
    /// False while maps are rebuilt.
    pub ready: watch::Receiver<bool>,
    /// Ends streams of events.
    pub stopping: CancellationToken,
}

/// What the handlers share.
struct Shared {
    engine: Arc<Engine>,
    store: Store,
    config: HttpConfig,
    ready: watch::Receiver<bool>,
    stopping: CancellationToken,
    answers: Answers,
    recorders: Recorders,
    last_file: LastFile,
}

type State = axum::extract::State<Arc<Shared>>;

impl Shared {
    /// Gives up on work that takes longer than configured.
    async fn in_time<T>(&self, work: impl Future<Output = T>) -> Result<T, Problem> {
        let limit = Duration::from_secs(self.config.request_seconds);
        tokio::time::timeout(limit, work)
            .await
            .map_err(|_| Problem::unavailable(format!("no answer within {limit:?}: try again")))
    }
}

/// All routes; needs no socket.
pub fn router(context: Context) -> Router {
    let Context { engine, store, config, ready, stopping } = context;
    let cors = cors(&config.cors_origins);
    let shared = Arc::new(Shared {
        answers: Answers::new(config.recent_answers, config.recent_answers_bytes),
        recorders: Recorders::new(config.event_backlog),
        last_file: LastFile::default(),
        engine,
        store,
        config,
        ready,
        stopping,
    });
    let router = Router::new()
        .route("/healthz", get(health::healthz))
        .route("/readyz", get(health::readyz))
        .route("/metrics", get(health::metrics))
        .route("/openapi.json", get(openapi::document))
        .route("/v1/maps", get(map::list).post(map::create))
        .route("/v1/maps/{name}", get(map::show).delete(map::delete))
        .route("/v1/maps/{name}/query", axum::routing::post(query::ask))
        .route("/v1/maps/{name}/queries/{query_id}/heatmap", get(answers::heatmap))
        .route("/v1/maps/{name}/queries/{query_id}/points", get(answers::points))
        .route("/v1/maps/{name}/queries/{query_id}/labels", get(segment::labels))
        .route("/v1/maps/{name}/frames", get(map::frames))
        .route("/v1/maps/{name}/trajectory", get(map::trajectory))
        .route("/v1/maps/{name}/render", get(render::of_frame).post(render::of_view))
        .route("/v1/maps/{name}/export/{file}", get(export::file))
        .route("/v1/maps/{name}/events", get(events::stream))
        .method_not_allowed_fallback(method_not_allowed)
        .fallback(not_found)
        .with_state(shared)
        .merge(web::router())
        .layer(CatchPanicLayer::custom(panicked))
        .layer(TraceLayer::new_for_http());
    match cors {
        Some(cors) => router.layer(cors),
        None => router,
    }
}

async fn not_found(uri: axum::http::Uri) -> Problem {
    Problem::not_found(format!(
        "no route {}: GET /openapi.json lists those that there are",
        uri.path()
    ))
}

async fn method_not_allowed(method: Method, uri: axum::http::Uri) -> Problem {
    let detail = format!("{} does not take {method}: see GET /openapi.json", uri.path());
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, detail)
}

/// The log has the panic's message; the client does not.
fn panicked(_panic: Box<dyn Any + Send>) -> Response {
    Problem::internal("a handler panicked: the server's log says where").into_response()
}

/// No origins: browsers let only the server's own pages in.
fn cors(origins: &[String]) -> Option<CorsLayer> {
    if origins.is_empty() {
        return None;
    }
    let allowed = match origins.iter().any(|origin| origin == "*") {
        true => AllowOrigin::any(),
        false => AllowOrigin::list(
            origins.iter().filter_map(|origin| HeaderValue::from_str(origin).ok()),
        ),
    };
    Some(
        CorsLayer::new()
            .allow_origin(allowed)
            .allow_methods([Method::GET, Method::POST, Method::DELETE])
            .allow_headers([header::CONTENT_TYPE, header::ACCEPT, header::RANGE])
            .expose_headers([header::ETAG, header::CONTENT_RANGE]),
    )
}

#[cfg(test)]
mod tests;
