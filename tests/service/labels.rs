//! A robot that says itself what it sees: its labels' words find things, exchanged words do not, and a
//! map that is rebuilt from its log knows the same.

use lexsplat_proto::v1::{self, frame_message::Message};
use lexsplat_server::pipeline::snapshot::MapSnapshot;
use lexsplat_tests::{Robot, Server, first_error, tiny_config};
use std::collections::BTreeSet;
use std::sync::Arc;

const FRAMES: usize = 24;
/// A class counts if some keyframe shows it with at least this many pixels.
const VISIBLE_PIXELS: usize = 700;

/// Classes and the keyframe that shows each best.
fn visible(robot: &Robot, keyframes: &[usize]) -> Vec<(&'static str, usize)> {
    let classes: BTreeSet<_> = robot.room.instances().iter().map(|thing| thing.class).collect();
    let best = |class| {
        let best = keyframes.iter().max_by_key(|at| robot.pixels_of(**at, class))?;
        (robot.pixels_of(*best, class) >= VISIBLE_PIXELS).then_some((class, *best))
    };
    classes.into_iter().filter_map(best).collect()
}

/// The same labels, and each stands for another class's name.
fn exchanged(mut messages: Vec<v1::FrameMessage>) -> Vec<v1::FrameMessage> {
    for message in &mut messages {
        if let Some(Message::Open(open)) = &mut message.message {
            let classes: Vec<String> =
                BTreeSet::from_iter(open.label_texts.iter().cloned()).into_iter().collect();
            for text in &mut open.label_texts {
                let at = classes.iter().position(|class| class == text).expect("it is one of them");
                text.clone_from(&classes[(at + 1) % classes.len()]);
            }
        }
    }
    messages
}

#[tokio::test(flavor = "multi_thread")]
async fn labels_are_the_language_of_their_pixels_and_survive_a_restart() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut config = tiny_config();
    config.server.data_dir = Some(folder.path().to_owned());
    let robot = Robot::new(8, FRAMES);
    let server = Server::start(config.clone()).await;
    let acks = server.send(robot.labelled_messages("said")).await.expect("the stream ends well");
    server.send(exchanged(robot.labelled_messages("confused"))).await.expect("it ends well");
    server.settled("said").await;
    server.settled("confused").await;
    let keyframes: Vec<usize> =
        acks.iter().filter(|ack| ack.keyframe).map(|ack| ack.sequence as usize).collect();
    let things = visible(&robot, &keyframes);
    assert!(things.len() >= 5, "too little is visible to say anything: {things:?}");
    let said = snapshot(&server, "said").await;
    let right = server.found(&robot, &said, &things).await.len();
    let confused = server.found(&robot, &snapshot(&server, "confused").await, &things).await.len();
    println!("found {right} of {}, with exchanged words {confused}", things.len());
    assert!(right >= things.len() - 1, "{right} of {things:?}");
    assert!(confused <= things.len() / 4, "{confused} of {things:?}");
    server.stop().await;

    // What is in the recording makes the same map: labels included.
    let checkpoint = folder.path().join("said.map/checkpoint-0001.lexsplat");
    std::fs::remove_file(checkpoint).expect("stopping wrote one");
    let server = Server::start(config).await;
    let known =
        server.client().await.list_maps(v1::ListMapsRequest::default()).await.expect("it answers");
    assert_eq!(known.into_inner().maps.len(), 2);
    server.loaded("said").await;
    server.settled("said").await;
    let again = snapshot(&server, "said").await;
    assert_eq!(again.keyframes.len(), said.keyframes.len());
    assert!(again.keyframes.iter().all(|keyframe| keyframe.has_language));
    let rebuilt = server.found(&robot, &again, &things).await.len();
    assert!(rebuilt >= things.len() - 1, "{rebuilt} of {things:?} after a restart");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn labels_without_words_and_endless_words_are_refused() {
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(8, 2);
    let mut nameless = robot.labelled_messages("nameless");
    let mut endless = robot.labelled_messages("endless");
    let opening = |messages: &mut Vec<v1::FrameMessage>| match messages.remove(0).message {
        Some(Message::Open(open)) => open,
        other => panic!("the first message opens: {other:?}"),
    };
    let open = opening(&mut nameless);
    let open = v1::OpenMap { label_texts: Vec::new(), ..open };
    nameless.insert(0, v1::FrameMessage { message: Some(Message::Open(open)) });
    let acks = server.send(nameless).await.expect("a bad frame ends no stream");
    assert!(acks[1..].iter().all(|ack| ack.refused_field == "labels"), "{acks:?}");
    assert!(acks[1].refused_reason.contains("without label_texts"), "{acks:?}");

    let mut open = opening(&mut endless);
    open.label_texts[0] = "sofa ".repeat(1000);
    let message = v1::FrameMessage { message: Some(Message::Open(open)) };
    let call = server.client().await.stream_frames(tokio_stream::iter([message])).await;
    let status = first_error(call).await.expect("it is refused");
    assert_eq!(status.code(), tonic::Code::InvalidArgument);
    assert!(status.message().contains("label_texts"), "{status}");
    server.stop().await;
}

async fn snapshot(server: &Server, map: &str) -> Arc<MapSnapshot> {
    server.engine.map(map).expect("it is there").snapshot().await
}
