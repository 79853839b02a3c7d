//! A map that goes on from its checkpoint becomes what it would have become without one; and copies for
//! readers are made when somebody reads.

use super::super::checkpoint::Checkpoint;
use super::super::engine::Engine;
use super::super::frame::{Frame, FrameUp};
use super::super::map::{Map, Refinement, StreamGuard, Wait};
use super::super::snapshot::MapSnapshot;
use super::super::up::UpSource;
use crate::test_support::{ROOM_CAMERA as CAMERA, per_frame_engine, ray_cast_room, tinted};
use lexsplat_gpu::align::se3;
use nalgebra::{Vector3, Vector6};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long a map may take to settle.
const PATIENCE: Duration = Duration::from_secs(120);
/// Frames before the checkpoint and after it.
const BEFORE: u64 = 5;
const AFTER: u64 = 6;

/// What a camera sees that walks to the side, 6 cm a frame; its pose is to be estimated.
fn frame(sequence: u64) -> Frame {
    let step = Vector6::new(0.06, -0.01, 0.02, 0.01, 0.05, 0.01);
    let pose = se3::exp(&(step * sequence as f64));
    let (mut rgb, mut depth) = (Vec::new(), Vec::new());
    for (place, z) in ray_cast_room(&pose) {
        let wave = (3.1 * place.x + 1.7 * place.y).sin() + (4.3 * place.z - 2.9 * place.x).cos();
        rgb.extend(tinted(128.0 + 40.0 * wave + 20.0 * (9.0 * place.y + 7.0 * place.z).sin()));
        depth.push(z as f32);
    }
    let measured_up = pose.rotation.inverse() * -Vector3::y_axis();
    Frame {
        sequence,
        timestamp_nanos: 1 + sequence * 33_333_333,
        intrinsics: CAMERA,
        rgb: rgb.into(),
        depth_metres: depth.into(),
        depth_lag_nanos: 0,
        world_from_camera: None,
        hint: None,
        labels: None,
        held_out: false,
        up: FrameUp { in_world: None, in_camera: Some(measured_up) },
    }
}

async fn send(sender: &StreamGuard, frames: std::ops::Range<u64>) {
    for sequence in frames {
        sender.map().submit(frame(sequence)).await.unwrap().await.unwrap();
    }
    let began = Instant::now();
    while !sender.map().status().settled {
        assert!(began.elapsed() < PATIENCE, "{:?}", sender.map().status());
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// Through bytes and back.
fn copied(saved: Checkpoint) -> Checkpoint {
    let mut bytes = Vec::new();
    saved.write(&mut bytes).unwrap();
    Checkpoint::read(&mut &bytes[..]).unwrap()
}

/// A map that goes on from a checkpoint, and the right to send to it.
fn resumed(engine: &Engine, name: &str, saved: Checkpoint) -> StreamGuard {
    engine.restore(name, saved).unwrap().reclaim().unwrap()
}

/// Whether two maps are the same for their readers.
async fn same_maps(a: &Map, b: &Map) -> bool {
    let (a, b) = (a.snapshot().await, b.snapshot().await);
    same(&a, &b)
}

fn same(a: &MapSnapshot, b: &MapSnapshot) -> bool {
    let poses = |snapshot: &MapSnapshot| {
        let poses =
            snapshot.trajectory.iter().map(|frame| (frame.sequence, frame.world_from_camera));
        poses.collect::<Vec<_>>()
    };
    let languages = |snapshot: &MapSnapshot| {
        snapshot.keyframes.iter().map(|keyframe| keyframe.has_language).collect::<Vec<_>>()
    };
    a.gaussians == b.gaussians
        && a.revision == b.revision
        && a.up == b.up
        && poses(a) == poses(b)
        && languages(a) == languages(b)
        && a.online.save() == b.online.save()
}

fn counts(map: &Map) -> [u64; 6] {
    let status = map.status();
    let bytes = status.keyframe_bytes;
    [status.frames_received, status.frames_tracked, status.keyframes, status.gaussians, bytes, {
        status.olae_version
    }]
}

#[tokio::test(flavor = "multi_thread")]
async fn a_map_goes_on_as_if_it_had_never_stopped() {
    let engine = per_frame_engine();
    let map: Arc<Map> = engine.open("saved-original").unwrap();
    let original = map.claim().unwrap();
    send(&original, 0..BEFORE).await;
    let state = || async { copied(map.save().await.unwrap()) };
    let saved = state().await;
    assert_eq!((saved.through(), saved.frames()), (Some(BEFORE - 1), BEFORE));
    let copy = resumed(&engine, "saved-copy", saved);
    assert!(same_maps(&map, copy.map()).await, "at the checkpoint");
    assert_eq!(counts(&map), counts(copy.map()));

    let mut forgetful = state().await;
    // The moments of the means follow the means: four numbers of four bytes each.
    let row = 16 * forgetful.gaussians.len;
    forgetful.gaussians.bytes[row..3 * row].fill(0);
    let forgetful = resumed(&engine, "saved-without-moments", forgetful);
    let mut other = state().await;
    other.core.live.steps.earn();
    let other = resumed(&engine, "saved-with-more-steps", other);

    let all = BEFORE..BEFORE + AFTER;
    for sender in [&original, &copy, &forgetful, &other] {
        send(sender, all.clone()).await;
    }
    assert!(counts(&map)[2] > 2, "{:?}", counts(&map));
    let up = map.snapshot().await.up.unwrap();
    assert_eq!(up.source, UpSource::Gravity);
    // The first camera's axes are the room's.
    assert!(up.direction.angle(&-Vector3::y()).to_degrees() < 1.0, "{up:?}");
    assert_eq!(counts(&map), counts(copy.map()));
    assert!(same_maps(&map, copy.map()).await, "bit for bit");
    let (mine, its) = (map.save().await.unwrap(), copy.map().save().await.unwrap());
    assert!(mine.gaussians == its.gaussians, "the moments too");
    assert!(!same_maps(&map, forgetful.map()).await, "without moments");
    assert!(!same_maps(&map, other.map()).await, "with more steps");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_checkpoint_of_another_map_thread_is_refused_if_it_does_not_fit() {
    let engine = per_frame_engine();
    let sender = engine.open("saved-odd").unwrap().claim().unwrap();
    send(&sender, 0..2).await;
    let saved = || async { sender.map().save().await.unwrap() };
    engine.restore("saved-fits", saved().await).unwrap();
    let mut short = saved().await;
    short.gaussians.bytes.pop();
    assert!(engine.restore("saved-short", short).is_err());
    let mut other = saved().await;
    other.core.live.online.truncate(9);
    assert!(engine.restore("saved-other", other).is_err());
    assert!(engine.map("saved-short").is_err() && engine.map("saved-other").is_err());
}

/// Revision of the copy that the next reader would find, and of the map.
fn revisions(map: &Map) -> [u64; 2] {
    [map.copies().newest().revision, map.status().revision]
}

#[tokio::test(flavor = "multi_thread")]
async fn a_map_is_copied_for_those_who_read() {
    let engine = per_frame_engine();
    let (unread, read) = (engine.open("unread").unwrap(), engine.open("read").unwrap());
    let (quiet, busy) = (unread.claim().unwrap(), read.claim().unwrap());
    for sequence in 0..BEFORE {
        send(&quiet, sequence..sequence + 1).await;
        send(&busy, sequence..sequence + 1).await;
        let seen = read.snapshot().await;
        assert_eq!(seen.through, Some(sequence), "a reader sees each frame");
        assert_eq!(seen.trajectory.len() as u64, sequence + 1);
    }
    let [copied, told] = revisions(&unread);
    assert!(copied == 0 && told > 0, "nobody has read: {copied} {told}");
    assert_eq!(unread.status().gaussians, read.status().gaussians);
    assert!(unread.status().gaussians > 0 && unread.status().up.is_some(), "it is told of");
    // Who comes later gets the same map at once, and it does not depend on readers.
    let (late, seen) = (unread.snapshot().await, read.snapshot().await);
    assert!(same(&late, &seen) && late.through == Some(BEFORE - 1));
    assert_eq!(revisions(&unread), [told, told]);
    // Whoever has read gets one more copy without asking; then there is none again.
    for (sequence, is_copied) in [(BEFORE, true), (BEFORE + 1, false)] {
        send(&quiet, sequence..sequence + 1).await;
        let copied = unread.copies().newest().through == Some(sequence);
        assert_eq!(copied, is_copied, "frame {sequence}");
    }
    assert_eq!(unread.snapshot().await.through, Some(BEFORE + 1));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_map_that_fails_shows_its_last_state() {
    let engine = per_frame_engine();
    let map = engine.open("fails").unwrap();
    let sender = map.claim().unwrap();
    send(&sender, 0..BEFORE).await;
    let [copied, told] = revisions(&map);
    assert!(copied < told, "negative control: nobody has read");
    // Color ends early, which no frame does that was checked.
    let whole = frame(BEFORE);
    let broken = Frame { rgb: whole.rgb[..whole.rgb.len() - 3].into(), ..whole };
    assert!(map.submit(broken).await.unwrap().await.is_err(), "it is not mapped");
    let began = Instant::now();
    while map.failure().is_none() {
        assert!(began.elapsed() < PATIENCE, "{:?}", map.status());
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let last = map.snapshot().await;
    assert!(last.revision >= told && !last.gaussians.is_empty());
    assert_eq!(last.trajectory.len() as u64, BEFORE);
    assert!(map.claim().is_err() || map.submit(frame(BEFORE + 1)).await.is_err(), "no more frames");
}

/// Waits until the map has converged, as a reader does.
async fn converge(map: &Map) {
    let wait = Wait { settled: true, converged: true, min_sequence: None, longest: PATIENCE };
    assert!(map.read(&wait).await.converged, "{:?}", map.status());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_map_is_refined_when_a_reader_waits_for_it_and_stays_refined() {
    let engine = per_frame_engine();
    let map = engine.open("refined").unwrap();
    let sender = map.claim().unwrap();
    send(&sender, 0..BEFORE).await;
    assert_eq!(map.status().refinement, Refinement::Waiting, "nobody asked");
    let before = map.snapshot().await;
    let copy = resumed(&engine, "refined-copy", copied(map.save().await.unwrap()));
    for map in [&map, copy.map()] {
        converge(map).await;
        assert_eq!(map.status().refinement, Refinement::Converged);
    }
    let refined = map.snapshot().await;
    assert!(refined.gaussians != before.gaussians, "negative control");
    assert!(same(&refined, &*copy.map().snapshot().await), "bit for bit");
    let poses = |snapshot: &MapSnapshot| {
        snapshot.trajectory.iter().map(|frame| frame.world_from_camera).collect::<Vec<_>>()
    };
    assert_eq!(poses(&refined), poses(&before));

    // A restarted server has the refined map, and does not refine it again.
    let restarted = resumed(&engine, "refined-restarted", copied(map.save().await.unwrap()));
    assert_eq!(restarted.map().status().refinement, Refinement::Converged);
    converge(restarted.map()).await;
    assert!(same(&refined, &*restarted.map().snapshot().await), "as it was");
    // A new keyframe is another matter.
    send(&sender, BEFORE..BEFORE + AFTER).await;
    assert!(counts(&map)[2] > refined.keyframes.len() as u64, "{:?}", counts(&map));
    assert_eq!(map.status().refinement, Refinement::Waiting);
}
