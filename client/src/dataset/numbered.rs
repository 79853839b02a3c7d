//! Color and depth of one number, found by their names in a folder.

use super::error::DatasetError;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Extensions of color.
pub(super) const COLOR: &[&str] = &["jpg", "jpeg", "png"];
/// Extensions of depth.
pub(super) const DEPTH: &[&str] = &["png"];

/// Names of pictures: `before`, a number, `between`, a dot and one of `extensions`, in any case.
pub(super) struct Pattern {
    pub before: &'static str,
    pub between: &'static str,
    /// Of two pictures with one number, the one that is named first here is taken.
    pub extensions: &'static [&'static str],
}

/// Pictures found in a folder.
#[derive(Debug, Default)]
pub(super) struct Pairs {
    /// Number, color and depth of each frame, by number.
    pub frames: Vec<(u64, PathBuf, PathBuf)>,
    /// Reasons for pictures that are no part of a frame.
    pub skipped: Vec<String>,
}

/// A picture's name. The best rank is 0; `None` is an extension that is not read.
type Ranked<'a> = (Option<usize>, &'a str);

impl Pattern {
    /// The number in a name, and the rank of its extension.
    fn number(&self, name: &str) -> Option<(u64, Option<usize>)> {
        let name = name.to_ascii_lowercase();
        let rest = name.strip_prefix(self.before)?;
        let digits = &rest[..rest.bytes().take_while(u8::is_ascii_digit).count()];
        let extension = rest[digits.len()..].strip_prefix(self.between)?.strip_prefix('.')?;
        let rank = self.extensions.iter().position(|known| *known == extension);
        // `frame-000000.color.png` is no `frame-000000` with another extension.
        let is_other = rank.is_some() || !extension.contains('.');
        Some((digits.parse().ok().filter(|_| is_other)?, rank))
    }

    fn all<'a>(&self, names: &'a [String]) -> BTreeMap<u64, Ranked<'a>> {
        let mut found: BTreeMap<u64, Ranked<'a>> = BTreeMap::new();
        for name in names {
            let Some((number, rank)) = self.number(name) else { continue };
            let worst = |rank: Option<usize>| rank.unwrap_or(usize::MAX);
            let there = found.entry(number).or_insert((rank, name));
            if worst(rank) < worst(there.0) {
                *there = (rank, name);
            }
        }
        found
    }

    fn name(&self, number: u64) -> String {
        format!("{}{number:06}{}.{}", self.before, self.between, self.extensions.join(" or ."))
    }
}

/// Pairs the pictures of a folder by their numbers. A picture without its other half is left out.
///
/// # Errors
/// [`DatasetError::File`] if the folder cannot be read.
pub(super) fn pairs(
    folder: &Path,
    color: &Pattern,
    depth: &Pattern,
) -> Result<Pairs, DatasetError> {
    let names = names(folder)?;
    let (colors, mut depths) = (color.all(&names), depth.all(&names));
    let mut found = Pairs::default();
    let mut skip = |name: &str, expected: String| {
        let reason = format!("expected {expected} beside it, found none");
        found.skipped.push(DatasetError::content(&folder.join(name), reason).to_string());
    };
    for (number, (rank, name)) in colors {
        match depths.remove(&number) {
            _ if rank.is_none() => skip(name, color.name(number)),
            Some((Some(_), depth)) => {
                found.frames.push((number, folder.join(name), folder.join(depth)));
            }
            _ => skip(name, depth.name(number)),
        }
    }
    depths.iter().for_each(|(number, (_, name))| skip(name, color.name(*number)));
    Ok(found)
}

/// The names in a folder, in order.
fn names(folder: &Path) -> Result<Vec<String>, DatasetError> {
    let failed = |source| DatasetError::File { path: folder.into(), source };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        names.extend(entry.map_err(failed)?.file_name().to_str().map(str::to_owned));
    }
    names.sort();
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: Pattern = Pattern { before: "frame", between: "", extensions: COLOR };
    const BESIDE: Pattern = Pattern { before: "depth", between: "", extensions: DEPTH };

    #[test]
    fn names_in_any_case_are_paired_and_others_told_of() {
        let folder = tempfile::tempdir().unwrap();
        for name in [
            "frame000000.JPG",
            "DEPTH000000.PNG",
            "Frame1.jpeg",
            "depth1.png",
            // Two with one number: JPEG first.
            "frame000002.png",
            "frame000002.jpg",
            "depth000002.png",
            "frame000003.webp",
            "depth000003.png",
            "frame000004.jpg",
            "depth000005.png",
            "depth000004.tiff",
            // No pictures of frames.
            "._frame000000.jpg",
            "frame000000 (1).jpg",
            "frame.jpg",
            "frame000009.color.jpg",
            "notes.txt",
        ] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let found = pairs(folder.path(), &FRAME, &BESIDE).unwrap();
        let name = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
        let frames: Vec<_> =
            found.frames.iter().map(|(n, color, depth)| (*n, name(color), name(depth))).collect();
        let pair = |n, color: &str, depth: &str| (n, color.to_owned(), depth.to_owned());
        assert_eq!(
            frames,
            [
                pair(0, "frame000000.JPG", "DEPTH000000.PNG"),
                pair(1, "Frame1.jpeg", "depth1.png"),
                pair(2, "frame000002.jpg", "depth000002.png")
            ]
        );
        let reasons: Vec<_> = found.skipped.iter().map(|s| s.rsplit('/').next().unwrap()).collect();
        assert_eq!(
            reasons,
            [
                "frame000003.webp: expected frame000003.jpg or .jpeg or .png beside it, found none",
                "frame000004.jpg: expected depth000004.png beside it, found none",
                "depth000005.png: expected frame000005.jpg or .jpeg or .png beside it, found none",
            ]
        );
        assert!(pairs(&folder.path().join("missing"), &FRAME, &BESIDE).is_err());
    }
}
