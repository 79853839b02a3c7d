//! Data sets of which one file was damaged at random: they are read or refused, and nothing panics.

use super::formats::{nerfstudio, with_table};
use super::{cameras, captures, open, replica, seven_scenes, tum};
use crate::dataset::{Dataset, inspect};
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use std::path::{Path, PathBuf};

/// Damages a file or a message: flips bits, puts extreme numbers in, cuts, repeats or inserts bytes.
pub(crate) fn mutate(random: &mut ChaCha8Rng, bytes: &mut Vec<u8>) {
    for _ in 0..random.random_range(1..5) {
        let length = bytes.len();
        let at = random.random_range(0..=length);
        let some = random.random_range(0..=(length - at).min(64));
        match random.random_range(0..6) {
            0 if at < length => bytes[at] ^= 1 << random.random_range(0..8),
            1 => {
                let extremes = [0, 1, i64::MAX as u64, u64::MAX, u64::from(u32::MAX), 1 << 40];
                let number = extremes[random.random_range(0..extremes.len())].to_le_bytes();
                bytes[at..at + some.min(8)].copy_from_slice(&number[..some.min(8)]);
            }
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..at + some)),
            4 => {
                let repeated = bytes[at..at + some].to_vec();
                bytes.splice(at..at, repeated);
            }
            _ => {
                let noise: Vec<u8> = (0..some).map(|_| random.random()).collect();
                bytes.splice(at..at, noise);
            }
        }
    }
}

/// How many mutations a test tries: `MUTATIONS`, as `make fuzz` sets it, or so many.
pub(crate) fn mutations(few: u64) -> u64 {
    std::env::var("MUTATIONS").map_or(few, |many| many.parse().expect("a number"))
}

/// All files in a folder, sorted.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut found: Vec<PathBuf> =
        entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect();
    found.sort();
    found
}

/// Reads every frame and mask; returns whether nothing was refused.
fn is_readable(dataset: &dyn Dataset) -> bool {
    (0..dataset.len()).all(|at| {
        let mask = dataset.truth().map(|truth| truth.mask(at));
        dataset.frame(at).is_ok() && mask.is_none_or(|mask| mask.is_ok())
    })
}

fn damage(kind: &str, folder: &Path) {
    let files = if folder.is_file() { vec![folder.to_path_buf()] } else { files(folder) };
    let mut random = ChaCha8Rng::seed_from_u64(22);
    let (mut read, mut refused) = (0, 0);
    for number in 0..mutations(400) {
        let path = &files[number as usize % files.len()];
        let whole = std::fs::read(path).unwrap();
        let mut bytes = whole.clone();
        mutate(&mut random, &mut bytes);
        std::fs::write(path, bytes).unwrap();
        match open(kind, folder) {
            Ok(dataset) => {
                let is_readable = is_readable(&*dataset);
                (read, refused) =
                    (read + u64::from(is_readable), refused + u64::from(!is_readable));
                assert!(inspect(&*dataset, |_| ()).frames > 0);
            }
            Err(_) => refused += 1,
        }
        std::fs::write(path, whole).unwrap();
    }
    println!("{kind}: {read} were read, {refused} were refused");
    assert!(read > 0 && refused > 0);
    let dataset = open(kind, folder).unwrap();
    assert!(is_readable(&*dataset), "it is whole again");
    for at in 0..dataset.len() {
        let sent = dataset.frame(at).unwrap();
        assert_eq!(dataset.clean_frame(at).unwrap(), sent, "{kind}: scored against what is sent");
    }
}

#[test]
fn damaged_data_sets_are_read_or_refused() {
    damage("replica", replica().path());
    damage("7scenes", seven_scenes().path());
    let (_parent, folder) = tum("freiburg1");
    damage("tum", &folder);
    damage("nerfstudio", nerfstudio(|_| ()).path());
    damage("folder", with_table("[poses]\nfiles = \"pose/*.txt\"").path());
    damage("folder", cameras::phone().path());
    damage("r3d", &captures::alone("r3d").path().join("kitchen.r3d"));
    damage("scannet", &captures::alone("scannet").path().join("scene0000_00.sens"));
}
