//! Writing the files of a command, with errors that name them.

use anyhow::{Context as _, Result};
use image::RgbImage;
use std::path::Path;

/// Makes a folder if it is missing.
pub fn make_folder(path: &Path) -> Result<()> {
    std::fs::create_dir_all(path).with_context(|| format!("cannot make {}", path.display()))
}

/// Writes a file.
pub fn save(path: &Path, bytes: impl AsRef<[u8]>) -> Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// Writes an image; the extension says which format.
pub fn save_image(path: &Path, image: &RgbImage) -> Result<()> {
    image.save(path).with_context(|| format!("cannot write {}", path.display()))
}
