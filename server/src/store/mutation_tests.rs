//! Recordings and checkpoints that were damaged at random: they are read to their end, every frame that comes
//! out is one that went in, and nothing panics.

use super::*;
use crate::test_support::{frame, mutate, mutations, open_message};
use lexsplat_proto::v1::frame_message::Message;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;

const MAP: &str = "damaged";
const FRAMES: u64 = 4;

/// A recording with an index, and one without.
async fn recordings() -> [Vec<u8>; 2] {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(Some(folder.path()), &RecordingConfig::default()).unwrap();
    let recorder = store.record(&open_message(MAP)).await.unwrap().unwrap();
    for sequence in 0..FRAMES {
        recorder.append(frame(sequence)).await.unwrap();
    }
    let file = folder.path().join(format!("{MAP}.map/0001.mcap"));
    let unfinished = std::fs::read(&file).unwrap();
    recorder.finish().await;
    [std::fs::read(&file).unwrap(), unfinished]
}

#[tokio::test]
async fn damaged_recordings_are_read_to_their_end() {
    let seeds = recordings().await;
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join(format!("{MAP}.map"));
    let store = Store::open(Some(folder.path()), &RecordingConfig::default()).unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(22);
    let (mut all, mut some, mut none) = (0, 0, 0);
    for number in 0..mutations(200) {
        let mut bytes = seeds[number as usize % seeds.len()].clone();
        mutate(&mut random, &mut bytes);
        std::fs::create_dir(&map).unwrap();
        std::fs::write(map.join("0001.mcap"), &bytes).unwrap();
        let mut records = store.records(MAP).unwrap();
        assert!(records.count_frames().unwrap() <= bytes.len() as u64);
        let (mut frames, mut entries) = (0, 0);
        while let Some(entry) = records.next().unwrap() {
            entries += 1;
            assert!(entries <= bytes.len(), "mutation {number}: it does not end");
            match entry {
                Entry::Message(Message::Frame(found)) => {
                    assert_eq!(found, frame(found.sequence), "mutation {number}");
                    frames += 1;
                }
                Entry::Message(Message::Open(open)) => assert_eq!(open, open_message(MAP)),
                Entry::Damage(damage) => assert!(damage.from_byte < damage.to_byte),
            }
        }
        match frames {
            0 => none += 1,
            FRAMES.. => all += 1,
            _ => some += 1,
        }
        assert!(examine(folder.path()).is_ok());
        std::fs::remove_dir_all(&map).unwrap();
    }
    println!("all frames of {all} recordings, some of {some}, none of {none}");
    assert!(all > 0 && some > 0);
}

#[test]
fn damaged_checkpoints_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(Some(folder.path()), &RecordingConfig::default()).unwrap();
    std::fs::create_dir(folder.path().join(format!("{MAP}.map"))).unwrap();
    let label = Label { map: MAP.into(), fingerprint: "same".into(), through: 3, frames: 4 };
    let state = b"some state of a map".repeat(50);
    store.save(&label, |out| out.write_all(&state)).unwrap();
    let path = store.checkpoints(MAP).unwrap().remove(0);
    let whole = std::fs::read(&path).unwrap();
    let read = || -> Result<(), CheckpointFault> {
        let mut reader = CheckpointReader::open(&path)?;
        // A state that cannot be read ends in the checksum's error.
        let _ = std::io::copy(&mut reader, &mut std::io::sink());
        reader.finish()
    };
    read().unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(22);
    for number in 0..mutations(2000) {
        let mut bytes = whole.clone();
        mutate(&mut random, &mut bytes);
        std::fs::write(&path, &bytes).unwrap();
        assert!(bytes == whole || read().is_err(), "mutation {number} passes");
    }
}
