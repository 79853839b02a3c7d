//! Zips from elsewhere.

use super::config::ImportsConfig;
use super::error::ImportError;
use super::room::Room;
use super::spool::Spool;
use super::unpack::{find, open, unpack};
use crate::store::Store;
use lexsplat_client::layout::Layout;
use std::io::{Cursor, Write as _};
use std::path::Path;
use tokio_util::sync::CancellationToken;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

type Zip = ZipWriter<Cursor<Vec<u8>>>;

fn zip(write: impl FnOnce(&mut Zip)) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    write(&mut zip);
    zip.finish().unwrap().into_inner()
}

fn add(zip: &mut Zip, name: &str, bytes: &[u8]) {
    zip.start_file(name, SimpleFileOptions::default()).unwrap();
    zip.write_all(bytes).unwrap();
}

fn unpacked(bytes: &[u8], folder: &Path, limits: ImportsConfig) -> Result<(), String> {
    let file = folder.join("zip");
    std::fs::write(&file, bytes).unwrap();
    let files = folder.join("files");
    let _ = std::fs::remove_dir_all(&files);
    let room = Room { limits, kept_free: 0, stop: CancellationToken::new() };
    let unpacked = open(&file, &room.limits).and_then(|archive| unpack(archive, &files, &room));
    unpacked.map_err(|error| error.to_string())
}

#[test]
fn files_stay_in_their_folder_and_there_are_no_links() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |bytes: Vec<u8>, expected: &str| {
        let error = unpacked(&bytes, folder.path(), ImportsConfig::default()).unwrap_err();
        assert!(error.contains(expected), "{error}");
        let names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().flatten().collect();
        assert_eq!(names.len(), 2, "the zip and its folder: {names:?}");
    };
    refused(zip(|zip| add(zip, "../escape", b"x")), "a path that leaves it");
    refused(zip(|zip| add(zip, "a/../../escape", b"x")), "a path that leaves it");
    let options = SimpleFileOptions::default();
    let link = zip(|zip| zip.add_symlink("link", "/etc/passwd", options).unwrap());
    refused(link, "found a link");
    let in_the_way = zip(|zip| {
        add(zip, "a", b"a file");
        add(zip, "a/b", b"in a folder of the same name");
    });
    refused(in_the_way, "a/b");
    let damaged = zip(|zip| add(zip, "a", &[b'x'; 100]));
    let at = damaged.len() / 3;
    let mut flipped = damaged.clone();
    flipped[at] ^= 0xff;
    assert!(unpacked(&flipped, folder.path(), ImportsConfig::default()).is_err());
    // Control: the same, whole.
    unpacked(&damaged, folder.path(), ImportsConfig::default()).unwrap();
    assert_eq!(std::fs::read(folder.path().join("files/a")).unwrap(), [b'x'; 100]);
}

#[test]
fn limits_hold_for_what_is_unpacked() {
    let folder = tempfile::tempdir().unwrap();
    let two = zip(|zip| {
        add(zip, "a", &[0; 60]);
        add(zip, "b", &[0; 40]);
    });
    let limits = |max_bytes, max_files| ImportsConfig { max_bytes, max_files, at_once: 1 };
    unpacked(&two, folder.path(), limits(100, 2)).unwrap();
    let large = unpacked(&two, folder.path(), limits(99, 2)).unwrap_err();
    assert!(large.contains("imports.max_bytes"), "{large}");
    let many = unpacked(&two, folder.path(), limits(100, 1)).unwrap_err();
    assert!(many.contains("imports.max_files"), "{many}");
    let received = |kept_free, stop: &CancellationToken| {
        let spool = Spool::new(&Store::default(), &limits(1000, 2), kept_free, stop.clone());
        spool.unwrap().receive(&two[..]).err()
    };
    let stop = CancellationToken::new();
    let refused = received(u64::MAX, &stop);
    assert!(matches!(refused, Some(ImportError::NoRoom { .. })), "{refused:?}");
    let refused = received(0, &stop);
    assert!(matches!(refused, Some(ImportError::Refused(_))), "no recording: {refused:?}");
    stop.cancel();
    let refused = received(0, &stop);
    assert!(matches!(refused, Some(ImportError::Stopped)), "{refused:?}");
}

#[test]
fn a_list_of_files_that_would_fill_the_memory_is_not_read_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("zip");
    // 3 MB of names.
    let names = || (0..50).map(|at| format!("{at}{}", "x".repeat(60_000)));
    std::fs::write(&file, zip(|zip| names().for_each(|name| add(zip, &name, b"")))).unwrap();
    let opened = |max_files| {
        let limits = ImportsConfig { max_files, ..ImportsConfig::default() };
        open(&file, &limits).map(|archive| archive.len()).map_err(|error| error.to_string())
    };
    let refused = opened(50).unwrap_err();
    assert!(refused.contains("imports.max_files"), "{refused}");
    assert_eq!(opened(20_000), Ok(50), "control");
}

#[test]
fn the_one_recording_in_a_zip_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let found = |names: &[&str]| {
        let bytes = zip(|zip| names.iter().for_each(|name| add(zip, name, b"")));
        unpacked(&bytes, folder.path(), ImportsConfig::default()).unwrap();
        let files = folder.path().join("files");
        find(&files).map(|(layout, path)| {
            (layout, path.strip_prefix(&files).unwrap().display().to_string())
        })
    };
    let is = |layout: Layout, path: &str| Ok((layout, path.to_owned()));
    assert_eq!(found(&["rgb.txt"]), is(Layout::Tum, ""));
    assert_eq!(found(&["desk/rgb.txt", "__MACOSX/desk/rgb.txt"]), is(Layout::Tum, "desk"));
    assert_eq!(
        found(&["Replica/room0/results/frame000000.jpg"]),
        is(Layout::Replica, "Replica/room0")
    );
    assert_eq!(found(&["a/walk.r3d", "a/notes.txt"]), is(Layout::R3d, "a/walk.r3d"));
    assert!(found(&["a/rgb.txt", "b/rgb.txt"]).unwrap_err().contains("found 2"));
    assert!(found(&["a/b/c/d/e/f/rgb.txt"]).unwrap_err().contains("found none"), "too deep");
}
