//! What keeps web pages of others from using this server through somebody's browser.
//!
//! A browser sends requests of any page to any address, with the cookies of that address. So the name
//! in `Host` must be one of this server's (a foreign name that was made to point here is DNS
//! rebinding), and a request that changes something must come from this server's own page. Headers on
//! every answer tell the browser what else not to do.

use super::config::ANY;
use super::error::Problem;
use crate::net::Peer;
use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use std::net::IpAddr;
use std::sync::Arc;

/// Answers that are no page load and run nothing.
const POLICY: HeaderValue = HeaderValue::from_static("default-src 'none'; frame-ancestors 'none'");
/// Who connected by TLS once does so for a year.
const A_YEAR: HeaderValue = HeaderValue::from_static("max-age=31536000");

/// The names and origins that are not foreign.
#[derive(Debug, Default)]
pub(super) struct Browsers {
    /// Names that the server is called, besides its addresses and `localhost`.
    pub(super) hosts: Vec<String>,
    /// Origins of other pages that may use the server.
    pub(super) origins: Vec<String>,
    /// Whether answers are for certain callers only, and so are not kept by browsers.
    pub(super) is_private: bool,
}

/// Refuses requests that somebody else's page made; adds headers to every answer.
pub(super) async fn protect(
    State(browsers): State<Arc<Browsers>>,
    request: Request,
    next: Next,
) -> Response {
    let host = host(&request);
    let is_encrypted = request.extensions().get::<Peer>().is_some_and(|peer| peer.is_encrypted);
    let has_name = host.as_ref().is_some_and(|host| !is_own(host.host()));
    let mut answer = match browsers.check(&request, host.as_ref()) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    };
    let strict = (is_encrypted && has_name).then_some((header::STRICT_TRANSPORT_SECURITY, A_YEAR));
    add_headers(answer.headers_mut(), browsers.is_private, strict);
    answer
}

impl Browsers {
    fn check(&self, request: &Request, host: Option<&Authority>) -> Result<(), Problem> {
        let Some(host) = host else {
            // No browser leaves it out.
            return Ok(());
        };
        if !self.is_called(host.host()) {
            let detail = format!(
                "this server is not called {:?}: use its address, or add the name to http.hosts",
                host.host()
            );
            return Err(Problem::new(StatusCode::MISDIRECTED_REQUEST, detail).at("host"));
        }
        let changes = ![Method::GET, Method::HEAD, Method::OPTIONS].contains(request.method());
        let Some(origin) = request.headers().get(header::ORIGIN).filter(|_| changes) else {
            return Ok(());
        };
        match self.is_origin_of(origin.to_str().unwrap_or_default(), host) {
            true => Ok(()),
            false => {
                let detail = format!(
                    "a page of {origin:?} may not use the server, which was called {:?}: let the proxy \
                     between them pass the header Host on, or add the page's origin to http.cors_origins",
                    host.as_str()
                );
                Err(Problem::new(StatusCode::FORBIDDEN, detail).at("origin"))
            }
        }
    }

    fn is_called(&self, host: &str) -> bool {
        let known = |name: &String| name == ANY || name.eq_ignore_ascii_case(host);
        is_own(host) || self.hosts.iter().any(known)
    }

    /// Whether a page of this origin may change something: this server's own, or a configured one.
    fn is_origin_of(&self, origin: &str, host: &Authority) -> bool {
        let own = origin.parse::<Uri>().ok().and_then(|origin| origin.authority().cloned());
        let is_same = own.is_some_and(|own| own.as_str().eq_ignore_ascii_case(host.as_str()));
        is_same || self.origins.iter().any(|known| known == ANY || known == origin)
    }
}

/// `localhost`, or an address: no foreign name can have been made to point here.
fn is_own(host: &str) -> bool {
    let address = host.trim_start_matches('[').trim_end_matches(']');
    host.eq_ignore_ascii_case("localhost") || address.parse::<IpAddr>().is_ok()
}

/// The name and port that the client thinks it talks to.
fn host(request: &Request) -> Option<Authority> {
    let of_uri = request.uri().authority().cloned();
    of_uri.or_else(|| {
        let value = request.headers().get(header::HOST)?;
        // A value that is no name is a foreign name.
        let text = value.to_str().ok().and_then(|text| text.parse().ok());
        Some(text.unwrap_or_else(|| Authority::from_static("invalid")))
    })
}

/// Headers that a handler set itself stay, but for what private answers may be kept.
fn add_headers(
    headers: &mut HeaderMap,
    is_private: bool,
    strict: Option<(HeaderName, HeaderValue)>,
) {
    let is_page = headers.contains_key(header::CONTENT_SECURITY_POLICY);
    if is_private && !is_page {
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    }
    let same_origin = HeaderName::from_static("cross-origin-resource-policy");
    let always = [
        (header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
        (header::REFERRER_POLICY, HeaderValue::from_static("no-referrer")),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (same_origin, HeaderValue::from_static("same-origin")),
    ];
    for (name, value) in always.into_iter().chain(strict) {
        headers.entry(name).or_insert(value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;

    fn browsers() -> Browsers {
        Browsers {
            hosts: vec!["maps.example.org".into()],
            origins: vec!["https://viewer.example.org".into()],
            is_private: false,
        }
    }

    fn refused(method: &str, headers: &[(&str, &str)]) -> Option<u16> {
        let mut request = Request::builder().method(method).uri("/v1/maps");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let request = request.body(Body::empty()).unwrap();
        let host = host(&request);
        browsers().check(&request, host.as_ref()).err().map(|problem| problem.body().status)
    }

    #[test]
    fn foreign_names_are_refused() {
        for own in [
            "127.0.0.1:8080",
            "localhost",
            "LOCALHOST:1",
            "[::1]:8080",
            "192.168.0.7",
            "maps.example.org",
            "Maps.Example.org:443",
        ] {
            assert_eq!(refused("GET", &[("host", own)]), None, "{own}");
        }
        for foreign in [
            "evil.example:8080",
            "localhost.evil.example",
            "127.0.0.1.evil.example",
            "example.org",
            "a b",
            "",
        ] {
            assert_eq!(refused("GET", &[("host", foreign)]), Some(421), "{foreign}");
        }
    }

    #[test]
    fn foreign_pages_change_nothing() {
        let from =
            |method, origin| refused(method, &[("host", "localhost:8080"), ("origin", origin)]);
        for own in ["http://localhost:8080", "https://localhost:8080", "https://viewer.example.org"]
        {
            assert_eq!(from("POST", own), None, "{own}");
        }
        for foreign in [
            "https://evil.example",
            "http://localhost:9090",
            "http://localhost",
            "null",
            "",
            "https://viewer.example.org.evil.example",
            "http://viewer.example.org",
        ] {
            for method in ["POST", "DELETE", "PUT", "PATCH"] {
                assert_eq!(from(method, foreign), Some(403), "{method} {foreign}");
            }
            // It cannot read the answer, since there is no CORS header.
            assert_eq!(from("GET", foreign), None, "{foreign}");
        }
    }
}
