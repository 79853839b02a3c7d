//! Options that say who is calling and which servers are trusted.

use anyhow::{Context as _, Result};
use lexsplat_client::{Access, Identity};
use std::path::{Path, PathBuf};

/// Token and certificates.
#[derive(Clone, clap::Args)]
pub struct AccessOptions {
    /// The token that `lexsplat-server token` printed; in the environment no list of processes shows it
    #[arg(
        long,
        global = true,
        value_name = "TOKEN",
        env = "LEXSPLAT_TOKEN",
        hide_env_values = true
    )]
    token: Option<String>,
    /// Certificates (PEM) of the authorities to trust for https:// instead of the system's
    #[arg(long, global = true, value_name = "FILE", env = "LEXSPLAT_CA")]
    ca: Option<PathBuf>,
    /// Client certificate (PEM), for servers that ask for one
    #[arg(long, global = true, value_name = "FILE", requires = "client_key")]
    client_certificate: Option<PathBuf>,
    /// Its private key (PEM)
    #[arg(long, global = true, value_name = "FILE", requires = "client_certificate")]
    client_key: Option<PathBuf>,
}

impl AccessOptions {
    /// Reads the files.
    ///
    /// # Errors
    /// If one cannot be read.
    pub fn read(&self) -> Result<Access> {
        let authorities = self.ca.as_deref().map(read).transpose()?;
        let identity = match (&self.client_certificate, &self.client_key) {
            (Some(certificate), Some(key)) => {
                Some(Identity { certificate: read(certificate)?, key: read(key)? })
            }
            _ => None,
        };
        Ok(Access { token: self.token.clone(), authorities, identity })
    }
}

fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))
}
