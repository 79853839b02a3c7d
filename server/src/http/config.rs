//! Settings of the HTTP interface, section `http`.

use crate::pipeline::range::{OutOfRange, at_least};
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
    /// Checks the range of each number.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        at_least("http.max_body_bytes", self.max_body_bytes, 1)?;
        at_least("http.max_render_pixels", self.max_render_pixels, 1)?;
        at_least("http.request_seconds", self.request_seconds, 1)?;
        at_least("http.recent_answers", self.recent_answers, 1)?;
        at_least("http.event_backlog", self.event_backlog, 1)
    }
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
                ("http.event_backlog", |c| c.event_backlog = 0, |c| c.event_backlog = 1),
            ],
            &["http.recent_answers_bytes"],
        );
    }
}
