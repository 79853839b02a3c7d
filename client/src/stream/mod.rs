//! **Streaming** RGB-D frames to a server over gRPC.
//!
//! [`stream()`] sends a whole data set and resumes where the map is. [`FrameStream`] is for frames
//! that are taken while they are sent.

mod connect;
mod connection;
mod error;
mod options;
mod producer;
mod summary;
mod upload;
mod wire;

#[cfg(test)]
mod tests;

pub use connect::Connection;
pub use connection::{Acks, FrameSender, FrameStream, MapSpec, find};
pub use error::ClientError;
pub use lexsplat_proto::v1::{FrameAck, FrameStatus};
pub use options::{Encoder, Poses, StreamOptions};
pub use summary::{InputWarning, LeftOut, Progress, Refusal, Summary};
pub use upload::{stream, stream_over};
