//! What keyframes are said to take is what the process takes, and what deleted maps and readers took is free.

use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_proto::v1::{self, frame_message::Message};
use lexsplat_tests::ServerProcess;
use serde_json::Value;
use std::time::Duration;

const WIDTH: u32 = 600;
const HEIGHT: u32 = 340;
const PIXELS: usize = (WIDTH * HEIGHT) as usize;
/// Keyframes before memory is looked at: buffers and the driver's caches have their size by then. As many
/// come at once as later, so that as many frames wait in the server.
const WARM_UP: u64 = 30;
/// Keyframes between the two looks.
const MEASURED: u64 = 30;
/// Most difference of a keyframe between growth of the process and what is reported, bytes: 0.2 MB were
/// measured, and up to 1.1 with fewer keyframes before.
const TOLERANCE_BYTES: u64 = 1_200_000;
/// A keyframe's colors and depth: 7 bytes a pixel.
const PICTURE_BYTES: u64 = 7 * PIXELS as u64;
/// The most that a keyframe may take.
const MOST_BYTES: u64 = 4_000_000;

/// The message that opens the map: given poses, one label.
fn open() -> v1::FrameMessage {
    let open = v1::OpenMap {
        map: "wall".into(),
        intrinsics: Some(v1::Intrinsics {
            width: WIDTH,
            height: HEIGHT,
            fx: 500.0,
            fy: 500.0,
            cx: 299.5,
            cy: 169.5,
        }),
        depth_unit_metres: 0.001,
        pose_source: v1::PoseSource::Given.into(),
        label_texts: vec!["wall".into()],
        ..v1::OpenMap::default()
    };
    v1::FrameMessage { message: Some(Message::Open(open)) }
}

/// A colored wall 2 m away, so far beside the last frame's that each frame becomes a keyframe.
fn frame(sequence: u64) -> v1::FrameMessage {
    let rgb: Vec<u8> = (0..3 * PIXELS).map(|at| (at * 7 + at / 600 * 13) as u8).collect();
    let frame = v1::Frame {
        sequence,
        timestamp_nanos: sequence * 33_333_333,
        color_format: v1::ColorFormat::Rgb8.into(),
        color: rgb.into(),
        depth_format: v1::DepthFormat::F32Metres.into(),
        depth: 2.0_f32.to_le_bytes().repeat(PIXELS).into(),
        label_format: v1::LabelFormat::U16.into(),
        labels: 1_u16.to_le_bytes().repeat(PIXELS).into(),
        world_from_camera: Some(v1::Pose {
            rotation: Some(v1::Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 }),
            translation_metres: Some(v1::Vector3 { x: 3.0 * sequence as f64, y: 0.0, z: 0.0 }),
        }),
        ..v1::Frame::default()
    };
    v1::FrameMessage { message: Some(Message::Frame(frame)) }
}

/// Streams frames and waits until the map is settled; returns its status.
async fn walk(server: &ServerProcess, sequences: std::ops::Range<u64>) -> Value {
    let end = sequences.end;
    let mut client =
        MappingClient::connect(format!("http://{}", server.grpc)).await.expect("it listens");
    let messages = std::iter::once(open()).chain(sequences.map(frame));
    let acks = client.stream_frames(tokio_stream::iter(messages)).await.expect("it opens");
    let mut acks = acks.into_inner();
    while let Some(ack) = acks.message().await.expect("the stream ends well") {
        assert!(ack.refused_field.is_empty(), "{ack:?}");
    }
    for _ in 0..600 {
        let url = format!("http://{}/v1/maps/wall", server.http);
        let status = reqwest::get(url).await.expect("it answers").json::<Value>().await;
        let status = status.expect("with JSON");
        if status["settled"] == true && status["frames_tracked"] == end {
            assert_eq!(status["keyframes"], end, "every frame is a keyframe");
            return status;
        }
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
    panic!("the map does not settle");
}

/// Bytes that the status reports.
fn reported(status: &Value) -> u64 {
    let bytes = |key: &str| status[key].as_u64().expect("a number of bytes");
    bytes("keyframe_bytes") + bytes("gpu_bytes")
}

fn agrees(process: u64, reported: u64) -> bool {
    process.abs_diff(reported) <= MEASURED * TOLERANCE_BYTES
}

#[tokio::test(flavor = "multi_thread")]
async fn memory_grows_by_what_keyframes_report() {
    let server = ServerProcess::start(&[
        ("MALLOC_ARENA_MAX", "2"),
        // Few Gaussians and steps: only keyframes grow.
        ("LEXSPLAT__MAPPER__MAX_GAUSSIANS", "1000"),
        ("LEXSPLAT__MAPPER__STEPS_PER_KEYFRAME", "1"),
        ("LEXSPLAT__MAPPER__MAX_KEYFRAME_MIB", "4096"),
        ("LEXSPLAT__MAPPER__TRAIN_WIDTH", "600"),
    ]);
    let before = walk(&server, 0..WARM_UP).await;
    let resident_before = server.resident_bytes();
    let after = walk(&server, WARM_UP..WARM_UP + MEASURED).await;
    let process = server.resident_bytes().saturating_sub(resident_before);
    let reported = reported(&after) - reported(&before);
    let each = |bytes: u64| bytes as f64 / MEASURED as f64 / 1e6;
    println!("a keyframe: process {:.2} MB, reported {:.2} MB", each(process), each(reported));
    assert!(agrees(process, reported), "process {process} bytes, reported {reported}");
    assert!(process < MEASURED * MOST_BYTES, "{process} bytes");
    // Negative controls: a count without pictures, or of them twice, is found out.
    assert!(!agrees(process, reported - MEASURED * PICTURE_BYTES), "pictures count");
    assert!(!agrees(process + 2 * MEASURED * PICTURE_BYTES, reported), "and once");
}

/// Maps without frames, one after the other. Before, each left 40 MB.
#[tokio::test(flavor = "multi_thread")]
async fn deleted_maps_leave_nothing() {
    const MOST_LEFT_BYTES: u64 = 20 << 20;
    let server = ServerProcess::start(&[("MALLOC_ARENA_MAX", "2")]);
    let http = reqwest::Client::new();
    let maps = format!("http://{}/v1/maps", server.http);
    let cycles = async |count: u64| {
        for _ in 0..count {
            let made = http.post(&maps).json(&serde_json::json!({"name": "short"})).send().await;
            assert_eq!(made.expect("it answers").status(), 201);
            let deleted = http.delete(format!("{maps}/short")).send().await;
            assert_eq!(deleted.expect("it answers").status(), 204);
        }
        server.resident_bytes()
    };
    let before = cycles(3).await;
    let left = cycles(4).await.saturating_sub(before);
    println!("a deleted map leaves {:.2} MB", left as f64 / 4e6);
    assert!(left < 4 * MOST_LEFT_BYTES, "{left} bytes");
}

/// A reader that comes, asks for this and that, and goes.
async fn read(server: &ServerProcess, reader: u64) {
    let http = reqwest::Client::new();
    let map = format!("http://{}/v1/maps/wall", server.http);
    let question = serde_json::json!({"text": format!("thing {reader}"), "outputs": ["points"]});
    let view = serde_json::json!({"frame": reader % WARM_UP});
    let asked = [
        http.post(format!("{map}/query")).json(&question),
        http.post(format!("{map}/render")).json(&view),
        http.get(format!("{map}/export/points.ply")),
        http.get(format!("{map}/trajectory")),
    ];
    for request in asked {
        let reply = request.send().await.expect("it answers");
        assert_eq!(reply.status(), 200, "{reply:?}");
        reply.bytes().await.expect("the whole answer");
    }
}

/// A hundred readers, each with a question, a view and connections of its own.
#[tokio::test(flavor = "multi_thread")]
async fn readers_that_come_and_go_leave_nothing() {
    const READERS: u64 = 100;
    const MOST_LEFT_BYTES: u64 = 20 << 20;
    let server = ServerProcess::start(&[
        ("MALLOC_ARENA_MAX", "2"),
        ("LEXSPLAT__MAPPER__STEPS_PER_KEYFRAME", "1"),
        // Few of the answers fit: after the first readers each new one takes the place of another.
        ("LEXSPLAT__HTTP__RECENT_ANSWERS", "8"),
        ("LEXSPLAT__QUERY__CACHED_TEXTS", "16"),
    ]);
    walk(&server, 0..WARM_UP).await;
    let unread = server.resident_bytes();
    for reader in 0..READERS / 4 {
        read(&server, reader).await;
    }
    let before = server.resident_bytes();
    for reader in READERS / 4..READERS {
        read(&server, reader).await;
    }
    let left = server.resident_bytes().saturating_sub(before);
    let [first, left_mb] = [before.saturating_sub(unread), left].map(|bytes| bytes as f64 / 1e6);
    println!("{first:.1} MB for the first readers, {left_mb:.1} MB for three times as many later");
    assert!(left < MOST_LEFT_BYTES, "{left} bytes");
}
