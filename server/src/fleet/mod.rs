//! Many robots and maps on several machines: gateways take frames and questions, workers have the maps, and
//! NATS JetStream keeps what must not be lost.
//!
//! A frame's way: gateway ([`gateway`]) → frame log ([`log`]) → the worker that has the map's lease
//! ([`worker`], [`pump`]) → acknowledgement ([`acks`]) → gateway → robot. A frame is durable when the log has
//! it. A map is what its newest checkpoint ([`checkpoints`]) and the log behind that say, so any worker can
//! go on with it.
//!
//! A question goes to the map's owner, or, if it may be older, to any worker ([`copies`]).
//!
//! A lease ([`leases`]) says which worker has a map. Its fencing token grows with each owner. Checkpoints and
//! acknowledgements carry it, so those of a worker that lost the map, and does not know it, count for
//! nothing.

mod acks;
mod bus;
mod checkpoints;
mod config;
mod copies;
mod follow;
mod gateway;
mod leases;
mod log;
mod pump;
mod registry;
mod saver;
mod worker;

pub(crate) use acks::MOST_UNREAD;
pub(crate) use bus::Bus;
pub use bus::BusError;
pub use config::{FleetConfig, Role, Trim};
pub(crate) use gateway::{Gateway, GatewayService, http_router};
pub(crate) use worker::Worker;
