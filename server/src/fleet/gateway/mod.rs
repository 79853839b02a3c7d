//! A gateway: takes frames and questions, and has no map.
//!
//! Frames go into the log ([`stream`]). All else is asked of the worker that has the map ([`directory`]),
//! over the interfaces that it has anyway ([`service`], [`http`]).

mod directory;
mod http;
mod service;
mod state;
mod stream;

pub(crate) use http::router as http_router;
pub(crate) use service::GatewayService;
pub(crate) use state::Gateway;
