//! Writing the files of a command, with errors that name them; text from outside for the terminal.

use anyhow::{Context as _, Result};
use image::RgbImage;
use std::path::{Path, PathBuf};

/// Makes a folder if it is missing.
pub fn make_folder(path: &Path) -> Result<()> {
    std::fs::create_dir_all(path).with_context(|| format!("cannot make {}", path.display()))
}

/// Makes a folder for an answer if it is missing, and removes the pictures of an earlier answer from it.
pub fn make_answer_folder(path: &Path) -> Result<()> {
    make_folder(path)?;
    let pictures = [
        "heatmap.png",
        "heatmap.npy",
        "uncertainty.png",
        "labels.png",
        "labels.npy",
        "overlay.png",
    ];
    for file in pictures.map(|name| path.join(name)) {
        if file.exists() {
            std::fs::remove_file(&file)
                .with_context(|| format!("cannot remove {}", file.display()))?;
        }
    }
    Ok(())
}

/// Writes a file.
pub fn save(path: &Path, bytes: impl AsRef<[u8]>) -> Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// Writes to a temporary file beside it first, so that the file is always complete.
pub fn save_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let part = part_of(path);
    std::fs::write(&part, bytes)
        .and_then(|()| std::fs::rename(&part, path))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// The temporary file beside a file that is being written.
pub fn part_of(path: &Path) -> PathBuf {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    part.into()
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

    #[test]
    fn an_answer_has_no_pictures_of_an_earlier_one() {
        let folder = std::env::temp_dir().join(format!("lexsplat-answer-{}", std::process::id()));
        make_answer_folder(&folder).unwrap();
        save(&folder.join("overlay.png"), b"old").unwrap();
        save(&folder.join("mine.png"), b"mine").unwrap();
        make_answer_folder(&folder).unwrap();
        let left: Vec<_> = std::fs::read_dir(&folder).unwrap().collect();
        assert_eq!(left.len(), 1, "only the other's file: {left:?}");
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn files_are_whole_or_absent() {
        let folder = std::env::temp_dir().join(format!("lexsplat-export-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let file = folder.join("map.ply");
        save_whole(&file, b"old").unwrap();
        save_whole(&file, b"new").unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), b"new");
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1, "nothing is left beside it");
        let error = save_whole(&folder.join("no/such/map.ply"), b"").unwrap_err();
        assert!(error.to_string().contains("map.ply"), "{error}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
