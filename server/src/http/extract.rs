//! Reading requests: path segments, query strings, JSON bodies and `Accept`.

use super::error::Problem;
use super::state::Shared;
use crate::access::client_name;
use crate::pipeline::map::Map;
use crate::pipeline::query::Client;
use axum::extract::{FromRef, FromRequest, FromRequestParts, Path, Request};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode, header};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::collections::HashMap;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

/// The media type of numpy arrays.
pub(super) const NPY: &str = "application/x-npy";

/// The named segments of the path.
pub(crate) struct Segments(HashMap<String, String>);

impl Segments {
    /// The segment that the route calls `name`.
    pub(crate) fn get(&self, name: &str) -> &str {
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
        Ok(Self(state.maps.loaded(segments.get("name")).await?))
    }
}

/// Who asks.
pub(super) struct Asker(pub(super) Client);

impl<S: Send + Sync> FromRequestParts<S> for Asker {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Self, Infallible> {
        Ok(Self(Client::new(&client_name(&parts.extensions))))
    }
}

/// The query string.
pub(crate) struct Options<T>(pub(crate) T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Options<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Self, Problem> {
        let query = form_urlencoded::parse(parts.uri.query().unwrap_or_default().as_bytes());
        let options = serde_path_to_error::deserialize(serde_urlencoded::Deserializer::new(query));
        options.map(Self).map_err(unreadable)
    }
}

/// Limits on the bodies of requests.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BodyLimits {
    /// The longest body, bytes.
    pub(crate) bytes: usize,
    /// How long it may take.
    pub(crate) time: Duration,
}

impl FromRef<Arc<Shared>> for BodyLimits {
    fn from_ref(state: &Arc<Shared>) -> Self {
        Self { bytes: state.config.max_body_bytes, time: state.body_limit }
    }
}

/// A JSON body.
pub(crate) struct Body<T>(pub(crate) T);

impl<T, S> FromRequest<S> for Body<T>
where
    T: DeserializeOwned + Serialize,
    S: Send + Sync,
    BodyLimits: FromRef<S>,
{
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        expect_type(request.headers(), "application/json")?;
        let BodyLimits { bytes: limit, time } = BodyLimits::from_ref(state);
        let body = axum::body::to_bytes(request.into_body(), limit);
        let body = tokio::time::timeout(time, body).await.map_err(|_| {
            let detail = format!("the body was not complete within {time:?}");
            Problem::new(StatusCode::REQUEST_TIMEOUT, detail)
        })?;
        let body = body.map_err(|_| {
            let detail = format!("the body is longer than {limit} bytes or incomplete");
            Problem::new(StatusCode::PAYLOAD_TOO_LARGE, detail)
        })?;
        json(&body).map(Self)
    }
}

/// Checks that a body is of a media type, which no page of another origin can send unasked.
///
/// # Errors
/// A problem with status 415.
pub(super) fn expect_type(headers: &HeaderMap, expected: &str) -> Result<(), Problem> {
    let value = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok());
    let found = value.unwrap_or_default().split(';').next().unwrap_or_default().trim();
    if found.eq_ignore_ascii_case(expected) {
        return Ok(());
    }
    let detail = format!("expected `content-type: {expected}`");
    Err(Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, detail).at("content-type"))
}

/// Parses JSON. The problem has the line, the column and the field.
fn json<T: DeserializeOwned + Serialize>(body: &[u8]) -> Result<T, Problem> {
    let mut deserializer = serde_json::Deserializer::from_slice(body);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(unreadable)?;
    deserializer.end().map_err(|error| Problem::bad_request(error.to_string()))?;
    // serde also takes the fields of an object as a list.
    let given = serde_json::from_slice(body).unwrap_or_default();
    let read = serde_json::to_value(&value).unwrap_or_default();
    match list_for_object(&given, &read) {
        None => Ok(value),
        Some(path) => {
            let problem = Problem::bad_request("expected an object, found a list");
            let field = path.join(".");
            Err(if field.is_empty() { problem } else { problem.at(field) })
        }
    }
}

/// Path of a list that was read as an object; `None` if there is none.
fn list_for_object<'a>(given: &'a Value, read: &Value) -> Option<Vec<&'a str>> {
    match (given, read) {
        (Value::Array(_), Value::Object(_)) => Some(Vec::new()),
        (Value::Object(given), Value::Object(read)) => given.iter().find_map(|(name, given)| {
            let below = list_for_object(given, read.get(name)?)?;
            Some([vec![name.as_str()], below].concat())
        }),
        _ => None,
    }
}

/// A problem with the path of the field that could not be read.
fn unreadable<E: std::error::Error>(error: serde_path_to_error::Error<E>) -> Problem {
    let problem = Problem::bad_request(error.to_string());
    let mut path: Vec<String> = match error.path().iter().len() {
        0 => Vec::new(),
        _ => vec![error.path().to_string()],
    };
    // The path ends at the object that lacks the field; serde names the field in its message only.
    let message = error.inner().to_string();
    let missing = message.strip_prefix("missing field `").and_then(|rest| rest.split('`').next());
    path.extend(missing.map(str::to_owned));
    match path.is_empty() {
        true => problem,
        false => problem.at(path.join(".")),
    }
}

/// Whether the client accepts numpy arrays.
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

    #[derive(Debug, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Inner {
        frame: u64,
    }

    #[derive(Debug, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Outer {
        view: Inner,
    }

    fn problem(text: &'static str) -> serde_json::Value {
        let problem = json::<Outer>(text.as_bytes()).unwrap_err();
        serde_json::to_value(problem.body()).unwrap()
    }

    #[test]
    fn broken_json_names_line_and_column() {
        json::<Outer>(b"{\"view\": {\"frame\": 3}}").unwrap();
        assert!(json::<Outer>(b"{\"view\": {\"frame\": 3}} x").is_err());
        let detail = problem("{\"view\":\n {]}")["detail"].to_string();
        assert!(detail.contains("line 2 column 3"), "{detail}");
        assert!(problem("")["detail"].to_string().contains("line 1"));
    }

    #[test]
    fn the_wrong_field_is_named() {
        assert_eq!(problem("{\"view\": {\"frame\": \"x\"}}")["field"], "view.frame");
        assert_eq!(problem("{\"view\": {\"fram\": 3}}")["field"], "view.fram");
        assert_eq!(problem("{\"vew\": 3}")["field"], "vew");
        assert_eq!(problem("{}")["field"], "view");
        assert_eq!(problem("{\"view\": {}}")["field"], "view.frame");
        assert_eq!(problem("{\"view\": [3]}")["field"], "view");
        assert_eq!(problem("[{\"frame\": 3}]")["detail"], "expected an object, found a list");
    }

    #[test]
    fn arrays_are_sent_only_if_accepted() {
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
