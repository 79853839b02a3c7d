//! Recordings written here, whole and damaged. Those of outside programs are in `tests/service`.

use super::files::Files;
use super::look::Look;
use super::{mcap, rosbag2};
use crate::dataset::tests::mutations::{mutate, mutations};
use crate::dataset::{ColorFormat, Dataset, DatasetError, DepthFormat};
use crate::rig::Wanted;
use ::mcap::records::{MessageHeader, op};
use ::mcap::{Compression, WriteOptions};
use byteorder::LittleEndian;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

const IMAGE: &str = "sensor_msgs/msg/Image";
const INTERVAL: u64 = 33_000_000;
const FRAMES: u64 = 20;

struct Written {
    topic: &'static str,
    schema: &'static str,
    nanos: u64,
    data: Vec<u8>,
}

fn cdr(message: impl Serialize) -> Vec<u8> {
    let body = cdr_encoding::to_vec::<_, LittleEndian>(&message).unwrap();
    [&[0, 1, 0, 0], &body[..]].concat()
}

fn image(nanos: u64, encoding: &str, step: u32, value: u8) -> Vec<u8> {
    let header = stamp(nanos);
    cdr((header, 6_u32, 8_u32, encoding, 0_u8, step, &vec![value; 6 * step as usize][..]))
}

fn stamp(nanos: u64) -> ((i32, u32), &'static str) {
    (((nanos / 1_000_000_000) as i32, (nanos % 1_000_000_000) as u32), "camera")
}

/// A few frames of 8x6 pixels with poses; depth comes in another order than color.
fn messages() -> Vec<Written> {
    let mut all = Vec::new();
    for frame in 0..FRAMES {
        let nanos = 1_000_000_000 + frame * INTERVAL;
        let k = [9.0, 0.0, 3.5, 0.0, 9.0, 2.5, 0.0, 0.0, 1.0];
        let info = (stamp(nanos), 6_u32, 8_u32, "plumb_bob", [0.0; 0].to_vec());
        let region = (0_u32, 0_u32, 0_u32, 0_u32, false);
        let info = cdr((info, k, k, [0.0; 12], 0_u32, 0_u32, region));
        let pose = cdr((stamp(nanos), ([frame as f64, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])));
        let value = frame as u8 + 1;
        all.extend([
            (nanos, "/camera_info", "sensor_msgs/msg/CameraInfo", info),
            (nanos, "/pose", "geometry_msgs/msg/PoseStamped", pose),
            (nanos + 40_000_000, "/depth", IMAGE, image(nanos, "16UC1", 16, value)),
            (nanos, "/rgb", IMAGE, image(nanos, "rgb8", 24, value)),
            (nanos, "/scan", "sensor_msgs/msg/LaserScan", vec![0; 9]),
        ]);
    }
    all.sort_by_key(|(nanos, ..)| *nanos);
    let written = |(nanos, topic, schema, data)| Written { topic, schema, nanos, data };
    all.into_iter().map(written).collect()
}

fn mcap_bytes(messages: &[Written], options: WriteOptions) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = options.create(&mut bytes).unwrap();
    for (sequence, Written { topic, schema, nanos, data }) in (0..).zip(messages) {
        let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
        let channel_id = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap();
        let (log_time, publish_time) = (*nanos, *nanos);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

/// Where the records of a file begin, and their codes and lengths.
fn records(bytes: &[u8]) -> Vec<(usize, u8, usize)> {
    let (mut at, mut found) = (8, Vec::new());
    while at + 9 < bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        found.push((at, bytes[at], length));
        at += 9 + length;
    }
    found
}

/// Chunks of a few frames.
fn chunked(compression: Option<Compression>) -> WriteOptions {
    WriteOptions::new().compression(compression).chunk_size(Some(2000))
}

fn sqlite(path: &Path, messages: &[Written]) {
    let connection = rusqlite::Connection::open(path).unwrap();
    connection
        .execute_batch(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, \
             serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL); \
             CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, \
             timestamp INTEGER NOT NULL, data BLOB NOT NULL);",
        )
        .unwrap();
    let mut ids = BTreeMap::new();
    for Written { topic, schema, nanos, data } in messages {
        let next = ids.len() as i64 + 1;
        let id = *ids.entry(topic).or_insert(next);
        connection
            .execute(
                "INSERT OR IGNORE INTO topics VALUES (?1, ?2, ?3, 'cdr', '')",
                (id, topic, schema),
            )
            .unwrap();
        connection
            .execute(
                "INSERT INTO messages(topic_id, timestamp, data) VALUES (?1, ?2, ?3)",
                (id, *nanos as i64, data),
            )
            .unwrap();
    }
}

type Opened = Result<Box<dyn Dataset>, DatasetError>;

fn open(path: &Path) -> Opened {
    mcap(path, &Wanted::default())
}

fn written(bytes: &[u8]) -> (tempfile::TempDir, Opened) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("kitchen.mcap");
    std::fs::write(&path, bytes).unwrap();
    let opened = open(&path);
    (folder, opened)
}

fn check_frames(dataset: &dyn Dataset, first: u64, count: usize) {
    assert_eq!((dataset.len(), dataset.name()), (count, "kitchen"));
    for index in [0, count - 1, count / 2] {
        let frame = dataset.frame(index).unwrap();
        let number = first + index as u64;
        assert_eq!(frame.sequence, index as u64);
        assert_eq!(frame.timestamp_nanos, 1_000_000_000 + number * INTERVAL);
        assert_eq!(frame.color.format, ColorFormat::Rgb8);
        assert_eq!(frame.color.bytes, vec![number as u8 + 1; 8 * 6 * 3]);
        assert_eq!(frame.depth.format, DepthFormat::U16);
        assert_eq!(frame.depth.bytes, vec![number as u8 + 1; 8 * 6 * 2]);
        let pose = frame.world_from_camera.unwrap();
        assert_eq!(pose.translation.x, number as f64);
        assert_eq!(dataset.moment(index).unwrap().world_from_camera, Some(pose));
    }
}

#[test]
fn every_kind_of_file_gives_the_same_frames() {
    let all = messages();
    let options = [
        chunked(None),
        chunked(Some(Compression::Zstd)),
        chunked(Some(Compression::Lz4)),
        WriteOptions::new().use_chunks(false),
    ];
    for options in options {
        let (_folder, opened) = written(&mcap_bytes(&all, options));
        let dataset = opened.unwrap();
        check_frames(&*dataset, 0, FRAMES as usize);
        assert!(dataset.skipped().is_empty());
        assert!(!dataset.notes().iter().any(|note| note.contains("byte")), "{:?}", dataset.notes());
    }
    for compressed in [false, true] {
        let zstd = |message: &Written| zstd::encode_all(&message.data[..], 1).unwrap();
        let all: Vec<Written> = match compressed {
            false => messages(),
            true => messages().into_iter().map(|m| Written { data: zstd(&m), ..m }).collect(),
        };
        let (_kept, opened) = written(&mcap_bytes(&all, chunked(None)));
        check_frames(&*opened.unwrap(), 0, FRAMES as usize);
        let folder = tempfile::tempdir().unwrap();
        let bag = folder.path().join("kitchen");
        std::fs::create_dir(&bag).unwrap();
        sqlite(&bag.join("kitchen_0.db3"), &all);
        check_frames(&*rosbag2(&bag, &Wanted::default()).unwrap(), 0, FRAMES as usize);
        let file = folder.path().join("kitchen.db3");
        std::fs::copy(bag.join("kitchen_0.db3"), &file).unwrap();
        check_frames(&*rosbag2(&file, &Wanted::default()).unwrap(), 0, FRAMES as usize);
    }
}

#[test]
fn the_files_of_a_folder_follow_each_other() {
    let (all, folder) = (messages(), tempfile::tempdir().unwrap());
    let bag = folder.path().join("kitchen");
    std::fs::create_dir(&bag).unwrap();
    for (number, part) in all.chunks(all.len() / 11).enumerate() {
        let bytes = mcap_bytes(part, chunked(None));
        std::fs::write(bag.join(format!("kitchen_{number}.mcap")), bytes).unwrap();
    }
    check_frames(&*open(&bag).unwrap(), 0, FRAMES as usize);
    std::fs::write(bag.join("kitchen_99.mcap"), "").unwrap();
    let dataset = rosbag2(&bag, &Wanted::default()).unwrap();
    check_frames(&*dataset, 0, FRAMES as usize);
    let notes = dataset.notes().join("\n");
    assert!(notes.contains("kitchen_99.mcap: expected an MCAP file"), "{notes}");
}

#[test]
fn a_file_that_was_cut_off_is_read_as_far_as_it_goes() {
    let all = messages();
    let whole = mcap_bytes(&all, chunked(Some(Compression::Zstd)));
    let end = records(&whole).into_iter().find(|found| found.1 == op::DATA_END).unwrap();
    let unfinished = &whole[..end.0];
    let (_folder, opened) = written(unfinished);
    let dataset = opened.unwrap();
    check_frames(&*dataset, 0, FRAMES as usize);
    let notes = dataset.notes().join("\n");
    assert!(notes.contains("it was not closed"), "{notes}");

    let (_folder, opened) = written(&unfinished[..unfinished.len() * 2 / 3]);
    let dataset = opened.unwrap();
    assert!((5..FRAMES as usize).contains(&dataset.len()), "{}", dataset.len());
    let notes = dataset.notes().join("\n");
    assert!(notes.contains("it is cut off or damaged here"), "{notes}");
    // Nothing but the beginning, and no beginning.
    for (bytes, expected) in [
        (&unfinished[..8], "found no topic that can be read"),
        (&unfinished[..3], "expected an MCAP file"),
    ] {
        let error = written(bytes).1.err().unwrap().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn a_damaged_chunk_is_left_out_and_told_of() {
    let whole = mcap_bytes(&messages(), chunked(Some(Compression::Zstd)));
    let chunks: Vec<_> = records(&whole).into_iter().filter(|found| found.1 == op::CHUNK).collect();
    let (at, _, length) = chunks[1];
    let mut damaged = whole.clone();
    damaged[at + length - 9] ^= 0x40;
    let (_folder, opened) = written(&damaged);
    let dataset = opened.unwrap();
    let notes = dataset.notes().join("\n");
    assert!(notes.contains(&format!("byte {at} of {}: left out: ", whole.len())), "{notes}");
    assert!((1..FRAMES as usize).contains(&dataset.len()), "{}", dataset.len());
    assert!((0..dataset.len()).all(|at| dataset.frame(at).is_ok()));
}

#[test]
fn what_would_fill_the_memory_is_left_out_and_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("kitchen.mcap");
    std::fs::write(&path, mcap_bytes(&messages(), chunked(None))).unwrap();
    let files = Files::mcap(&path).unwrap();
    let pictures = |look: &Look| look.pictures["/rgb"].len();
    let whole = Look::through(&files).unwrap();
    assert_eq!((pictures(&whole), whole.problems), (FRAMES as usize, Vec::new()));
    let part = Look::up_to(&files, 5000).unwrap();
    assert!((1..FRAMES as usize).contains(&pictures(&part)), "{}", pictures(&part));
    assert!(part.problems[0].contains("left out: split the recording"), "{:?}", part.problems);
}

#[test]
fn damaged_messages_and_pictures_without_depth_are_told_of() {
    let mut all = messages();
    let mut colors: Vec<&mut Written> = all.iter_mut().filter(|m| m.topic == "/rgb").collect();
    colors[4].data.truncate(20);
    let number = all.iter().position(|m| m.topic == "/depth").unwrap();
    all.remove(number);
    all.iter_mut().filter(|m| m.topic == "/pose").for_each(|m| m.data.truncate(30));
    let (_folder, opened) = written(&mcap_bytes(&all, chunked(None)));
    let dataset = opened.unwrap();
    assert_eq!(dataset.len(), FRAMES as usize - 2);
    assert!(dataset.skipped()[0].starts_with("/rgb: picture 0: expected depth at most 18 ms away"));
    let notes = dataset.notes().join("\n");
    assert!(
        notes.contains("/rgb: 1 messages are left out, the first: expected a sensor_msgs"),
        "{notes}"
    );
    assert!(notes.contains("/pose: 20 messages are left out"), "{notes}");
    assert!(dataset.no_pose(0).unwrap().contains("no transforms place camera"));
}

#[test]
fn what_cannot_be_used_is_told() {
    // Clocks that do not agree.
    let mut apart = messages();
    apart.retain(|message| message.topic != "/depth");
    for frame in 0..FRAMES {
        let nanos = 9_000_000_000 + frame * INTERVAL;
        let data = image(nanos, "16UC1", 16, 1);
        apart.push(Written { topic: "/depth", schema: IMAGE, nanos, data });
        let (topic, schema) = ("/video", "foxglove_msgs/msg/CompressedVideo");
        apart.push(Written { topic, schema, nanos, data: vec![0; 9] });
    }
    let (_kept, opened) = written(&mcap_bytes(&apart, chunked(None)));
    let error = opened.err().unwrap().to_string();
    assert!(error.contains("away, found none (the nearest is 7.373 s away)"), "{error}");
    apart.extend(messages().into_iter().filter(|message| message.topic == "/depth"));
    let (_kept, opened) = written(&mcap_bytes(&apart, chunked(None)));
    let notes = opened.unwrap().notes().join("\n");
    assert!(
        notes.contains("not read: /video (foxglove_msgs/msg/CompressedVideo in cdr)"),
        "{notes}"
    );

    let folder = tempfile::tempdir().unwrap();
    let scans: Vec<Written> = messages().into_iter().filter(|m| m.topic == "/scan").collect();
    let (_kept, opened) = written(&mcap_bytes(&scans, chunked(None)));
    let error = opened.err().unwrap().to_string();
    assert!(error.contains("not read: /scan (sensor_msgs/msg/LaserScan in cdr)"), "{error}");

    let bag = folder.path().join("bag");
    std::fs::create_dir(&bag).unwrap();
    let error = |path: &Path| rosbag2(path, &Wanted::default()).err().unwrap().to_string();
    assert!(error(&bag).contains("expected .db3 or .mcap files, found none"));
    std::fs::write(bag.join("bag_0.db3.zstd"), "").unwrap();
    assert!(error(&bag).contains("decompress each (zstd -d"), "{}", error(&bag));
    std::fs::write(bag.join("bag_0.db3"), "no database at all, but long enough to have a header")
        .unwrap();
    assert!(error(&bag).contains("expected a SQLite file of rosbag2"), "{}", error(&bag));
    assert!(error(&folder.path().join("missing")).starts_with("cannot read"));
}

#[test]
fn a_view_without_end_is_no_table_of_messages() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("endless.db3");
    sqlite(&path, &messages());
    rosbag2(&path, &Wanted::default()).expect("negative control");
    let endless = "ALTER TABLE messages RENAME TO others; CREATE VIEW messages AS \
                   WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) \
                   SELECT i AS id, 1 AS topic_id, i AS timestamp, x'00' AS data FROM n;";
    rusqlite::Connection::open(&path).unwrap().execute_batch(endless).unwrap();
    let error = rosbag2(&path, &Wanted::default()).err().unwrap().to_string();
    assert!(
        error.ends_with("expected a bag of rosbag2 with a table messages, found CREATE VIEW"),
        "{error}"
    );
    let none = "DROP VIEW messages";
    rusqlite::Connection::open(&path).unwrap().execute_batch(none).unwrap();
    let error = rosbag2(&path, &Wanted::default()).err().unwrap().to_string();
    assert!(error.ends_with("with a table messages, found none"), "{error}");
}

#[test]
fn damaged_recordings_are_read_or_refused() {
    let all = messages();
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("a.db3");
    sqlite(&database, &all);
    let files = [
        ("mcap", mcap_bytes(&all, chunked(Some(Compression::Zstd)))),
        ("mcap", mcap_bytes(&all, chunked(None))),
        ("mcap", mcap_bytes(&all, WriteOptions::new().use_chunks(false))),
        ("db3", std::fs::read(&database).unwrap()),
    ];
    let mut random = ChaCha8Rng::seed_from_u64(24);
    let (mut read, mut refused) = (0, 0);
    for number in 0..mutations(400) {
        let (kind, whole) = &files[number as usize % files.len()];
        let mut bytes = whole.clone();
        mutate(&mut random, &mut bytes);
        let path = folder.path().join(format!("b.{kind}"));
        std::fs::write(&path, bytes).unwrap();
        match rosbag2(&path, &Wanted::default()) {
            Ok(dataset) => {
                let is_readable = (0..dataset.len()).all(|at| dataset.frame(at).is_ok());
                (read, refused) =
                    (read + u64::from(is_readable), refused + u64::from(!is_readable));
            }
            Err(_) => refused += 1,
        }
    }
    println!("{read} were read, {refused} were refused");
    assert!(read > 20 && refused > 5, "{read} {refused}");
}
