//! The types that server and clients exchange: the gRPC messages and service of `lexsplat.v1`,
//! generated from `lexsplat/v1/lexsplat.proto`, and the JSON types of HTTP (feature `json`).
//!
//! These types are plain data. The server validates them in its `check` module.

#[cfg(feature = "json")]
pub mod json;

/// Generated messages, client and server.
#[allow(missing_docs, reason = "generated from the .proto, whose comments are the documentation")]
#[allow(clippy::all, reason = "generated code")]
pub mod v1 {
    tonic::include_proto!("lexsplat.v1");
}

/// The encoded file descriptor set, for server reflection.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptors.bin"));
