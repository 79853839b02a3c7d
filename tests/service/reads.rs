//! Reads say what they are of, and wait for what was acknowledged if they are asked to.

use lexsplat_proto::v1;
use lexsplat_tests::{Robot, Server, tiny_config};
use serde_json::{Value, json};
use std::time::Instant;
use tonic::Code;

const FRAMES: u64 = 12;

async fn ask(server: &Server, options: &str) -> Value {
    let url = server.url(&format!("/v1/maps/reads/query{options}"));
    let reply = reqwest::Client::new().post(url).json(&json!({"text": "chair"})).send().await;
    reply.expect("it answers").json().await.expect("JSON")
}

/// A read right after the last acknowledgement, with and without waiting.
#[tokio::test(flavor = "multi_thread")]
async fn a_read_can_wait_for_what_was_acknowledged() {
    let mut config = tiny_config();
    // Much to do, and readers get nothing by themselves before it is done.
    config.mapper.steps_per_keyframe = 200;
    config.mapper.snapshot_seconds = 1e6;
    let server = Server::start(config).await;
    let robot = Robot::new(7, FRAMES as usize);
    server.stream(&robot, "reads").await;
    let early = ask(&server, "").await;
    assert_eq!(early["settled"], false, "negative control: it lags behind");
    assert_ne!(early["through"], FRAMES - 1, "{early}");
    let impatient = Instant::now();
    let at_once = ask(&server, "?wait=settled&wait_seconds=0").await;
    assert_eq!(at_once["settled"], false, "after {:?}: {at_once}", impatient.elapsed());

    let last = FRAMES - 1;
    let render = |options: &str| {
        let url = server.url(&format!("/v1/maps/reads/render{options}"));
        (
            reqwest::Client::new().get(format!("{url}&frame={last}")),
            reqwest::Client::new().post(url),
        )
    };
    let (early, _) = render("?channel=color");
    let early = early.send().await.expect("it answers").status();
    assert_eq!(early, 404, "negative control: the newest frame is not there yet");
    let (of_frame, _) = render(&format!("?min_sequence={last}&wait_seconds=300"));
    let (_, of_view) = render("?wait=settled&wait_seconds=0");
    for picture in [of_frame, of_view.json(&json!({"frame": last}))] {
        let picture = picture.send().await.expect("it answers");
        assert_eq!(picture.status(), 200);
        assert_eq!(picture.headers()["lexsplat-through"], last.to_string().as_str());
        assert!(picture.headers().contains_key("lexsplat-settled"));
    }
    let url = server
        .url(&format!("/v1/maps/reads/export/points.ply?min_sequence={last}&wait_seconds=300"));
    let file = reqwest::get(url).await.expect("it answers");
    assert_eq!(file.headers()["lexsplat-through"], last.to_string().as_str());
    assert!(file.headers().contains_key("lexsplat-revision"));
    assert!(file.bytes().await.expect("a file").len() > 10_000, "it is not empty");

    let settled = ask(&server, "?wait=settled&wait_seconds=300").await;
    assert_eq!((&settled["settled"], &settled["through"]), (&json!(true), &json!(last)));
    let poses = reqwest::get(server.url("/v1/maps/reads/trajectory?wait=settled")).await;
    let poses = poses.expect("it answers");
    assert_eq!(poses.headers()["lexsplat-settled"], "true");
    let poses = poses.text().await.expect("text");
    assert_eq!(poses.lines().filter(|line| !line.starts_with('#')).count() as u64, FRAMES);

    let mut client = server.client().await;
    let question = v1::QueryRequest {
        map: "reads".into(),
        text: "chair".into(),
        wait: "settled".into(),
        min_sequence: Some(last),
        ..Default::default()
    };
    let answer = client.query(question.clone()).await.expect("it is answered").into_inner();
    assert_eq!((answer.settled, answer.through), (true, Some(last)));
    let export = v1::ExportRequest {
        map: "reads".into(),
        format: "trajectory.tum".into(),
        wait: "settled".into(),
        ..Default::default()
    };
    let export = client.export_map(export).await.expect("it is exported");
    assert_eq!(export.metadata().get("lexsplat-settled").expect("it says so"), "true");
    let wrong = v1::QueryRequest { wait: "done".into(), ..question };
    assert_eq!(client.query(wrong).await.expect_err("unknown").code(), Code::InvalidArgument);
    let wrong = reqwest::get(server.url("/v1/maps/reads/trajectory?wait_seconds=-1")).await;
    assert_eq!(wrong.expect("it answers").status(), 400);
    // A frame that never comes is not waited for longer than asked.
    let never = ask(&server, "?min_sequence=999&wait_seconds=0.2").await;
    assert_eq!(never["through"], last, "it says what there is");
    server.stop().await;
}
