//! Settings of the HTTP interface, section `http`.

use crate::pipeline::range::{DAY, MAX_BYTES, MAX_KEPT, MAX_PIXELS, OutOfRange, require, within};
use axum::http::Uri;
use axum::http::uri::{Authority, PathAndQuery};
use serde::{Deserialize, Serialize};

/// Limits on requests, and on the answers and events kept for clients.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HttpConfig {
    /// The longest request body, bytes.
    pub max_body_bytes: usize,
    /// The largest image that can be rendered, pixels.
    pub max_render_pixels: u64,
    /// How long a query or a rendered image may take, seconds.
    pub request_seconds: u64,
    /// Number of answers to keep, so that their heat maps, labels and points can be fetched.
    pub recent_answers: usize,
    /// Memory that the kept answers may use together, bytes.
    pub recent_answers_bytes: usize,
    /// Number of events of a map to keep for clients that reconnect.
    pub event_backlog: usize,
    /// Origins (CORS) of web pages that may use this server; "*" allows any. The dashboard needs
    /// none.
    pub cors_origins: Vec<String>,
    /// Names that the server is called in addresses, besides `localhost` and IP addresses; "*" allows
    /// any. Requests to other names are refused.
    pub hosts: Vec<String>,
}

impl Default for HttpConfig {
    fn default() -> Self {
        Self {
            max_body_bytes: 64 << 10,
            max_render_pixels: 4 << 20,
            request_seconds: 60,
            recent_answers: 64,
            recent_answers_bytes: 256 << 20,
            event_backlog: 512,
            cors_origins: Vec::new(),
            hosts: Vec::new(),
        }
    }
}

impl HttpConfig {
    /// Checks the range of each number, and that names and origins can be such.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        within("http.max_body_bytes", self.max_body_bytes, 1..=MAX_BYTES)?;
        within("http.max_render_pixels", self.max_render_pixels, 1..=MAX_PIXELS)?;
        within("http.request_seconds", self.request_seconds, 1..=DAY)?;
        within("http.recent_answers", self.recent_answers, 1..=MAX_KEPT)?;
        within("http.recent_answers_bytes", self.recent_answers_bytes, 0..=MAX_BYTES)?;
        within("http.event_backlog", self.event_backlog, 1..=MAX_KEPT)?;
        for origin in &self.cors_origins {
            let expected =
                "origins as browsers send them, such as \"https://robot.example:8080\", or \"*\"";
            require(is_origin(origin), "http.cors_origins", format!("{origin:?}"), expected)?;
        }
        for host in &self.hosts {
            let expected = "names without scheme and port, such as \"robot.example\", or \"*\"";
            require(is_host(host), "http.hosts", format!("{host:?}"), expected)?;
        }
        Ok(())
    }
}

/// Any host or origin.
pub(super) const ANY: &str = "*";

/// Scheme, name, and a port unless it is the usual one.
fn is_origin(text: &str) -> bool {
    let Ok(uri) = text.parse::<Uri>() else { return false };
    let has_path = !matches!(uri.path_and_query().map(PathAndQuery::as_str), None | Some("/"));
    let is_plain =
        uri.scheme().is_some() && !has_path && !text.ends_with('/') && !text.contains('@');
    text == ANY || is_plain
}

fn is_host(text: &str) -> bool {
    let is_alone = |name: Authority| name.host() == text && !text.starts_with('[');
    text == ANY || text.parse().is_ok_and(is_alone)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::range::table::assert_checks;

    #[test]
    fn each_number_is_checked() {
        assert_checks(
            "http",
            HttpConfig::check,
            &[
                ("http.max_body_bytes", |c| c.max_body_bytes = 0, |c| c.max_body_bytes = 1),
                (
                    "http.max_render_pixels",
                    |c| c.max_render_pixels = 0,
                    |c| c.max_render_pixels = 1,
                ),
                ("http.request_seconds", |c| c.request_seconds = 0, |c| c.request_seconds = 1),
                ("http.recent_answers", |c| c.recent_answers = 0, |c| c.recent_answers = 1),
                (
                    "http.recent_answers_bytes",
                    |c| c.recent_answers_bytes = usize::MAX,
                    |c| c.recent_answers_bytes = 0,
                ),
                ("http.event_backlog", |c| c.event_backlog = 0, |c| c.event_backlog = 1),
            ],
            &[],
        );
    }

    #[test]
    fn names_and_origins_that_no_browser_sends_are_refused() {
        let check = |hosts: &[&str], origins: &[&str]| {
            let owned = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect();
            HttpConfig {
                hosts: owned(hosts),
                cors_origins: owned(origins),
                ..HttpConfig::default()
            }
            .check()
        };
        assert_eq!(check(&["*", "robot.example", "robot"], &["*"]), Ok(()));
        assert_eq!(check(&[], &["https://robot.example:8080", "http://[::1]"]), Ok(()));
        for wrong in ["", "https://robot.example", "robot:8080", "a b", "robot/x", "\n", "ö"] {
            assert_eq!(check(&[wrong], &[]).unwrap_err().key, "http.hosts", "{wrong}");
        }
        for wrong in ["", "robot.example", "https://robot.example/", "https://a/b", "null", "a b"] {
            assert_eq!(check(&[], &[wrong]).unwrap_err().key, "http.cors_origins", "{wrong}");
        }
    }
}
