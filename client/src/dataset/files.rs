//! Reading the files of data sets, with errors that name them; shared by all layouts.

use super::error::DatasetError;
use super::frame::{Color, ColorFormat};
use super::text;
use std::fmt;
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::Path;

/// Columns and rows of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Size {
    pub width: u32,
    pub height: u32,
}

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// Longer lists and pictures are not read, bytes: they would fill the memory.
const LONGEST: u64 = 512 << 20;

pub(super) fn bytes(path: &Path) -> Result<Vec<u8>, DatasetError> {
    let failed = |source| DatasetError::File { path: path.into(), source };
    let found = std::fs::metadata(path).map_err(failed)?.len();
    if found > LONGEST {
        let reason = format!("expected at most {LONGEST} bytes, found {found}");
        return Err(DatasetError::content(path, reason));
    }
    std::fs::read(path).map_err(failed)
}

/// The text of a file, in any usual encoding.
pub(super) fn text(path: &Path) -> Result<String, DatasetError> {
    Ok(text::decoded(&bytes(path)?))
}

/// The content of a JSON file.
pub(super) fn json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, DatasetError> {
    serde_json::from_str(&text(path)?)
        .map_err(|error| DatasetError::content(path, error.to_string()))
}

/// The size in an image's header.
pub(super) fn size(path: &Path) -> Result<Size, DatasetError> {
    let failed = |source| DatasetError::File { path: path.into(), source };
    let file = BufReader::new(File::open(path).map_err(failed)?);
    size_of(file).map_err(|source| DatasetError::Picture { path: path.into(), source })
}

/// The size in the header of an image in memory.
pub(super) fn encoded_size(bytes: &[u8]) -> Result<Size, String> {
    let size = size_of(Cursor::new(bytes));
    size.map_err(|error| format!("expected a picture that can be decoded: {error}"))
}

fn size_of(source: impl BufRead + Seek) -> Result<Size, image::ImageError> {
    let reader = image::ImageReader::new(source).with_guessed_format()?;
    let (width, height) = reader.into_dimensions()?;
    Ok(Size { width, height })
}

/// Refuses an image of another size.
pub(super) fn check_size(path: &Path, expected: Size) -> Result<(), DatasetError> {
    let found = size(path)?;
    if found == expected {
        return Ok(());
    }
    Err(DatasetError::content(path, format!("expected {expected} pixels, found {found}")))
}

/// A color image, as it is in the file.
pub(super) fn color(path: &Path) -> Result<Color, DatasetError> {
    const PNG_MAGIC: &[u8] = b"\x89PNG";
    const JPEG_MAGIC: &[u8] = b"\xff\xd8";
    let bytes = bytes(path)?;
    let format = match &bytes[..] {
        b if b.starts_with(PNG_MAGIC) => ColorFormat::Png,
        b if b.starts_with(JPEG_MAGIC) => ColorFormat::Jpeg,
        _ => return Err(DatasetError::content(path, "expected a JPEG or PNG picture")),
    };
    Ok(Color { format, bytes })
}

/// A decoded PNG.
pub(super) fn picture(path: &Path, bytes: &[u8]) -> Result<image::DynamicImage, DatasetError> {
    image::load_from_memory_with_format(bytes, image::ImageFormat::Png)
        .map_err(|source| DatasetError::Picture { path: path.into(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_would_fill_the_memory_is_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rgb.txt");
        // Its bytes are not on the disk.
        File::create(&path).unwrap().set_len(LONGEST + 1).unwrap();
        let refused = text(&path).unwrap_err().to_string();
        assert!(refused.contains("rgb.txt") && refused.contains("at most"), "{refused}");
        File::create(&path).unwrap().set_len(3).unwrap();
        assert_eq!(bytes(&path).unwrap(), [0; 3]);
    }
}
