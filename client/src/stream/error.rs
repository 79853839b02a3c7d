//! What can go wrong with a stream: every message says what to do.

use crate::dataset::DatasetError;
use std::error::Error as _;
use tonic::{Code, Status};

/// Why a stream did not get to its end.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The address is none.
    #[error("grpc: expected HOST:PORT, such as 127.0.0.1:50051, found {found:?}")]
    Address {
        /// What was given.
        found: String,
    },
    /// Nobody listens.
    #[error("no server at {address}: start lexsplat-server")]
    NoServer {
        /// Where.
        address: String,
    },
    /// The server answered with an error.
    #[error("the server at {address} refused: {message}")]
    Refused {
        /// Which server.
        address: String,
        /// The kind of error.
        code: Code,
        /// Its own words.
        message: String,
    },
    /// The connection is gone.
    #[error(
        "the connection to {address} broke; when the server is up, the same command goes on from there"
    )]
    Broken {
        /// Which server.
        address: String,
    },
    /// The data set cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// Poses were to be given but there is none.
    #[error(
        "frame {sequence} has no pose: the data set needs poses unless the server estimates them"
    )]
    NoPose {
        /// The frame.
        sequence: u64,
    },
    /// Language was to be given but there is none.
    #[error("{dataset} has no masks: leave out --encoder oracle")]
    NoMasks {
        /// The data set.
        dataset: String,
    },
    /// Reading or rendering panicked.
    #[error("reading frames panicked")]
    Panicked,
}

impl ClientError {
    /// Tells the server's own words from the transport's.
    pub(crate) fn of_status(status: Status, address: &str) -> Self {
        let address = address.to_owned();
        if status.source().is_some() {
            return Self::Broken { address };
        }
        Self::Refused { address, code: status.code(), message: status.message().to_owned() }
    }

    /// The stream ended without an answer to everything.
    pub(crate) fn unanswered(address: &str) -> Self {
        Self::Broken { address: address.to_owned() }
    }
}
