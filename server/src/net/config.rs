//! Settings of connections: sections `server.tls` and `connections`.

use crate::pipeline::range::{DAY, OutOfRange, within};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Certificates, section `server.tls`. Files are PEM, and read again when they change.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TlsConfig {
    /// The server's certificate, followed by the intermediate ones.
    pub certificate: PathBuf,
    /// Its private key.
    pub key: PathBuf,
    /// Certificates of the authorities whose client certificates are believed. A client may show one
    /// in place of a token: it is known by the certificate's DNS names. Absent: clients are not asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub client_ca: Option<PathBuf>,
}

/// Most connections that can be set.
const MAX_CONNECTIONS: usize = 1 << 20;
/// Most requests at a time on one connection that can be set.
const MAX_REQUESTS: u32 = 1 << 16;

/// Limits on connections, section `connections`. They hold for each port by itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ConnectionsConfig {
    /// Largest number of open connections; further ones are closed.
    pub max: usize,
    /// Largest number of requests at a time on one HTTP/2 connection.
    pub max_requests: u32,
    /// How long the TLS handshake, the first request's head, or the head of an HTTP/1 request on a
    /// connection that is kept open may take, seconds.
    pub header_seconds: u64,
    /// How long the body of an HTTP request may take, seconds.
    pub body_seconds: u64,
    /// How long a connection may be silent while no request is open, seconds.
    pub idle_seconds: u64,
    /// How long the other side may take none of what it is sent, seconds.
    pub write_seconds: u64,
    /// Interval of HTTP/2 keep-alive pings, seconds.
    pub keepalive_seconds: u64,
    /// How long the reply to a ping may take before the connection is closed, seconds.
    pub keepalive_timeout_seconds: u64,
}

impl Default for ConnectionsConfig {
    fn default() -> Self {
        Self {
            max: 1024,
            max_requests: 64,
            header_seconds: 30,
            body_seconds: 30,
            idle_seconds: 120,
            write_seconds: 60,
            keepalive_seconds: 20,
            keepalive_timeout_seconds: 20,
        }
    }
}

impl ConnectionsConfig {
    /// Checks the range of each number.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        within("connections.max", self.max, 1..=MAX_CONNECTIONS)?;
        within("connections.max_requests", self.max_requests, 1..=MAX_REQUESTS)?;
        within("connections.header_seconds", self.header_seconds, 1..=DAY)?;
        within("connections.body_seconds", self.body_seconds, 1..=DAY)?;
        within("connections.idle_seconds", self.idle_seconds, 1..=DAY)?;
        within("connections.write_seconds", self.write_seconds, 1..=DAY)?;
        within("connections.keepalive_seconds", self.keepalive_seconds, 1..=DAY)?;
        within("connections.keepalive_timeout_seconds", self.keepalive_timeout_seconds, 1..=DAY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::range::table::assert_checks;

    #[test]
    fn each_number_is_checked() {
        assert_checks(
            "connections",
            ConnectionsConfig::check,
            &[
                ("connections.max", |c| c.max = 0, |c| c.max = 1),
                ("connections.max_requests", |c| c.max_requests = 0, |c| c.max_requests = 1),
                ("connections.header_seconds", |c| c.header_seconds = 0, |c| c.header_seconds = 1),
                ("connections.body_seconds", |c| c.body_seconds = 0, |c| c.body_seconds = 1),
                ("connections.idle_seconds", |c| c.idle_seconds = 0, |c| c.idle_seconds = 1),
                ("connections.write_seconds", |c| c.write_seconds = 0, |c| c.write_seconds = 1),
                (
                    "connections.keepalive_seconds",
                    |c| c.keepalive_seconds = 0,
                    |c| c.keepalive_seconds = 1,
                ),
                (
                    "connections.keepalive_timeout_seconds",
                    |c| c.keepalive_timeout_seconds = 0,
                    |c| c.keepalive_timeout_seconds = 1,
                ),
            ],
            &[],
        );
    }
}
