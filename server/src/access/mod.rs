//! Who is calling, and what they may do.
//!
//! A caller is known by a bearer token. An entry of the tokens file names a caller, their scopes, the
//! maps that they may use, and the hash of their token; the token itself is nowhere on the server.
//! `Gate` holds the entries and follows the file. `rules` is the one table of what each HTTP route
//! and gRPC call asks of its caller.
//!
//! Without entries nobody is asked, and [`exposed`] refuses to listen where others can connect.

mod caller;
mod config;
mod credentials;
mod entries;
mod entry;
mod exposure;
mod gate;
mod issue;
pub(crate) mod rules;
mod scope;
mod token;

pub(crate) use caller::{AccessError, Caller, client_name};
pub use config::{AccessConfig, Public};
pub(crate) use credentials::{COOKIE, Credentials};
pub use entries::EntriesError;
pub(crate) use exposure::is_own_machine;
pub use exposure::{Exposed, exposed};
pub(crate) use gate::Gate;
pub use issue::{IssueError, issue};
pub use scope::Scope;
