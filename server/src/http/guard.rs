//! Who may use which route: every request passes here before its handler.

use super::error::Problem;
use crate::access::{AccessError, Credentials, Gate, rules};
use crate::net::Peer;
use axum::extract::{MatchedPath, RawPathParams, Request};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use axum::{RequestExt as _, extract};

/// The segment of a path that names a map.
const MAP: &str = "name";

/// Lets a request pass, with its [`Caller`](crate::access::Caller) in its extensions, or refuses it.
pub(super) async fn guard(
    extract::State(gate): extract::State<Gate>,
    mut request: Request,
    next: Next,
) -> Response {
    let Some(path) = request.extensions().get::<MatchedPath>().cloned() else {
        // No route: the answer is 404, whoever asks.
        return next.run(request).await;
    };
    let Some(need) = rules::of_http(request.method().as_str(), path.as_str()) else {
        let detail =
            format!("{} does not take {}: see GET /openapi.json", path.as_str(), request.method());
        let problem = Problem::new(StatusCode::METHOD_NOT_ALLOWED, detail);
        return ([(header::ALLOW, rules::methods(path.as_str()))], problem).into_response();
    };
    let Ok(segments) = request.extract_parts::<RawPathParams>().await else {
        return Problem::bad_request("the path is not UTF-8").into_response();
    };
    let map = segments.iter().find(|(name, _)| *name == MAP).map(|(_, map)| map.to_owned());
    let peer = request.extensions().get::<Peer>().cloned().unwrap_or_default();
    let credentials = Credentials::of_browser(request.headers(), &peer);
    match gate.admit(need, map.as_deref(), credentials) {
        Ok(caller) => {
            if let Some(caller) = caller {
                request.extensions_mut().insert(caller);
            }
            next.run(request).await
        }
        Err(error) => {
            let (method, path) = (request.method(), path.as_str());
            match error {
                // Every visit of the dashboard begins so.
                AccessError::NoToken => {
                    tracing::debug!(%method, path, "nobody said who is calling")
                }
                _ => tracing::info!(%method, path, %error, "a request was refused"),
            }
            refused(&error)
        }
    }
}

/// Status 401 or 403.
pub(super) fn refused(error: &AccessError) -> Response {
    if !error.is_unknown() {
        return Problem::new(StatusCode::FORBIDDEN, error.to_string()).into_response();
    }
    let challenge = match error {
        AccessError::UnknownToken => "Bearer realm=\"lexsplat\", error=\"invalid_token\"",
        _ => "Bearer realm=\"lexsplat\"",
    };
    let challenge = [(header::WWW_AUTHENTICATE, HeaderValue::from_static(challenge))];
    let problem = Problem::new(StatusCode::UNAUTHORIZED, error.to_string());
    (challenge, problem).into_response()
}

impl From<AccessError> for Problem {
    fn from(error: AccessError) -> Self {
        Self::new(StatusCode::FORBIDDEN, error.to_string())
    }
}
