//! A server that is told to stop in the middle of a stream finishes what it has in hand.

use lexsplat_proto::v1::{FrameStatus, frame_message::Message};
use lexsplat_tests::{Robot, Server, tiny_config};
use std::time::Duration;
use tokio_stream::StreamExt as _;
use tokio_stream::wrappers::ReceiverStream;

#[tokio::test(flavor = "multi_thread")]
async fn frames_in_hand_are_finished() {
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(3, 30);
    let (messages, outgoing) = tokio::sync::mpsc::channel(1);
    let opening = robot.open("half-way");
    let frames: Vec<_> = (0..30).map(|at| robot.frame(at)).collect();
    tokio::spawn(async move {
        // Sending fails once the server has stopped reading: that is what is tested.
        let _ = messages.send(opening).await;
        for frame in frames {
            let message = lexsplat_proto::v1::FrameMessage { message: Some(Message::Frame(frame)) };
            if messages.send(message).await.is_err() {
                return;
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        // The stream stays open: only the server ends it.
        std::future::pending::<()>().await;
    });
    let mut client = server.client().await;
    let mut acks =
        client.stream_frames(ReceiverStream::new(outgoing)).await.expect("it opens").into_inner();
    let opened = acks.next().await.expect("the stream is open").expect("and opens the map");
    assert_eq!(opened.status(), FrameStatus::Opened);
    let map = server.engine.map("half-way").expect("opening the stream makes the map");
    let mut stop = None;
    let mut server = Some(server);
    let mut acknowledged = 0;
    while let Some(ack) = acks.next().await {
        // When the server stops, the stream may end with an error that says so.
        let Ok(ack) = ack else { break };
        acknowledged += u64::from(ack.status() == FrameStatus::Tracked);
        if acknowledged == 3 && stop.is_none() {
            let server = server.take().expect("it is stopped once");
            stop = Some(tokio::spawn(server.stop()));
        }
    }
    let stopped = stop.expect("three frames were acknowledged");
    tokio::time::timeout(Duration::from_secs(60), stopped)
        .await
        .expect("the server stops within its time")
        .expect("and without a panic");
    let status = map.status();
    assert_eq!(status.frames_tracked, status.frames_received, "what was received was mapped");
    assert_eq!(status.frames_tracked, acknowledged, "and acknowledged");
    assert_eq!(
        map.snapshot().await.trajectory.len() as u64,
        acknowledged,
        "and is in the last snapshot"
    );
}
