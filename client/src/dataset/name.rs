//! Names of data sets: the last part of a path, as a map can be called.

use std::path::Path;

/// Characters of the longest name that a map can have.
const LONGEST: usize = 64;

/// The last part of a path as it was given: a link's own name.
pub(super) fn last_part(folder: &Path) -> Option<String> {
    let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    // `.` and `..` have no name of their own.
    name(folder).or_else(|| name(&folder.canonicalize().ok()?))
}

/// The name of a data set: the folder's, with other characters than a map's name may have replaced.
pub(crate) fn of(folder: &Path) -> String {
    last_part(folder).map_or_else(|| "dataset".into(), |name| valid(&name))
}

/// Whether a map can be called so.
pub(crate) fn is_map_name(text: &str) -> bool {
    !text.is_empty() && valid(text) == text
}

/// A map's name made of any text: 1 to 64 of `A-Z a-z 0-9 . _ -`, and no dot first. Where letters are lost,
/// a number made of the whole text keeps different texts apart.
fn valid(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-');
    let mut name = String::new();
    for character in text.chars() {
        match is_plain(character) {
            true if name.is_empty() && character == '.' => {}
            true => name.push(character),
            false if name.ends_with('_') => {}
            false => name.push('_'),
        }
    }
    let is_lossy = name.len() > LONGEST || !text.is_ascii();
    if !is_lossy && !name.is_empty() {
        return name;
    }
    let suffix = format!("-{:08x}", hash(text));
    name.truncate(LONGEST - suffix.len());
    format!("{}{suffix}", if name.is_empty() { "dataset" } else { &name })
}

/// 32-bit FNV-1a: the same on every machine and in every version.
fn hash(text: &str) -> u32 {
    text.bytes().fold(0x811c_9dc5, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The server's rule.
    fn is_valid(name: &str) -> bool {
        (1..=64).contains(&name.len())
            && !name.starts_with('.')
            && name.bytes().all(|b| b.is_ascii_alphanumeric() || b"._-".contains(&b))
    }

    #[test]
    fn every_text_becomes_a_name() {
        for (text, expected) in [
            ("room0", "room0"),
            ("my room", "my_room"),
            ("room(1)", "room_1_"),
            (".hidden", "hidden"),
        ] {
            assert_eq!(valid(text), expected);
        }
        for text in ["küche", "厨房", "", "...", "a/b", &"a".repeat(70), &"ü".repeat(70)] {
            assert!(is_valid(&valid(text)), "{text}: {}", valid(text));
            // Negative control: it is not one before.
            assert!(!is_valid(text), "{text}");
        }
        assert!(valid("küche").starts_with("k_che-"), "{}", valid("küche"));
        assert_ne!(valid("厨房"), valid("客厅"));
        assert_ne!(valid(&format!("{}1", "a".repeat(70))), valid(&format!("{}2", "a".repeat(70))));
        assert_eq!(hash("a"), 0xe40c_292c, "as published");
    }

    #[test]
    #[cfg(unix)]
    fn a_link_gives_its_own_name() {
        let parent = tempfile::tempdir().unwrap();
        let (disk, link) = (parent.path().join("disk7"), parent.path().join("kitchen"));
        std::fs::create_dir(&disk).unwrap();
        std::os::unix::fs::symlink(&disk, &link).unwrap();
        assert_eq!((of(&link), of(&disk)), ("kitchen".into(), "disk7".into()));
        assert_eq!(of(&disk.join("..").join("kitchen")), "kitchen");
        assert_eq!(of(&disk.join(".")), "disk7");
        assert_eq!(of("/".as_ref()), "dataset");
    }
}
