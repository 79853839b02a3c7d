//! Recordings on a real disk: what is written comes back, also after a crash and after damage.

use super::writer::Writer;
use super::*;
use lexsplat_proto::v1::frame_message::Message;
use std::ops::Range;

const CAMERA: v1::Intrinsics =
    v1::Intrinsics { width: 4, height: 2, fx: 3.0, fy: 3.0, cx: 1.5, cy: 0.5 };

fn opening() -> v1::OpenMap {
    let intrinsics = Some(CAMERA);
    v1::OpenMap {
        map: "kitchen".into(),
        intrinsics,
        depth_unit_metres: 0.001,
        ..Default::default()
    }
}

fn frame(sequence: u64) -> v1::Frame {
    v1::Frame {
        sequence,
        timestamp_nanos: 1 + sequence,
        color_format: v1::ColorFormat::Jpeg.into(),
        color: vec![sequence as u8; 3000].into(),
        depth_format: v1::DepthFormat::U16.into(),
        depth: vec![7; 16].into(),
        ..Default::default()
    }
}

/// A data directory in a temporary folder.
struct Data(tempfile::TempDir);

impl Data {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn store(&self) -> Store {
        Store::open(Some(self.0.path()), &RecordingConfig::default()).unwrap()
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.path().join("kitchen.map").join(name)
    }

    /// Records frames in one stream; without `finish` as if the process had been killed.
    async fn record(&self, frames: Range<u64>, finish: bool) {
        let recorder = self.store().record(&opening()).await.unwrap().unwrap();
        for sequence in frames {
            recorder.append(frame(sequence)).await.unwrap();
        }
        if finish {
            recorder.finish().await;
        } else {
            // Not dropped, which would write the index.
            std::mem::forget(recorder);
        }
    }

    /// The sequences that can be read, and how many places are damaged.
    fn read(&self) -> (Vec<u64>, usize) {
        let mut records = self.store().records("kitchen").unwrap();
        let (mut sequences, mut damages, mut openings) = (Vec::new(), 0, 0);
        while let Some(entry) = records.next().unwrap() {
            match entry {
                Entry::Message(Message::Open(open)) => {
                    assert_eq!(open, opening());
                    openings += 1;
                }
                Entry::Message(Message::Frame(found)) => {
                    assert!(openings > 0, "the opening comes first");
                    assert_eq!(found, frame(found.sequence));
                    sequences.push(found.sequence);
                }
                Entry::Damage(damage) => {
                    assert!(damage.from_byte < damage.to_byte);
                    damages += 1;
                }
            }
        }
        (sequences, damages)
    }

    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path().join("kitchen.map")).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

fn all(range: Range<u64>) -> Vec<u64> {
    range.collect()
}

#[tokio::test]
async fn streams_are_read_back_one_after_the_other() {
    let data = Data::new();
    data.record(0..3, true).await;
    data.record(3..3, true).await;
    data.record(3..5, true).await;
    assert_eq!(data.names(), ["0001.mcap", "0002.mcap"], "a stream without frames has no file");
    assert_eq!(data.read(), (all(0..5), 0));
    assert_eq!(data.names(), ["0001.mcap", "0002.mcap"]);
    assert!(data.store().damaged("kitchen").unwrap().is_empty());
    data.store().forget("kitchen").await.unwrap();
    assert!(data.store().maps().unwrap().is_empty());
}

#[tokio::test]
async fn a_recording_that_was_not_closed_is_finished() {
    let data = Data::new();
    data.record(0..3, false).await;
    let cut = std::fs::read(data.file("0001.mcap")).unwrap();
    assert_eq!(data.read(), (all(0..3), 0));
    let finished = std::fs::read(data.file("0001.mcap")).unwrap();
    assert!(finished.len() > cut.len() && finished.ends_with(mcap::MAGIC), "it has an index now");
    assert_eq!(data.read(), (all(0..3), 0));
    let summary = mcap::Summary::read(&finished).unwrap().expect("other programs can open it");
    let topics: Vec<&str> = summary.channels.values().map(|c| c.topic.as_str()).collect();
    for topic in ["/camera/calibration", "/camera/color", "/camera/depth_raw", "/lexsplat/frame"] {
        assert!(topics.contains(&topic), "{topic} in {topics:?}");
    }
}

/// What a crash can leave at the end: every length that the file had while the last frame was written.
#[tokio::test]
async fn only_an_incomplete_frame_is_cut_off() {
    let data = Data::new();
    data.record(0..2, false).await;
    let two = std::fs::read(data.file("0001.mcap")).unwrap();
    std::fs::remove_file(data.file("0001.mcap")).unwrap();
    data.record(0..3, false).await;
    let three = std::fs::read(data.file("0001.mcap")).unwrap();
    assert_eq!(two, three[..two.len()], "frames are appended");
    for length in (two.len()..three.len()).step_by(311) {
        std::fs::write(data.file("0001.mcap"), &three[..length]).unwrap();
        let (sequences, damages) = data.read();
        // The index of the last chunk is no part of the frame.
        let is_whole = sequences.len() == 3;
        assert_eq!((sequences, damages), (all(0..if is_whole { 3 } else { 2 }), 0), "{length}");
        assert!(!is_whole || three.len() - length < 200, "{length} of {}", three.len());
        assert_eq!(data.names(), ["0001.mcap"], "that is no damage");
    }
    std::fs::write(data.file("0001.mcap"), &three[..5]).unwrap();
    assert_eq!(data.read(), (Vec::new(), 0));
    assert!(data.names().is_empty(), "not even a header was written");
}

/// One flipped bit costs at most one frame, wherever it is, and is never silent.
#[tokio::test]
async fn a_flipped_bit_costs_one_frame_and_is_told() {
    for finish in [true, false] {
        let data = Data::new();
        data.record(0..6, finish).await;
        let whole = std::fs::read(data.file("0001.mcap")).unwrap();
        // The index behind the frames is not read.
        let frames_end = {
            let read = |length: usize| {
                std::fs::write(data.file("0001.mcap"), &whole[..length]).unwrap();
                data.read().0.len()
            };
            (0..whole.len()).step_by(400).find(|length| read(*length) == 6).unwrap_or(whole.len())
        };
        let mut damaged = 0;
        for at in (0..frames_end - 200).step_by(frames_end / 25) {
            let mut flipped = whole.clone();
            flipped[at] ^= 1 << (at % 8);
            for name in data.names() {
                std::fs::remove_file(data.file(&name)).unwrap();
            }
            std::fs::write(data.file("0001.mcap"), &flipped).unwrap();
            let (sequences, damages) = data.read();
            assert!(sequences.len() >= 5 && sequences.is_sorted(), "{at}: {sequences:?}");
            if damages == 0 {
                assert_eq!(sequences, all(0..6), "{at}: lost in silence");
                continue;
            }
            damaged += 1;
            assert_eq!(data.store().damaged("kitchen").unwrap().len(), 1, "{at}");
            let aside = data.store().damaged("kitchen").unwrap().remove(0);
            assert_eq!(std::fs::read(aside).unwrap(), flipped, "it is kept as it is");
            assert_eq!(data.read(), (sequences, 0), "{at}: what is whole was written anew");
        }
        assert!(damaged > 10, "{damaged}");
    }
}

/// The length of the last frame's chunk is wrong, and nothing follows: that is no frame that a crash cut off.
#[tokio::test]
async fn a_wrong_length_at_the_end_is_damage() {
    let data = Data::new();
    data.record(0..2, false).await;
    let before = std::fs::metadata(data.file("0001.mcap")).unwrap().len() as usize;
    std::fs::remove_file(data.file("0001.mcap")).unwrap();
    data.record(0..3, false).await;
    let mut bytes = std::fs::read(data.file("0001.mcap")).unwrap();
    assert_eq!(bytes[before], mcap::records::op::CHUNK);
    // The third byte of the length that follows: 64 KiB more.
    bytes[before + 3] ^= 1;
    std::fs::write(data.file("0001.mcap"), bytes).unwrap();
    assert_eq!(data.read(), (all(0..2), 1));
    assert_eq!(data.store().damaged("kitchen").unwrap().len(), 1);
}

#[tokio::test]
async fn recording_goes_on_after_an_error_in_a_new_file() {
    let data = Data::new();
    let store = data.store();
    let recorder = store.record(&opening()).await.unwrap().unwrap();
    recorder.append(frame(0)).await.unwrap();
    let folder = data.0.path().join("kitchen.map");
    let away = data.0.path().join("away");
    recorder.finish().await;
    std::fs::rename(&folder, &away).unwrap();
    let refused = recorder.append(frame(1)).await.unwrap_err();
    assert!(!refused.reason().contains('/'), "no path of the server: {}", refused.reason());
    std::fs::rename(&away, &folder).unwrap();
    recorder.append(frame(1)).await.unwrap();
    recorder.finish().await;
    drop(store);
    assert_eq!(data.read(), (all(0..2), 0));
}

/// `/dev/full` refuses every byte, as a full disk does.
#[test]
fn a_full_disk_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("0001.mcap");
    std::os::unix::fs::symlink("/dev/full", &path).unwrap();
    let real: Arc<dyn Disk> = Arc::new(RealDisk);
    // A file is only ever created, never opened.
    assert!(writer::Writer::create(&real, &path, &opening()).is_err());
}

#[tokio::test]
async fn files_are_read_in_the_order_of_their_numbers() {
    let data = Data::new();
    data.record(0..2, true).await;
    data.record(2..4, true).await;
    std::fs::rename(data.file("0001.mcap"), data.file("9999.mcap")).unwrap();
    std::fs::rename(data.file("0002.mcap"), data.file("10000.mcap")).unwrap();
    data.record(4..6, true).await;
    assert_eq!(data.names(), ["10000.mcap", "10001.mcap", "9999.mcap"]);
    assert_eq!(data.read(), (all(0..6), 0));
}

/// The copy that a repair writes does not fit: here a folder is in its place.
#[tokio::test]
async fn frames_are_used_when_a_file_cannot_be_repaired() {
    let data = Data::new();
    data.record(0..3, false).await;
    std::fs::create_dir(data.file("0001.mcap.repaired")).unwrap();
    assert_eq!(data.read(), (all(0..3), 0));
    std::fs::remove_dir(data.file("0001.mcap.repaired")).unwrap();
    assert_eq!(data.read(), (all(0..3), 0));
    assert_eq!(data.names(), ["0001.mcap"]);
}

#[tokio::test]
async fn a_stream_of_a_deleted_map_writes_nothing_into_the_next_one() {
    let data = Data::new();
    let store = data.store();
    let record = async || store.record(&opening()).await.unwrap().unwrap();
    let stale = record().await;
    store.forget("kitchen").await.unwrap();
    let next = record().await;
    next.append(frame(0)).await.unwrap();
    let refused = stale.append(frame(1_000_000)).await;
    assert!(matches!(refused, Err(StoreError::Closed { .. })), "{refused:?}");
    next.append(frame(1)).await.unwrap();
    next.finish().await;
    drop(store);
    assert_eq!(data.names(), ["0001.mcap"]);
    assert_eq!(data.read(), (all(0..2), 0));
}

#[tokio::test]
async fn a_file_that_is_there_is_never_removed() {
    let data = Data::new();
    data.record(0..3, true).await;
    let path = data.file("0001.mcap");
    let disk: Arc<dyn Disk> = Arc::new(RealDisk);
    assert!(Writer::create(&disk, &path, &opening()).is_err(), "it is there");
    assert_eq!(data.read(), (all(0..3), 0));
    for (name, is_one) in [("0001.mcap", true), ("4294967295.mcap", false)] {
        assert_eq!(recording::is_recording(name), is_one, "{name} has a next number");
    }
    for (number, is_one) in [("0001", true), ("18446744073709551615", false)] {
        let name = format!("checkpoint-{number}.lexsplat");
        assert_eq!(checkpoints::is_one(&name), is_one, "{name} has a next number");
    }
}

#[test]
fn a_record_that_is_longer_than_any_frame_is_damage() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("0001.mcap");
    // A chunk without compression and checksum, whose one record is of an unknown kind: all of it is whole.
    let chunk_of = |bytes: u64| {
        let (data, header) = (bytes + 9, 40);
        let numbers = [0, 0, data].map(u64::to_le_bytes).concat();
        let length = (header + data).to_le_bytes();
        [&[6][..], &length, &numbers, &[0; 8], &data.to_le_bytes(), &[0x90], &bytes.to_le_bytes()]
            .concat()
    };
    let entries = |bytes: u64| {
        let start = [mcap::MAGIC, &chunk_of(bytes)].concat();
        std::fs::write(&path, &start).unwrap();
        // The rest takes no room on the disk.
        let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
        file.set_len(start.len() as u64 + bytes).unwrap();
        let mut reader = reader::Reader::open(&path).unwrap();
        std::iter::from_fn(|| reader.next().unwrap()).count()
    };
    assert_eq!(entries(1000), 0, "a short one is no damage");
    assert!(entries(1 << 30) > 0, "a longer one is not read into memory");
}
