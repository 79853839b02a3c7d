//! Errors of streams; each message says what to do.

use crate::access::AccessError;
use crate::dataset::DatasetError;
use std::error::Error as _;
use tonic::{Code, Status};

/// A stream that was not finished.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The address cannot be parsed.
    #[error("grpc: expected HOST:PORT, http://HOST:PORT or https://HOST:PORT, found {found:?}")]
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
        /// The address.
        address: String,
        /// What is wrong with the certificate or the connection.
        reason: String,
    },
    /// Nothing listens at the address.
    #[error("no server at {address}: start lexsplat-server")]
    NoServer {
        /// The address, `HOST:PORT`.
        address: String,
    },
    /// The server answered with an error.
    #[error("the server at {address} refused: {message}")]
    Refused {
        /// Address of the server, `HOST:PORT`.
        address: String,
        /// gRPC status code.
        code: Code,
        /// Message of the server.
        message: String,
    },
    /// The connection broke.
    #[error(
        "the connection to {address} broke; when the server is up, the same command goes on from there"
    )]
    Broken {
        /// Address of the server, `HOST:PORT`.
        address: String,
    },
    /// The data set cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A frame has no pose, although poses were to be given.
    #[error(
        "frame {sequence} has no pose: the data set needs poses unless the server estimates them"
    )]
    NoPose {
        /// Number of the frame.
        sequence: u64,
    },
    /// The data set has no masks, although language was to be given.
    #[error("{dataset} has no masks: leave out --encoder oracle")]
    NoMasks {
        /// Name of the data set.
        dataset: String,
    },
    /// The thread that reads or renders frames panicked.
    #[error("reading frames panicked")]
    Panicked,
}

impl ClientError {
    /// Distinguishes an error of the server from one of the connection.
    pub(crate) fn of_status(status: Status, address: &str) -> Self {
        let address = address.to_owned();
        if status.source().is_some() {
            return Self::Broken { address };
        }
        Self::Refused { address, code: status.code(), message: status.message().to_owned() }
    }

    /// The stream ended before every frame was acknowledged.
    pub(crate) fn unanswered(address: &str) -> Self {
        Self::Broken { address: address.to_owned() }
    }
}
