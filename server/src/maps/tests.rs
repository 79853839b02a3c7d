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
async fn an_empty_map_is_there_after_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let first = maps(folder.path());
    first.create("maps-empty").await.unwrap();
    rename(&first, "maps-empty", "maps-bare").await.unwrap();
    load_all(&first, &config().ingest.limits()).await.unwrap();
    // All tests share the engine.
    engine().delete("maps-bare").await.unwrap();
    drop(first);
    let second = maps(folder.path());
    load_all(&second, &config().ingest.limits()).await.unwrap();
    assert_eq!(second.get("maps-bare").unwrap().status().frames_received, 0);
    assert!(second.get("maps-empty").is_err());
    assert!(second.warnings().is_empty(), "{:?}", second.warnings());
    second.delete("maps-bare").await.unwrap();
    assert!(!folder.path().join("maps-bare.map").exists());
}

#[tokio::test]
async fn a_renamed_map_is_the_same_map() {
    let folder = tempfile::tempdir().unwrap();
    let maps = maps(folder.path());
    let limits = config().ingest.limits();
    record(&maps, &open_message("maps-old"), 0..3).await;
    record(&maps, &open_message("maps-taken"), 0..1).await;
    load_all(&maps, &limits).await.unwrap();
    let poses = |map: &str| {
        let map = maps.get(map).unwrap();
        async move {
            let snapshot = map.snapshot().await;
            let poses = snapshot.trajectory.iter();
            poses.map(|frame| (frame.sequence, frame.world_from_camera)).collect::<Vec<_>>()
        }
    };
    let before = poses("maps-old").await;

    // What cannot be renamed stays as it is.
    for (to, why) in [("maps-taken", "there already"), ("a/b", "name")] {
        let refused = rename(&maps, "maps-old", to).await.unwrap_err().to_string();
        assert!(refused.contains(why), "{refused}");
    }
    let sender = maps.get("maps-old").unwrap().claim().unwrap();
    let refused = rename(&maps, "maps-old", "maps-new").await.unwrap_err();
    assert!(matches!(refused, RenameError::Maps(MapsError::Map(MapError::Busy { .. }))));
    drop(sender);
    assert!(maps.get("maps-new").is_err(), "the name is free again");
    assert_eq!(poses("maps-old").await, before);

    rename(&maps, "maps-old", "maps-new").await.unwrap();
    let gone = maps.get("maps-old");
    assert!(matches!(gone, Err(MapsError::Map(MapError::NotFound { .. }))));
    assert!(!folder.path().join("maps-old.map").exists());
    assert!(matches!(maps.get("maps-new"), Err(MapsError::Loading { .. })));
    load_all(&maps, &limits).await.unwrap();
    assert_eq!(poses("maps-new").await, before);
    // Frames go on under the new name, and the old one is free.
    let recording = maps.open(&open_message("maps-new")).await.unwrap();
    recording.record(frame(3)).await.unwrap();
    recording.finish().await;
    drop(recording);
    maps.create("maps-old").await.unwrap();
    for map in ["maps-old", "maps-new", "maps-taken"] {
        maps.delete(map).await.unwrap();
    }
}

#[tokio::test]
async fn a_map_whose_folder_cannot_be_renamed_keeps_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let maps = maps(folder.path());
    record(&maps, &open_message("maps-stays"), 0..2).await;
    load_all(&maps, &config().ingest.limits()).await.unwrap();
    // A file of the new name is no map, and no folder can take its place.
    std::fs::write(folder.path().join("maps-never.map"), "notes").unwrap();
    rename(&maps, "maps-stays", "maps-never").await.unwrap_err();
    load_all(&maps, &config().ingest.limits()).await.unwrap();
    assert_eq!(maps.get("maps-stays").unwrap().status().frames_received, 2);
    assert!(maps.get("maps-never").is_err());
    maps.delete("maps-stays").await.unwrap();
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
