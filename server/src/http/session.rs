//! `/v1/session`: logging a browser in and out.
//!
//! The token becomes a cookie that scripts cannot read and that is sent only with requests of this
//! server's own pages. Images and event streams, which cannot have an `Authorization` header, work with
//! it. The server keeps nothing.

use super::error::Problem;
use super::extract::{Body, BodyLimits};
use super::guard::refused;
use crate::access::{COOKIE, Credentials, Gate};
use crate::net::Peer;
use axum::extract::{FromRef, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use axum::routing::post;
use axum::{Extension, Router};
use lexsplat_proto::json::{self, Login};

#[derive(Clone)]
struct Session {
    gate: Gate,
    limits: BodyLimits,
}

impl FromRef<Session> for BodyLimits {
    fn from_ref(session: &Session) -> Self {
        session.limits
    }
}

/// The route of sessions.
pub(super) fn router<S: Clone + Send + Sync + 'static>(
    gate: Gate,
    limits: BodyLimits,
) -> Router<S> {
    let session = Session { gate, limits };
    Router::new().route("/v1/session", post(log_in).delete(log_out)).with_state(session)
}

/// Logs a browser in: the token becomes a cookie.
#[utoipa::path(
    post, path = "/v1/session", operation_id = "log_in", tag = "session", request_body = Login,
    responses(
        (status = 204, description = "logged in: the cookie is set"),
        (status = 401, description = "the token is not known", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
async fn log_in(
    State(session): State<Session>,
    peer: Option<Extension<Peer>>,
    headers: HeaderMap,
    Body(login): Body<Login>,
) -> Result<Response, Problem> {
    // A proxy may speak TLS in the server's place: then the page's origin tells.
    let origin = headers.get(header::ORIGIN).map(HeaderValue::as_bytes).unwrap_or_default();
    let is_encrypted =
        peer.is_some_and(|Extension(peer)| peer.is_encrypted) || origin.starts_with(b"https://");
    let secure = if is_encrypted { "; Secure" } else { "" };
    match session.gate.identify(Credentials { token: Some(&login.token), names: &[] }) {
        Ok(_) => Ok(cookie(&login.token, secure)),
        Err(error) => Ok(refused(&error)),
    }
}

/// Logs a browser out: the cookie is removed.
#[utoipa::path(
    delete, path = "/v1/session", operation_id = "log_out", tag = "session",
    responses((status = 204, description = "logged out: the cookie is removed")),
)]
async fn log_out() -> Response {
    cookie("", "; Max-Age=0")
}

fn cookie(token: &str, more: &str) -> Response {
    let value = format!("{COOKIE}={token}; Path=/; HttpOnly; SameSite=Strict{more}");
    (StatusCode::NO_CONTENT, [(header::SET_COOKIE, value)]).into_response()
}
