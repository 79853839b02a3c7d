//! Maps and their recordings stay in step.

use super::*;
use crate::pipeline::checkpoint::Checkpoint;
use crate::pipeline::map::MapError;
use crate::store::{RecordingConfig, Store};
use crate::test_support::{config, engine, frame, mutate, mutations, open_message};
use lexsplat_proto::v1;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use std::path::Path;
use std::time::Duration;

fn maps(folder: &Path) -> RecordedMaps {
    RecordedMaps::new(
        engine(),
        Store::open(Some(folder), &RecordingConfig { low_bytes: 0, ..RecordingConfig::default() })
            .unwrap(),
    )
}

async fn record(maps: &RecordedMaps, open: &v1::OpenMap, frames: std::ops::Range<u64>) {
    let recorder = maps.store().record(open).await.unwrap().unwrap();
    for sequence in frames {
        recorder.append(frame(sequence)).await.unwrap();
    }
    recorder.finish().await;
}

#[tokio::test]
async fn a_map_that_cannot_be_rebuilt_keeps_its_recording_and_takes_no_frames() {
    let folder = tempfile::tempdir().unwrap();
    let maps = maps(folder.path());
    // A camera that today's limits refuse.
    let good = open_message("maps-refused");
    let camera = v1::Intrinsics { fx: f64::NAN, ..good.intrinsics.unwrap() };
    record(&maps, &v1::OpenMap { intrinsics: Some(camera), ..good.clone() }, 0..2).await;
    let file = folder.path().join("maps-refused.map/0001.mcap");
    let before = std::fs::read(&file).unwrap();
    let limits = config().ingest.limits();
    load_all(&maps, &limits).await.unwrap();

    let got = maps.get("maps-refused");
    assert!(matches!(got, Err(MapsError::Map(MapError::Failed { .. }))));
    assert!(maps.warnings()[0].starts_with("maps-refused: "), "{:?}", maps.warnings());
    let refused = maps.open(&good).await.map(|_| ()).unwrap_err().to_string();
    assert!(refused.contains("could not be rebuilt"), "{refused}");
    assert!(maps.create("maps-refused").await.is_err());
    assert_eq!(std::fs::read(&file).unwrap(), before, "nothing was appended");

    maps.delete("maps-refused").await.unwrap();
    assert!(!file.exists() && maps.warnings().is_empty());
    maps.create("maps-refused").await.unwrap();
    maps.delete("maps-refused").await.unwrap();
}

#[tokio::test]
async fn a_map_that_was_rebuilt_in_part_is_deleted_as_a_whole() {
    let folder = tempfile::tempdir().unwrap();
    let maps = maps(folder.path());
    record(&maps, &open_message("maps-part"), 0..2).await;
    // No file can be read there.
    std::fs::create_dir(folder.path().join("maps-part.map/0002.mcap")).unwrap();
    load_all(&maps, &config().ingest.limits()).await.unwrap();
    let refused = maps.get("maps-part").map(|_| ()).unwrap_err().to_string();
    assert!(refused.contains("could not be rebuilt") && !refused.contains('/'), "{refused}");
    assert!(engine().map("maps-part").is_err(), "no part of it takes a place");
    maps.delete("maps-part").await.unwrap();
    assert!(
        matches!(maps.get("maps-part"), Err(MapsError::Map(MapError::NotFound { .. }))),
        "no part is left"
    );
    assert!(!folder.path().join("maps-part.map").exists());
}

#[tokio::test]
async fn a_map_is_deleted_to_the_end_when_the_caller_is_gone() {
    let folder = tempfile::tempdir().unwrap();
    let maps = maps(folder.path());
    record(&maps, &open_message("maps-gone"), 0..2).await;
    load_all(&maps, &config().ingest.limits()).await.unwrap();
    assert_eq!(maps.get("maps-gone").unwrap().status().frames_received, 2);
    // The caller goes after the first step.
    let begun = tokio::time::timeout(Duration::ZERO, maps.delete("maps-gone")).await;
    assert!(begun.is_err(), "it takes a while");
    for _ in 0..600 {
        if !folder.path().join("maps-gone.map").exists() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    assert!(!folder.path().join("maps-gone.map").exists());
    assert!(matches!(maps.get("maps-gone"), Err(MapsError::Map(MapError::NotFound { .. }))));
}

#[tokio::test]
async fn frames_that_are_refused_when_they_are_read_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let maps = maps(folder.path());
    record(&maps, &open_message("maps-order"), 5..8).await;
    record(&maps, &open_message("maps-order"), 0..2).await;
    load_all(&maps, &config().ingest.limits()).await.unwrap();
    let status = maps.get("maps-order").unwrap().status();
    assert_eq!(status.frames_received, 3);
    assert!(status.recording_damage.is_some_and(|words| words.starts_with("2 recorded frame(s)")));
    maps.delete("maps-order").await.unwrap();
}

#[tokio::test]
async fn damage_is_told_in_the_status() {
    let folder = tempfile::tempdir().unwrap();
    let maps = maps(folder.path());
    record(&maps, &open_message("maps-damaged"), 0..4).await;
    let file = folder.path().join("maps-damaged.map/0001.mcap");
    let mut bytes = std::fs::read(&file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&file, &bytes).unwrap();
    load_all(&maps, &config().ingest.limits()).await.unwrap();
    let status = maps.get("maps-damaged").unwrap().status();
    assert_eq!(status.frames_received, 3, "one frame is lost");
    assert!(status.recording_damage.is_some_and(|words| words.contains(".damaged-")));
    assert!(maps.warnings()[0].contains("damaged"), "{:?}", maps.warnings());
    maps.delete("maps-damaged").await.unwrap();
}

/// The state in a checkpoint, damaged at random and with a checksum that is right: it is read or refused, and
/// nothing panics.
#[tokio::test]
async fn damaged_states_are_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let maps = maps(folder.path());
    record(&maps, &open_message("maps-states"), 0..2).await;
    load_all(&maps, &config().ingest.limits()).await.unwrap();
    let mut state = Vec::new();
    maps.get("maps-states").unwrap().save().await.unwrap().write(&mut state).unwrap();
    assert!(Checkpoint::read(&mut &state[..]).is_ok());
    let mut random = ChaCha8Rng::seed_from_u64(22);
    let mut refused = 0;
    for _ in 0..mutations(300) {
        let mut bytes = state.clone();
        mutate(&mut random, &mut bytes);
        refused += usize::from(Checkpoint::read(&mut &bytes[..]).is_err());
    }
    assert!(refused > 0);
    maps.delete("maps-states").await.unwrap();
}
