//! One file per command of `lexsplat`.

pub mod demo;
pub mod export;
pub mod query;
pub mod stream;
pub mod synth;
mod table;

use anyhow::{Context as _, Result};

/// Runs a command that waits for a server.
pub fn wait(work: impl Future<Output = Result<()>>) -> Result<()> {
    tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .context("cannot start the runtime")?
        .block_on(work)
}
