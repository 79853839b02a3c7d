//! The listeners: connections, their limits, and TLS.
//!
//! [`serve`] accepts the connections of one port and answers their requests with a router. gRPC and
//! HTTP differ only in their [`Protocol`]. It knows no callers: it tells the router who is at the other
//! end of a connection ([`Peer`]).

mod config;
mod descriptors;
mod peer;
mod serve;
mod tls;
mod watched;

pub use config::{ConnectionsConfig, TlsConfig};
pub(crate) use descriptors::raise_limit;
pub(crate) use peer::Peer;
pub(crate) use serve::{Port, Protocol, serve};
pub(crate) use tls::Tls;
pub use tls::TlsError;
