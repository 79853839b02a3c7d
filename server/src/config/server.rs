//! Addresses, the data directory and the times of the server, section `server`.

use crate::net::TlsConfig;
use crate::pipeline::range::{DAY, OutOfRange, within};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Addresses and the data directory, section `server`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServerConfig {
    /// Address for gRPC; port 0 picks a free port.
    pub grpc: String,
    /// Address for HTTP; port 0 picks a free port.
    pub http: String,
    /// Directory for the recordings of accepted frames; absent: nothing is recorded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub data_dir: Option<PathBuf>,
    /// Time between two checkpoints of a map that changes, seconds; 0: only when the server stops. After a
    /// crash, the frames since the last one are mapped again.
    pub checkpoint_seconds: u64,
    /// How long a request waits for a map that is being loaded, before it is told to come again, seconds.
    pub loading_wait_seconds: u64,
    /// How long open calls may take to finish when the server stops, seconds.
    pub shutdown_seconds: u64,
    /// Certificates for both ports; absent: connections are not encrypted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tls: Option<TlsConfig>,
}

impl Default for ServerConfig {
    fn default() -> Self {
        Self {
            grpc: "127.0.0.1:50051".into(),
            http: "127.0.0.1:8080".into(),
            data_dir: None,
            checkpoint_seconds: 60,
            loading_wait_seconds: 5,
            shutdown_seconds: 30,
            tls: None,
        }
    }
}

/// Ten minutes, seconds.
const LONGEST_WAIT: u64 = 600;

impl ServerConfig {
    /// Checks the range of each number.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub(super) fn check(&self) -> Result<(), OutOfRange> {
        within("server.checkpoint_seconds", self.checkpoint_seconds, 0..=DAY)?;
        within("server.shutdown_seconds", self.shutdown_seconds, 0..=DAY)?;
        within("server.loading_wait_seconds", self.loading_wait_seconds, 0..=LONGEST_WAIT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::range::table::assert_checks;

    #[test]
    fn each_number_of_the_server_is_checked() {
        assert_checks(
            "server",
            ServerConfig::check,
            &[
                (
                    "server.checkpoint_seconds",
                    |c| c.checkpoint_seconds = 86_401,
                    |c| c.checkpoint_seconds = 0,
                ),
                (
                    "server.shutdown_seconds",
                    |c| c.shutdown_seconds = 86_401,
                    |c| c.shutdown_seconds = 0,
                ),
                (
                    "server.loading_wait_seconds",
                    |c| c.loading_wait_seconds = 601,
                    |c| c.loading_wait_seconds = 0,
                ),
            ],
            &[],
        );
    }
}
