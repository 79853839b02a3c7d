//! Questions, pictures and a mesh while a robot maps: nothing of them makes a frame be refused or lost.

use lexsplat_proto::v1::{FrameMessage, FrameStatus, frame_message::Message};
use lexsplat_tests::{Robot, Server, tiny_config};
use serde_json::json;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio_stream::StreamExt as _;
use tokio_stream::wrappers::ReceiverStream;

const FRAMES: usize = 36;
/// People who ask one question after the other.
const ASKERS: usize = 3;

/// One question after the other, of four kinds in turn, for as long as it goes on.
async fn ask(base: String, asker: usize, going: Arc<AtomicBool>, answered: Arc<AtomicUsize>) {
    let http = reqwest::Client::new();
    let mut number = asker;
    while going.load(Ordering::SeqCst) {
        let query = http.post(format!("{base}/query"));
        let request = match number % 4 {
            0 => query.json(&json!({"text": "chair"})),
            1 => query.json(&json!({"text": "lamp", "view": {"frame": number % 18}})),
            2 => http.get(format!("{base}/render?frame={}", number % 18)),
            _ => query.json(&json!({"texts": ["a", "b"]})),
        };
        let reply = request.send().await.expect("the server answers");
        let is_answer = reply.status().is_success();
        assert!(is_answer, "{}", reply.text().await.unwrap_or_default());
        answered.fetch_add(1, Ordering::SeqCst);
        number += ASKERS;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn questions_while_mapping_cost_no_frame() {
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(6, FRAMES);
    // Something to ask about.
    let mut messages = robot.messages("busy");
    let later = messages.split_off(1 + FRAMES / 2);
    let opening = messages[0].clone();
    assert_eq!(server.send(messages).await.expect("the stream ends well").len(), 1 + FRAMES / 2);
    server.settled("busy").await;

    let (going, answered) = (Arc::new(AtomicBool::new(true)), Arc::new(AtomicUsize::new(0)));
    let asking: Vec<_> = (0..ASKERS)
        .map(|asker| {
            let base = server.url("/v1/maps/busy");
            let (going, answered) = (going.clone(), answered.clone());
            tokio::spawn(ask(base, asker, going, answered))
        })
        .collect();
    let mesh =
        tokio::spawn(reqwest::get(server.url("/v1/maps/busy/export/mesh.ply?voxel_metres=0.05")));

    // One frame is spoilt, so that a refusal would be seen.
    let mut spoilt = robot.frame(FRAMES - 1);
    spoilt.sequence = FRAMES as u64;
    spoilt.color.clear();
    let spoilt = FrameMessage { message: Some(Message::Frame(spoilt)) };
    // A frame for each answer, so that the two really go on side by side.
    let (frames, outgoing) = mpsc::channel(1);
    let counter = answered.clone();
    tokio::spawn(async move {
        frames.send(opening).await.expect("the stream is open");
        for (at, message) in later.into_iter().chain([spoilt]).enumerate() {
            while counter.load(Ordering::SeqCst) < at {
                tokio::time::sleep(Duration::from_millis(2)).await;
            }
            frames.send(message).await.expect("the stream is open");
        }
    });
    let acks = server.client().await.stream_frames(ReceiverStream::new(outgoing)).await;
    let acks = acks.expect("the stream opens").into_inner().collect::<Result<Vec<_>, _>>().await;
    let acks = acks.expect("no ack is an error");
    let with = |status| acks.iter().filter(|ack| ack.status() == status).count();
    assert_eq!(with(FrameStatus::Tracked), FRAMES - FRAMES / 2, "{acks:?}");
    assert_eq!(with(FrameStatus::Refused), 1, "the spoilt one and no other");
    let during = answered.load(Ordering::SeqCst);
    assert!(during >= FRAMES - FRAMES / 2, "{during} answers while frames came: too few to test");

    going.store(false, Ordering::SeqCst);
    for asker in asking {
        asker.await.expect("every question was answered");
    }
    let mesh = mesh.await.expect("it does not panic").expect("the server answers");
    assert!(mesh.status().is_success(), "{}", mesh.text().await.unwrap_or_default());
    let status = server.engine.map("busy").expect("it is there").status();
    assert_eq!((status.frames_tracked, status.frames_dropped), (FRAMES as u64, 0));
    assert_eq!((status.frames_refused, status.frames_lost), (1, 0));
    println!("{during} answers while {} frames were mapped", FRAMES - FRAMES / 2);
    server.stop().await;
}
