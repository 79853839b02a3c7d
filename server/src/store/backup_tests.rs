//! Backups that are not what they should be, and data directories without room for one.

use super::*;
use sha2::{Digest as _, Sha256};
use std::io::Cursor;

const END: &str = "end-of-backup";
const RECORDING: &str = "0001.mcap";
const CHECKPOINT: &str = "checkpoint-0001.lexsplat";

/// Names and contents of the files in a tar.
type Files = Vec<(String, Vec<u8>)>;

/// A backup of a map with frames and a checkpoint.
async fn backup() -> Files {
    let data = tempfile::tempdir().unwrap();
    let store = Store::open(Some(data.path()), &RecordingConfig::default()).unwrap();
    let camera = v1::Intrinsics { width: 4, height: 2, fx: 3.0, fy: 3.0, cx: 1.5, cy: 0.5 };
    let open = v1::OpenMap {
        map: "kitchen".into(),
        intrinsics: Some(camera),
        depth_unit_metres: 0.001,
        ..Default::default()
    };
    let recorder = store.record(&open).await.unwrap().unwrap();
    for sequence in 0..5 {
        let color = vec![sequence as u8; 3000].into();
        recorder.append(v1::Frame { sequence, color, ..Default::default() }).await.unwrap();
    }
    recorder.finish().await;
    let label = Label { map: open.map, fingerprint: "f".into(), through: 4, frames: 5 };
    store.save(&label, |out| out.write_all(b"a state")).unwrap();
    let mut tar = Vec::new();
    store.backup("kitchen").unwrap().unwrap().write(&mut tar).unwrap();
    let mut archive = tar::Archive::new(Cursor::new(tar));
    let entries = archive.entries().unwrap().map(|entry| {
        let mut entry = entry.unwrap();
        let mut contents = Vec::new();
        entry.read_to_end(&mut contents).unwrap();
        (entry.path().unwrap().display().to_string(), contents)
    });
    entries.collect()
}

fn tar_of(files: &Files) -> Vec<u8> {
    let mut tar = tar::Builder::new(Vec::new());
    for (name, contents) in files {
        let mut header = tar::Header::new_gnu();
        header.set_size(contents.len() as u64);
        tar.append_data(&mut header, name, &contents[..]).unwrap();
    }
    tar.into_inner().unwrap()
}

/// Makes the list of checksums fit the files, as an attacker could.
fn sign(files: &mut Files) {
    let lines = files.iter().filter(|(name, _)| name != END).map(|(name, contents)| {
        let hash = Sha256::digest(contents);
        let hex: String = hash.iter().map(|byte| format!("{byte:02x}")).collect();
        format!("{hex}  {name}\n")
    });
    let list: String = lines.collect();
    file(files, END).splice(.., list.into_bytes());
}

fn file<'a>(files: &'a mut Files, name: &str) -> &'a mut Vec<u8> {
    &mut files.iter_mut().find(|(found, _)| found == name).unwrap().1
}

/// Restores into a new directory with this quota; nothing may be left after a refusal.
fn restore(files: &Files, max_bytes: u64) -> Result<Unpacked, BackupFault> {
    let data = tempfile::tempdir().unwrap();
    let limits = RecordingConfig { max_bytes, ..RecordingConfig::default() };
    let store = Store::open(Some(data.path()), &limits).unwrap();
    let restored = store.restore("copy", Cursor::new(tar_of(files)));
    assert_eq!(store.has("copy"), restored.is_ok());
    let left = std::fs::read_dir(data.path()).unwrap().count();
    assert_eq!(left, 1 + usize::from(restored.is_ok()), "the lock, and the map if it is there");
    let files = store.checkpoints("copy").unwrap();
    restored.map(|unpacked| {
        let unpacked = unpacked.unwrap();
        assert_eq!(files.len(), 1 - unpacked.warnings.len());
        unpacked
    })
}

#[tokio::test]
async fn what_is_missing_or_too_much_is_refused_by_name() {
    let whole = backup().await;
    let names: Vec<&str> = whole.iter().map(|(name, _)| &**name).collect();
    assert_eq!(names, [CHECKPOINT, RECORDING, END]);
    let unpacked = restore(&whole, 0).unwrap();
    assert_eq!(unpacked, Unpacked { frames: 5, warnings: Vec::new() });
    let mut signed = whole.clone();
    sign(&mut signed);
    assert_eq!(signed, whole, "the list is what `sha256sum` would write");
    type Change = fn(&mut Files);
    let changes: [(&str, &str, Change); 7] = [
        ("a recording that was cut", "0001.mcap in the backup is not whole", |files| {
            let recording = file(files, RECORDING);
            recording.truncate(recording.len() / 2);
        }),
        ("without its recording", "0001.mcap in the backup is missing", |files| {
            files.retain(|(name, _)| name != RECORDING);
        }),
        ("a file that is not in the list", "0002.mcap in the backup has no checksum", |files| {
            let recording = file(files, RECORDING).clone();
            files.insert(0, ("0002.mcap".into(), recording));
        }),
        ("an empty list", "has no checksum", |files| file(files, END).clear()),
        ("two checkpoints", "more than one checkpoint", |files| {
            let checkpoint = file(files, CHECKPOINT).clone();
            files.insert(0, ("checkpoint-0002.lexsplat".into(), checkpoint));
            sign(files);
        }),
        ("a damaged checkpoint", "its checksum is wrong", |files| {
            let checkpoint = file(files, CHECKPOINT);
            *checkpoint.last_mut().unwrap() ^= 1;
            sign(files);
        }),
        ("a checkpoint alone", "no frame is in the backup", |files| {
            files.retain(|(name, _)| name != RECORDING);
            sign(files);
        }),
    ];
    for (what, reason, change) in changes {
        let mut files = whole.clone();
        change(&mut files);
        let refused = restore(&files, 0).unwrap_err();
        assert!(
            matches!(&refused, BackupFault::Refused(told) if told.contains(reason)),
            "{what}: {refused}"
        );
    }
}

#[tokio::test]
async fn a_checkpoint_of_another_version_is_left_out() {
    let mut files = backup().await;
    let checkpoint = file(&mut files, CHECKPOINT);
    checkpoint[8] = 200;
    let covered = checkpoint.len() - 32;
    let checksum = Sha256::digest(&checkpoint[..covered]);
    checkpoint[covered..].copy_from_slice(&checksum);
    sign(&mut files);
    let unpacked = restore(&files, 0).unwrap();
    assert_eq!(unpacked.frames, 5);
    assert!(unpacked.warnings[0].contains("written by another version (200"), "{unpacked:?}");
}

#[tokio::test]
async fn a_backup_needs_room() {
    let files = backup().await;
    let bytes: usize =
        files.iter().filter(|(name, _)| name != END).map(|(_, file)| file.len()).sum();
    let refused = restore(&files, bytes as u64 - 1).unwrap_err();
    let quota = matches!(refused, BackupFault::Store(StoreError::Quota { .. }));
    assert!(quota && refused.to_string().contains("recording.max_bytes"), "{refused}");
    restore(&files, bytes as u64).unwrap();
}

#[test]
fn what_is_no_tar_is_not_shown() {
    let data = tempfile::tempdir().unwrap();
    let store = Store::open(Some(data.path()), &RecordingConfig::default()).unwrap();
    let garbage: Vec<u8> = (0..5000_u32).map(|at| (at * 97 % 251) as u8).collect();
    let refused = store.restore("copy", Cursor::new(garbage)).unwrap_err().to_string();
    assert!(refused.is_ascii() && refused.len() < 100, "{refused}");
    let entry = tar_of(&vec![("\u{1b}[2J\u{7f}\u{80}".into(), Vec::new())]);
    let refused = store.restore("copy", Cursor::new(entry)).unwrap_err().to_string();
    assert!(!refused.chars().any(char::is_control) && refused.len() < 200, "{refused}");
}
