//! What the integration tests share: a server in this process with real listeners, a robot in a synthetic
//! room, and what is true of that room; bundles of networks that are made on the spot; and Python with the
//! libraries of others.

mod authority;
pub mod bundle;
mod fleet;
mod link;
pub mod onnx;
mod outside;
mod process;
mod recording;
mod robot;
mod server;
pub mod wall;

pub use authority::{Authority, Certified};
pub use fleet::{Cluster, Nats, free_port};
pub use link::{Link, Passing};
pub use outside::{python, said};
pub use process::{ServerProcess, Signal, program};
pub use recording::{zipped, zipped_walk};
pub use robot::{Robot, raw};
pub use server::{Server, first_error, tiny_config};

use std::path::{Path, PathBuf};

/// The project's root.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ lies in the root").to_path_buf()
}
