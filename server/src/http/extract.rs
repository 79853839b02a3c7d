//! Reading requests: path segments, query strings, JSON bodies, `Accept`; what does not parse is a
//! [`Problem`].

use super::{Problem, Shared};
use crate::pipeline::map::Map;
use axum::body::Bytes;
use axum::extract::{FromRequest, FromRequestParts, Path, Query, Request};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode, header};
use serde::de::DeserializeOwned;
use std::collections::HashMap;
use std::sync::Arc;

/// What a client accepts when it wants arrays.
pub(super) const NPY: &str = "application/x-npy";

/// The named parts of the path.
pub(super) struct Segments(HashMap<String, String>);

impl Segments {
    /// The part that the route calls `name`.
    pub(super) fn get(&self, name: &str) -> &str {
        self.0.get(name).map(String::as_str).unwrap_or_default()
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Segments {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let path = Path::<HashMap<String, String>>::from_request_parts(parts, state).await;
        path.map(|Path(segments)| Self(segments))
            .map_err(|rejection| Problem::bad_request(rejection.body_text()))
    }
}

/// The map that the path names.
pub(super) struct NamedMap(pub(super) Arc<Map>);

impl FromRequestParts<Arc<Shared>> for NamedMap {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &Arc<Shared>) -> Result<Self, Problem> {
        let segments = Segments::from_request_parts(parts, state).await?;
        Ok(Self(state.engine.map(segments.get("name"))?))
    }
}

/// The query string.
pub(super) struct Options<T>(pub(super) T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Options<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        match Query::<T>::from_request_parts(parts, state).await {
            Ok(Query(options)) => Ok(Self(options)),
            Err(rejection) => {
                let text = rejection.body_text();
                Err(unreadable(text.trim_start_matches("Failed to deserialize query string: ")))
            }
        }
    }
}

/// A JSON body, whatever `Content-Type` says.
pub(super) struct Body<T>(pub(super) T);

impl<T: DeserializeOwned> FromRequest<Arc<Shared>> for Body<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &Arc<Shared>) -> Result<Self, Problem> {
        let limit = state.config.max_body_bytes;
        let body = axum::body::to_bytes(request.into_body(), limit).await.map_err(|_| {
            let detail = format!("the body is longer than {limit} bytes, or broke off");
            Problem::new(StatusCode::PAYLOAD_TOO_LARGE, detail)
        })?;
        json(&body).map(Self)
    }
}

/// Parses JSON; the problem has line, column and field.
pub(super) fn json<T: DeserializeOwned>(body: &Bytes) -> Result<T, Problem> {
    axum::Json::<T>::from_bytes(body).map(|axum::Json(value)| value).map_err(|rejection| {
        let text = rejection.body_text();
        let detail = text
            .trim_start_matches("Failed to deserialize the JSON body into the target type: ")
            .trim_start_matches("Failed to parse the request body as JSON: ");
        unreadable(detail)
    })
}

/// A problem whose field is read from serde's message: "path: what" or "unknown field `name`".
fn unreadable(detail: &str) -> Problem {
    let problem = Problem::bad_request(detail);
    let (path, message) = detail.split_once(": ").unwrap_or(("", detail));
    let is_path =
        !path.is_empty() && path.chars().all(|c| c.is_ascii_alphanumeric() || "_.[]".contains(c));
    let parent = if is_path { path } else { "" };
    let quoted = |lead: &str| {
        let message = if is_path { message } else { detail };
        message.strip_prefix(lead).and_then(|rest| rest.split('`').next()).map(str::to_owned)
    };
    let named = quoted("unknown field `").or_else(|| quoted("missing field `"));
    match (parent, named) {
        ("", None) => problem,
        ("", Some(name)) => problem.at(name),
        (parent, None) => problem.at(parent),
        (parent, Some(name)) if parent == name || parent.ends_with(&format!(".{name}")) => {
            problem.at(parent)
        }
        (parent, Some(name)) => problem.at(format!("{parent}.{name}")),
    }
}

/// Whether the client asks for arrays.
pub(super) fn wants_npy(headers: &HeaderMap) -> bool {
    headers
        .get_all(header::ACCEPT)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .any(|kind| kind.split(';').next().is_some_and(|kind| kind.trim() == NPY))
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;
    use serde::Deserialize;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Inner {
        #[serde(rename = "frame")]
        _frame: u64,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Outer {
        #[serde(rename = "view")]
        _view: Inner,
    }

    fn problem(text: &'static str) -> serde_json::Value {
        let problem = json::<Outer>(&Bytes::from_static(text.as_bytes())).unwrap_err();
        serde_json::to_value(problem).unwrap()
    }

    #[test]
    fn broken_json_names_line_and_column() {
        json::<Outer>(&Bytes::from_static(b"{\"view\": {\"frame\": 3}}")).unwrap();
        let detail = problem("{\"view\":\n {]}")["detail"].to_string();
        assert!(detail.contains("line 2 column 3"), "{detail}");
        assert!(problem("")["detail"].to_string().contains("line 1"));
    }

    #[test]
    fn the_field_at_fault_is_named() {
        assert_eq!(problem("{\"view\": {\"frame\": \"x\"}}")["field"], "view.frame");
        assert_eq!(problem("{\"view\": {\"fram\": 3}}")["field"], "view.fram");
        assert_eq!(problem("{\"vew\": 3}")["field"], "vew");
        assert_eq!(problem("{}")["field"], "view");
        assert_eq!(problem("{\"view\": {}}")["field"], "view.frame");
    }

    #[test]
    fn arrays_are_sent_only_when_asked_for() {
        let with = |accept: &'static str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::ACCEPT, HeaderValue::from_static(accept));
            wants_npy(&headers)
        };
        assert!(with("application/x-npy"));
        assert!(with("image/png;q=0.5, application/x-npy;q=0.9"));
        assert!(!with("image/png"));
        assert!(!with("*/*"));
        assert!(!wants_npy(&HeaderMap::new()));
    }
}
