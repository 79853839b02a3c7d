//! A sender that is faster than the mapper waits; one that does not listen holds up nobody else.

use lexsplat_proto::v1::{self, frame_message::Message};
use lexsplat_tests::{Robot, Server, raw, tiny_config};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use tokio_stream::StreamExt as _;
use tokio_stream::wrappers::ReceiverStream;

const FRAMES: usize = 48;
/// What the transport may hold besides the server's queue: the flow-control window (4 MiB) over a
/// raw frame (0.54 MB), and a few in hand on either side.
const IN_TRANSPORT: usize = 16;

#[tokio::test(flavor = "multi_thread")]
async fn a_fast_sender_waits_and_nothing_is_dropped() {
    let mut config = tiny_config();
    config.mapper.queue_frames = 2;
    config.mapper.steps_per_frame = 2;
    let server = Server::start(config).await;
    let robot = Robot::new(3, FRAMES);
    let sent = Arc::new(AtomicUsize::new(0));
    let (messages, outgoing) = tokio::sync::mpsc::channel(1);
    let counter = sent.clone();
    let opening = robot.open("backpressure");
    let frames: Vec<_> = (0..FRAMES).map(|at| raw(&robot, at)).collect();
    tokio::spawn(async move {
        messages.send(opening).await.expect("the stream is open");
        for frame in frames {
            let message = v1::FrameMessage { message: Some(Message::Frame(frame)) };
            messages.send(message).await.expect("the stream is open");
            counter.fetch_add(1, Ordering::SeqCst);
        }
    });
    let mut client = server.client().await;
    let mut acks = client
        .stream_frames(ReceiverStream::new(outgoing))
        .await
        .expect("the stream opens")
        .into_inner();
    let (mut tracked, mut ahead, mut deepest) = (0, 0, 0);
    while let Some(ack) = acks.next().await {
        let ack = ack.expect("no ack is an error");
        if ack.status() == v1::FrameStatus::Tracked {
            tracked += 1;
            ahead = ahead.max(sent.load(Ordering::SeqCst) - tracked);
            deepest = deepest.max(ack.queue_depth);
            assert!(ack.queue_depth <= ack.queue_capacity, "{ack:?}");
        }
    }
    assert_eq!(tracked, FRAMES, "every frame is tracked");
    assert!(deepest >= 1, "the queue was never seen with a frame in it: nothing was tested");
    assert!(ahead <= IN_TRANSPORT, "the sender was {ahead} frames ahead: it did not wait");
    let status = server.engine.map("backpressure").expect("it is there").status();
    assert_eq!((status.frames_tracked, status.frames_dropped), (FRAMES as u64, 0));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_sender_that_does_not_read_its_acks_holds_up_nobody() {
    let mut config = tiny_config();
    config.ingest.ack_backlog = 2;
    let server = Server::start(config).await;
    let robot = Robot::new(3, 24);
    let (messages, outgoing) = tokio::sync::mpsc::channel(1);
    messages.send(robot.open("deaf")).await.expect("the stream is open");
    let mut deaf = server.client().await;
    let unread = deaf.stream_frames(ReceiverStream::new(outgoing)).await.expect("it opens");
    let opening = robot.open("deaf");
    let sending = tokio::spawn(async move {
        // Until the channel closes: the server stops reading it long before.
        for at in 0.. {
            let mut frame = raw(&robot, at % 24);
            frame.sequence = at as u64;
            let message = v1::FrameMessage { message: Some(Message::Frame(frame)) };
            if messages.send(message).await.is_err() {
                return;
            }
        }
    });
    let other = Robot::new(4, 8);
    let acks = tokio::time::timeout(Duration::from_secs(120), server.stream(&other, "other"))
        .await
        .expect("the other robot is not held up");
    assert_eq!(acks.iter().filter(|ack| ack.status() == v1::FrameStatus::Tracked).count(), 8);
    let mut second = server.client().await;
    let busy = second.stream_frames(tokio_stream::iter([opening.clone()])).await;
    assert!(lexsplat_tests::first_error(busy).await.is_some(), "one sender at a time");
    drop(unread);
    drop(deaf);
    sending.abort();
    // The dropped connection gives the place back.
    for attempt in 0.. {
        let again =
            server.client().await.stream_frames(tokio_stream::iter([opening.clone()])).await;
        if lexsplat_tests::first_error(again).await.is_none() {
            break;
        }
        assert!(attempt < 100, "the place was never given back");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    server.stop().await;
}
