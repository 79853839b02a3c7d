//! Writing the files of a command, with errors that name them; text from outside for the terminal.

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

/// Text from outside for a terminal: control characters, but for ends of lines, are shown as they are
/// written in source code.
pub fn plain(text: &str) -> String {
    let shown = |character: char| match character {
        '\n' => "\n".to_owned(),
        control if control.is_control() => control.escape_default().to_string(),
        other => other.to_string(),
    };
    text.chars().map(shown).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_control_character_reaches_the_terminal() {
        assert_eq!(plain("/camera\u{1b}[31m/é\r\n"), "/camera\\u{1b}[31m/é\\r\n");
    }
}
