//! The load to put on a server, and the errors of doing so.

use lexsplat_client::Access;
use lexsplat_client::http::HttpError;
use lexsplat_client::stream::ClientError;

/// The load: robots that send frames, and queries, both at constant rates.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The server's gRPC address.
    pub grpc: String,
    /// The server's HTTP address.
    pub http: String,
    /// Token and certificates.
    pub access: Access,
    /// Prefix of the maps' names.
    pub prefix: String,
    /// Frames per second of each robot.
    pub frames_per_second: f64,
    /// Queries per second, over all maps; 0: none.
    pub queries_per_second: f64,
    /// Seconds of load, from the time that the first frame is due.
    pub seconds: f64,
    /// Query texts, used in turn: each once about a view, then about the whole map.
    pub texts: Vec<String>,
}

/// A load test that could not be finished.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A robot's stream failed.
    #[error(transparent)]
    Stream(#[from] ClientError),
    /// A request failed that is not one of the counted queries.
    #[error(transparent)]
    Http(#[from] HttpError),
    /// A task panicked: a bug.
    #[error("a task of the bench panicked")]
    Panicked,
}
