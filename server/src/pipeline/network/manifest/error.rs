//! Errors of a bundle's manifest and files.

use std::path::PathBuf;

/// Why a bundle is refused.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// The manifest cannot be read or parsed.
    #[error("{}: {reason}", path.display())]
    Syntax {
        /// Path of the manifest.
        path: PathBuf,
        /// The parser's message: line, key and known keys.
        reason: String,
    },
    /// A value outside its permitted range.
    #[error("manifest.toml: {key}: expected {expected}, found {found}")]
    Value {
        /// The key.
        key: &'static str,
        /// The permitted values.
        expected: String,
        /// The value in the manifest.
        found: String,
    },
    /// A file of the manifest cannot be read.
    #[error("bundle file {file:?}: cannot be read from {}: {source}", folder.display())]
    File {
        /// File name in the bundle.
        file: String,
        /// The bundle's folder.
        folder: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file has no checksum.
    #[error("manifest.toml: sha256: expected an entry for {file:?}, found none")]
    NoChecksum {
        /// File name in the bundle.
        file: String,
    },
    /// A file's checksum is not the manifest's.
    #[error("bundle file {file:?}: expected sha256 {expected}, found {found}")]
    Checksum {
        /// File name in the bundle.
        file: String,
        /// Checksum in the manifest.
        expected: String,
        /// Checksum of the file.
        found: String,
    },
}
