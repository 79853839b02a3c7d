//! `lexsplat.v1`: the wire messages and the `Mapping` service, generated from
//! `lexsplat/v1/lexsplat.proto`. Units are in the field names. Nothing here checks anything: the
//! server's `ingest` does.

/// Generated messages, client and server.
#[allow(missing_docs, reason = "generated from the .proto, whose comments are the documentation")]
#[allow(clippy::all, reason = "generated code")]
pub mod v1 {
    tonic::include_proto!("lexsplat.v1");
}

/// The encoded file descriptor set, for server reflection.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptors.bin"));
