//! The declared order of modules, and imports that break it.

use crate::imports::Import;
use std::path::{Path, PathBuf};

/// Folders and files of one crate, from the lowest level to the highest. A level may import lower levels
/// only: `"pipeline/query"` stands for that folder or for `pipeline/query.rs`, the longest name counts.
pub type Levels<'a> = [&'a [&'a str]];

/// Level and name of the declared module that a file belongs to.
fn place<'a>(levels: &Levels<'a>, file: &Path) -> Option<(usize, &'a str)> {
    let stem = file.with_extension("");
    let places = levels
        .iter()
        .enumerate()
        .flat_map(|(level, names)| names.iter().map(move |name| (level, *name)));
    places.filter(|(_, name)| stem.starts_with(name)).max_by_key(|(_, name)| name.len())
}

/// What breaks the order: imports of a higher level or of another module of the same level, files that
/// belong to no declared module, and declared modules without a file.
pub fn violations(levels: &Levels<'_>, files: &[PathBuf], imports: &[Import]) -> Vec<String> {
    let mut found = Vec::new();
    for file in files {
        if place(levels, file).is_none() {
            found.push(format!("{} has no place in the declared order", file.display()));
        }
    }
    for name in levels.iter().flat_map(|names| names.iter()) {
        let is_here = |file: &PathBuf| place(levels, file).is_some_and(|(_, found)| found == *name);
        if !files.iter().any(is_here) {
            found.push(format!("the declared order names {name}, which has no file"));
        }
    }
    for import in imports {
        let (from, to) = (&files[import.from], &files[import.to]);
        let (Some((high, above)), Some((low, below))) = (place(levels, from), place(levels, to))
        else {
            continue;
        };
        if low > high || (low == high && above != below) {
            let (from, line, path) = (from.display(), import.line, &import.path);
            found.push(format!("{from}:{line}: {above} must not import {below} ({path})"));
        }
    }
    found
}
