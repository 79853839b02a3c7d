//! Random histories of the store on a disk that fails and crashes: frames, checkpoints and deletions, then
//! a crash, perhaps a flipped bit, and the store is opened again by its own reader. What was acknowledged
//! is there, bit for bit; what was not is there as a whole or not at all; damage is told.

use super::crash_model::{Fault, Lies};
use super::directory::Directory;
use super::disk::Disk;
use super::faulty_disk::FaultyDisk;
use super::recording::damaged;
use super::*;
use lexsplat_proto::v1::frame_message::Message;
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use std::collections::BTreeSet;

const MAP: &str = "kitchen";
/// Histories of `make test`, and of `make soak` unless `HISTORIES` says otherwise.
const FEW: u64 = 300;
const MANY: u64 = 50_000;
/// Crashes of one history.
const LIVES: usize = 4;

fn opening() -> v1::OpenMap {
    let intrinsics = Some(v1::Intrinsics { width: 4, height: 2, fx: 3., fy: 3., cx: 1.5, cy: 0.5 });
    v1::OpenMap { map: MAP.into(), intrinsics, depth_unit_metres: 0.001, ..Default::default() }
}

/// Frames of many lengths; one has bytes that look like the beginning of a record.
fn frame(sequence: u64) -> v1::Frame {
    let color = [&[6_u8, 0, 1, 0, 0, 0, 0, 0, 0][..], &sequence.to_le_bytes()].concat();
    v1::Frame {
        sequence,
        timestamp_nanos: 1 + sequence,
        color_format: v1::ColorFormat::Jpeg.into(),
        color: color.repeat(1 + (sequence as usize * 37) % 90).into(),
        depth_format: v1::DepthFormat::U16.into(),
        depth: vec![7; 16].into(),
        ..Default::default()
    }
}

/// A state that says which frame it is through.
fn state(through: u64) -> Vec<u8> {
    (0..400 + through % 700).map(|at| (at * at + through) as u8).collect()
}

/// Why a history is not what was promised.
type Broken = String;

/// How often what happened.
#[derive(Debug, Default)]
struct Tally {
    crashes: usize,
    frames: usize,
    refused: usize,
    flips: usize,
    checkpoints: usize,
    deletions: usize,
    told: usize,
}

/// What must be on the disk, and what may be.
#[derive(Default)]
struct Promised {
    durable: BTreeSet<u64>,
    /// Frames of the map that is there now; none before was deleted.
    sent: BTreeSet<u64>,
    /// The newest frame of a checkpoint that was written.
    saved: Option<u64>,
    /// The map was being deleted: it is there as a whole or not at all.
    may_be_gone: bool,
    next: u64,
}

/// One history: a store on a disk that crashes now and then.
struct History {
    random: ChaCha8Rng,
    disk: FaultyDisk,
    promised: Promised,
    /// Bits of recordings that were flipped since they were read.
    flips: usize,
    /// Names of checkpoints of which a bit was flipped.
    flipped_checkpoints: BTreeSet<String>,
    tally: Tally,
}

impl History {
    fn run(seed: u64, lies: Lies) -> Result<Tally, Broken> {
        let mut history = Self {
            random: ChaCha8Rng::seed_from_u64(seed),
            disk: FaultyDisk::new(seed, lies),
            promised: Promised::default(),
            flips: 0,
            flipped_checkpoints: BTreeSet::new(),
            tally: Tally::default(),
        };
        for life in 0..LIVES {
            let lived = history.live();
            lived.map_err(|broken| format!("seed {seed}, life {life}: {broken}"))?;
        }
        Ok(history.tally)
    }

    /// Plans a fault, opens the store, compares, works, and crashes.
    fn live(&mut self) -> Result<(), Broken> {
        let most = 1 << self.random.random_range(2..10);
        let operations = self.random.random_range(0..most);
        match self.random.random_range(0..4) {
            0 => {}
            1 => {
                let operations_without_room = self.random.random_range(1..20);
                self.disk.plan(operations, Fault::Full { operations: operations_without_room });
            }
            2 => self.disk.plan(operations, Fault::Broken),
            _ => self.disk.plan(operations, Fault::Crash),
        }
        let disk: Arc<dyn Disk> = Arc::new(self.disk.clone());
        if let Ok(directory) = Directory::open(disk, self.disk.root()) {
            self.compare(&directory)?;
            self.work(&directory);
        }
        self.disk = self.disk.crash();
        self.tally.crashes += 1;
        self.flip();
        Ok(())
    }

    /// Streams, checkpoints and now and then a deletion, until the crash.
    fn work(&mut self, directory: &Directory) {
        for _ in 0..self.random.random_range(0..5) {
            match self.random.random_range(0..8) {
                0 => self.delete(directory),
                1 | 2 => self.save(directory),
                _ => self.stream(directory),
            }
            if self.disk.has_crashed() || self.promised.may_be_gone {
                return;
            }
        }
    }

    fn stream(&mut self, directory: &Directory) {
        let (disk, folder) = (directory.disk().clone(), directory.map(MAP));
        let room = Arc::new(Room::new(&folder, RecordingConfig::default()));
        let Ok(recorder) = Recorder::new(disk, folder, opening(), room, Life::default()) else {
            return;
        };
        for _ in 0..self.random.random_range(0..8) {
            let sequence = self.promised.next;
            self.promised.next += 1 + u64::from(self.random.random_range(0..10_u8) == 0);
            self.promised.sent.insert(sequence);
            if recorder.append_now(frame(sequence)).is_ok() {
                self.promised.durable.insert(sequence);
                self.tally.frames += 1;
            } else {
                self.tally.refused += 1;
            }
        }
        if self.random.random_range(0..2) == 0 {
            // All frames are in the file without it.
            let _ = recorder.finish_now();
        }
    }

    fn save(&mut self, directory: &Directory) {
        let Some(through) = self.promised.durable.last().copied() else { return };
        let label = Label { map: MAP.into(), fingerprint: "same".into(), through, frames: 1 };
        let folder = directory.map(MAP);
        let room = Room::new(&folder, RecordingConfig::default());
        let saved = checkpoints::write(&**directory.disk(), &folder, &room, &label, |out| {
            out.write_all(&state(through))
        });
        if saved.is_ok() {
            self.promised.saved = Some(through);
            self.tally.checkpoints += 1;
        }
    }

    fn delete(&mut self, directory: &Directory) {
        if directory.remove(MAP).is_ok() {
            let next = self.promised.next;
            self.promised = Promised { next, ..Promised::default() };
            self.tally.deletions += 1;
        } else {
            self.promised.may_be_gone = true;
        }
    }

    /// Flips a bit now and then, of what will be read.
    fn flip(&mut self) {
        let Ok(entries) = std::fs::read_dir(self.disk.root().join(format!("{MAP}.map"))) else {
            return;
        };
        let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
        paths.retain(|path| {
            let name = path.file_name().unwrap().to_str().unwrap();
            recording::is_recording(name) || checkpoints::is_one(name)
        });
        paths.sort();
        if paths.is_empty() || self.random.random_range(0..3) > 0 {
            return;
        }
        let path = paths.swap_remove(self.random.random_range(0..paths.len()));
        let mut bytes = std::fs::read(&path).unwrap();
        if bytes.is_empty() {
            return;
        }
        let at = self.random.random_range(0..bytes.len());
        bytes[at] ^= 1 << self.random.random_range(0..8);
        self.disk.replace(&path, bytes);
        let name = path.file_name().unwrap().to_str().unwrap();
        if checkpoints::is_one(name) {
            self.flipped_checkpoints.insert(name.to_owned());
        } else {
            self.flips += 1;
        }
        self.tally.flips += 1;
    }

    /// Reads all that is there and compares it with what was promised.
    fn compare(&mut self, directory: &Directory) -> Result<(), Broken> {
        let folder = directory.map(MAP);
        if !folder.is_dir() {
            return self.expect_no_map();
        }
        self.compare_checkpoints(&folder)?;
        let (found, is_told) = read(directory)?;
        if found.is_empty() && self.promised.may_be_gone {
            return self.expect_no_map();
        }
        if let Some(stranger) = found.difference(&self.promised.sent).next() {
            return Err(format!("frame {stranger} was not sent, or was deleted"));
        }
        let lost: Vec<&u64> = self.promised.durable.difference(&found).collect();
        if lost.len() > self.flips {
            return Err(format!("lost {lost:?}, damage told: {is_told}"));
        }
        if !lost.is_empty() && !is_told {
            return Err(format!("lost {lost:?} in silence"));
        }
        self.tally.told += usize::from(is_told);
        self.flips = 0;
        // What was read is in the map: it has to stay.
        self.promised.durable = found;
        self.promised.may_be_gone = false;
        for aside in damaged(&folder).map_err(|error| error.to_string())? {
            // An error: the disk fails just now.
            let _ = directory.disk().remove(&aside);
        }
        Ok(())
    }

    fn expect_no_map(&mut self) -> Result<(), Broken> {
        let Promised { durable, may_be_gone, next, .. } = &self.promised;
        if !durable.is_empty() && !may_be_gone {
            return Err(format!("the map is gone, and {durable:?} with it"));
        }
        self.promised = Promised { next: *next, ..Promised::default() };
        Ok(())
    }

    /// The newest checkpoint that can be read is not older than the one that was written; if one cannot,
    /// its bit was flipped.
    fn compare_checkpoints(&mut self, folder: &Path) -> Result<(), Broken> {
        let mut best = None;
        for path in checkpoints::list(folder).map_err(|error| error.to_string())? {
            let name = path.file_name().unwrap().to_str().unwrap();
            let is_flipped = self.flipped_checkpoints.contains(name);
            match load(&path) {
                Ok((through, found)) if found == state(through) => best = best.max(Some(through)),
                Ok((through, _)) => return Err(format!("another state than that of {through}")),
                Err(_) if is_flipped => self.promised.saved = None,
                Err(fault) => return Err(format!("{}: {fault}", path.display())),
            }
        }
        if best < self.promised.saved && !self.promised.may_be_gone {
            return Err(format!("checkpoint of {best:?}, not of {:?}", self.promised.saved));
        }
        Ok(())
    }
}

fn load(path: &Path) -> Result<(u64, Vec<u8>), CheckpointFault> {
    let mut reader = CheckpointReader::open(path)?;
    let mut found = Vec::new();
    let read = reader.read_to_end(&mut found);
    let through = reader.label().through;
    reader.finish()?;
    read.map_err(|error| CheckpointFault::Damaged(error.to_string()))?;
    Ok((through, found))
}

/// The frames in the recording, each as it was sent and in their order, and whether damage was told.
fn read(directory: &Directory) -> Result<(BTreeSet<u64>, bool), Broken> {
    let said = |error: StoreError| error.to_string();
    let mut records = Records::open(directory.disk().clone(), directory.map(MAP)).map_err(said)?;
    let (mut found, mut is_told) = (BTreeSet::new(), false);
    while let Some(entry) = records.next().map_err(said)? {
        match entry {
            Entry::Damage(_) => is_told = true,
            Entry::Message(Message::Open(open)) => {
                if open != opening() {
                    return Err("another opening".into());
                }
            }
            Entry::Message(Message::Frame(read)) => {
                let sequence = read.sequence;
                if read != frame(sequence) {
                    return Err(format!("frame {sequence} is another one"));
                }
                if found.last().is_some_and(|last| *last >= sequence) {
                    return Err(format!("frame {sequence} comes after {:?}", found.last()));
                }
                found.insert(sequence);
            }
        }
    }
    is_told |= !damaged(&directory.map(MAP)).map_err(said)?.is_empty();
    Ok((found, is_told))
}

fn histories(count: u64, lies: Lies) -> Result<Tally, Broken> {
    let mut all = Tally::default();
    for seed in 0..count {
        let Tally { crashes, frames, refused, flips, checkpoints, deletions, told } =
            History::run(seed, lies)?;
        all.crashes += crashes;
        all.frames += frames;
        all.refused += refused;
        all.flips += flips;
        all.checkpoints += checkpoints;
        all.deletions += deletions;
        all.told += told;
    }
    Ok(all)
}

#[test]
fn what_was_acknowledged_survives_every_fault() {
    let tally = histories(FEW, Lies::default()).unwrap();
    println!("{tally:?}");
    let Tally { frames, refused, flips, checkpoints, deletions, told, .. } = tally;
    for count in [frames, refused, flips, checkpoints, deletions, told] {
        assert!(count > 20, "too few of something: {tally:?}");
    }
}

#[test]
#[ignore = "minutes: make soak; HISTORIES says how many"]
fn many_histories() {
    let count = std::env::var("HISTORIES")
        .map_or(MANY, |count| count.parse().expect("HISTORIES is a number of histories"));
    println!("{count} histories: {:?}", histories(count, Lies::default()).unwrap());
}

/// Negative controls: on a disk that does not sync, something is lost, and it is noticed.
#[test]
fn a_sync_that_is_left_out_is_found() {
    let files = Lies { files_are_not_synced: true, ..Lies::default() };
    let found = histories(FEW, files).unwrap_err();
    assert!(found.contains("lost") || found.contains("checkpoint"), "{found}");
    let folders = Lies { folders_are_not_synced: true, ..Lies::default() };
    let found = histories(FEW, folders).unwrap_err();
    assert!(found.contains("lost") || found.contains("gone"), "{found}");
}
