//! `manifest.toml`: the contents of a bundle and how they are used.
//!
//! In: the bundle's folder. Out: a checked [`Manifest`], and the bytes of its files, checked by
//! SHA-256. Unknown keys are refused. No graph is loaded here.

mod error;
mod file;
mod spec;

pub use error::ManifestError;
pub use spec::{ChannelOrder, Fit, GENERIC_SIZE, ImageSpec, RelevancySpec};
pub(super) use spec::{GraphSpec, Manifest, VisionSpec};

use file::ManifestFile;
use sha2::{Digest as _, Sha256};
use std::path::Path;

/// Reads and checks `manifest.toml` in the bundle's folder.
pub(super) fn read(folder: &Path) -> Result<Manifest, ManifestError> {
    let path = folder.join("manifest.toml");
    let text = std::fs::read_to_string(&path).map_err(|reason| ManifestError::Syntax {
        path: path.clone(),
        reason: reason.to_string(),
    })?;
    let file: ManifestFile = toml::from_str(&text)
        .map_err(|reason| ManifestError::Syntax { path, reason: reason.to_string() })?;
    let digest = Sha256::digest(&text).iter().map(|byte| format!("{byte:02x}")).collect();
    file.checked(digest)
}
