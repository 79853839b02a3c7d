//! A recording in a zip, as a browser uploads it.

use lexsplat_synthetic::{Camera, Plan, write};
use std::io::Write as _;
use std::path::Path;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// A walk through the room of a seed in Replica layout, in the folder `walk`.
pub fn zipped_walk(seed: u64, frames: usize) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let camera = Camera::new(160, 120);
    let plan = Plan { seed, frames, every: 1, camera };
    write(&folder.path().join("walk"), &plan, |_| {}).expect("it can be written");
    let mut files = Vec::new();
    list(folder.path(), folder.path(), &mut files);
    zipped(files.iter().map(|(name, bytes)| (name.as_str(), &bytes[..])))
}

/// A zip of files by their names.
pub fn zipped<'a>(files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> Vec<u8> {
    let mut zip = ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, bytes) in files {
        zip.start_file(name, SimpleFileOptions::default()).expect("the name can be written");
        zip.write_all(bytes).expect("it fits into memory");
    }
    zip.finish().expect("it fits into memory").into_inner()
}

/// The files below a folder, by their names below `top`.
fn list(top: &Path, folder: &Path, files: &mut Vec<(String, Vec<u8>)>) {
    for entry in std::fs::read_dir(folder).expect("it can be listed") {
        let path = entry.expect("it can be read").path();
        if path.is_dir() {
            list(top, &path, files);
        } else {
            let name = path.strip_prefix(top).expect("it is below").display().to_string();
            files.push((name, std::fs::read(&path).expect("it can be read")));
        }
    }
}
