//! What is around the routes of every server: the dashboard, sessions, who may use what, and what pages of
//! others may not do.

use super::browser::{Browsers, protect};
use super::config::{ANY, HttpConfig};
use super::error::Problem;
use super::extract::BodyLimits;
use super::guard::guard;
use super::session;
use crate::access::Gate;
use crate::web;
use axum::Router;
use axum::http::{HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse as _, Response};
use std::any::Any;
use std::sync::Arc;
use std::time::Duration;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::classify::ServerErrorsFailureClass;
use tower_http::cors::{AllowOrigin, CorsLayer};
use tower_http::trace::TraceLayer;

/// What the shell needs.
pub(crate) struct Shell {
    /// Who may use which route.
    pub(crate) gate: Gate,
    pub(crate) config: HttpConfig,
    /// How long a request's body may take.
    pub(crate) body_limit: Duration,
}

/// Puts the shell around the routes of a server.
pub(crate) fn shell(routes: Router, shell: Shell) -> Router {
    let Shell { gate, config, body_limit } = shell;
    let cors = cors(&config.cors_origins);
    let browsers = Arc::new(Browsers {
        hosts: config.hosts.clone(),
        origins: config.cors_origins.clone(),
        is_private: gate.asks(),
    });
    let limits = BodyLimits { bytes: config.max_body_bytes, time: body_limit };
    let router = routes
        .merge(session::router(gate.clone(), limits))
        .fallback(not_found)
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
