//! The frame log: all that robots sent and gateways accepted, in order, for each map.
//!
//! It is a JetStream stream with a subject for each map. A frame that is larger than a message is stored in
//! parts. Each message says which one came before it, and JetStream refuses it if another did: so a map has
//! one writer, and a reader sees if a message is missing.

mod reader;
mod record;
mod writer;

pub(super) use reader::{ReadError, Reader};
pub(super) use record::{Entry, Record};
pub(super) use writer::{WriteError, Writer};
