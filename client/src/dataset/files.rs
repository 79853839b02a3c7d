//! Reading the files of data sets, with errors that name them; shared by all layouts.

use super::error::DatasetError;
use super::frame::{Color, ColorFormat, Depth, DepthFormat};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

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

pub(super) fn bytes(path: &Path) -> Result<Vec<u8>, DatasetError> {
    std::fs::read(path).map_err(|source| DatasetError::File { path: path.into(), source })
}

pub(super) fn text(path: &Path) -> Result<String, DatasetError> {
    std::fs::read_to_string(path).map_err(|source| DatasetError::File { path: path.into(), source })
}

/// The files of a folder named `before`, number, one of `after`; by number.
pub(super) fn numbered(
    folder: &Path,
    before: &str,
    after: &[&str],
) -> Result<BTreeMap<u64, PathBuf>, DatasetError> {
    let failed = |source| DatasetError::File { path: folder.into(), source };
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = entry.file_name();
        let Some(rest) = name.to_str().and_then(|name| name.strip_prefix(before)) else { continue };
        let digits = after.iter().find_map(|after| rest.strip_suffix(after));
        if let Some(number) = digits.and_then(|digits| digits.parse().ok()) {
            found.insert(number, entry.path());
        }
    }
    Ok(found)
}

/// The last part of a path: the name of a data set.
pub(super) fn name_of(folder: &Path) -> String {
    let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    whole.file_name().map_or_else(|| "dataset".into(), |name| name.to_string_lossy().into_owned())
}

/// `N` numbers, separated by white space.
pub(super) fn numbers<const N: usize>(line: &str) -> Result<[f64; N], String> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let parsed: Vec<f64> = words
        .iter()
        .map(|word| word.parse().map_err(|_| format!("expected a number, found {word:?}")))
        .collect::<Result<_, _>>()?;
    parsed.try_into().map_err(|_| format!("expected {N} numbers, found {}", words.len()))
}

/// Lines that are neither empty nor comments, with their numbers from 1.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    numbered.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// The size in an image's header.
pub(super) fn size(path: &Path) -> Result<Size, DatasetError> {
    let failed = |source| DatasetError::File { path: path.into(), source };
    let reader = image::ImageReader::open(path).map_err(failed)?;
    let reader = reader.with_guessed_format().map_err(failed)?;
    let (width, height) = reader
        .into_dimensions()
        .map_err(|source| DatasetError::Picture { path: path.into(), source })?;
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

/// A depth image, as it is in the file.
pub(super) fn depth(path: &Path) -> Result<Depth, DatasetError> {
    Ok(Depth { format: DepthFormat::Png16, bytes: bytes(path)? })
}

/// A decoded PNG.
pub(super) fn picture(path: &Path, bytes: &[u8]) -> Result<image::DynamicImage, DatasetError> {
    image::load_from_memory_with_format(bytes, image::ImageFormat::Png)
        .map_err(|source| DatasetError::Picture { path: path.into(), source })
}
