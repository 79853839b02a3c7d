//! Errors of the HTTP interface; each message is one line.

use crate::access::AccessError;
use lexsplat_proto::json::Problem;

/// A request that got no usable answer.
#[derive(Debug, thiserror::Error)]
pub enum HttpError {
    /// The address cannot be parsed.
    #[error(
        "http address: expected HOST:PORT, http://HOST:PORT or https://HOST:PORT, found {found:?}"
    )]
    Address {
        /// The text that was given.
        found: String,
    },
    /// The token or the certificates cannot be used.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// Something listens there, but no encrypted connection came about.
    #[error(
        "no encrypted connection to {address}: {reason}. A server speaks TLS if it has [server.tls]; --ca names its authority"
    )]
    Tls {
        /// The address, `HOST:PORT`.
        address: String,
        /// What is wrong with the certificate or the connection.
        reason: String,
    },
    /// Nothing listens at the address.
    #[error("no server at {address}: start lexsplat-server, or name another one with --http")]
    NoServer {
        /// The address, `HOST:PORT`.
        address: String,
    },
    /// The server answered with an error status.
    #[error("{detail}")]
    Refused {
        /// HTTP status code.
        status: u16,
        /// The server's message: what was expected and what was found.
        detail: String,
    },
    /// The map has failed and takes no more frames.
    #[error("the map failed: {reason}")]
    MapFailed {
        /// The reason in the map's status.
        reason: String,
    },
    /// The map stopped making progress before it was settled.
    #[error("the map has not changed for {seconds} s and is not settled")]
    Stalled {
        /// Seconds without a new revision.
        seconds: u64,
    },
    /// The connection broke, or the answer is malformed.
    #[error("the connection to {address} broke or its answer is malformed: {reason}")]
    Broken {
        /// The server's address.
        address: String,
        /// What is wrong.
        reason: String,
    },
}

/// Whether a refusal says that the map is being loaded.
pub(super) fn is_loading(body: &[u8]) -> bool {
    serde_json::from_slice::<Problem>(body).is_ok_and(|problem| problem.progress.is_some())
}

/// The message of a refusal, on one line.
pub(super) fn detail(body: &[u8], status: &str) -> String {
    match serde_json::from_slice::<Problem>(body) {
        Ok(problem) => problem.detail.replace('\n', " "),
        Err(_) => format!("the server answered with status {status} and no reason"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refusals_are_one_line() {
        let body = br#"{"title":"Bad Request","status":400,"detail":"no map\n\"x\""}"#;
        assert_eq!(detail(body, "400"), "no map \"x\"");
        assert!(detail(b"<html>", "502").contains("502"));
    }
}
