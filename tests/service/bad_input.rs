//! Bad input gets an error that says what and where, and the server goes on.

use lexsplat_proto::v1::{self, FrameStatus, frame_message::Message};
use lexsplat_tests::{Robot, Server, raw, tiny_config};
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};
use tonic::Code;

/// A frame's message.
fn message(frame: v1::Frame) -> v1::FrameMessage {
    v1::FrameMessage { message: Some(Message::Frame(frame)) }
}

type Spoil = Box<dyn Fn(&mut v1::Frame)>;

/// What can be wrong with a frame, and the field that the refusal names.
fn bad_frames() -> Vec<(&'static str, &'static str, Spoil)> {
    fn case(
        name: &'static str,
        field: &'static str,
        spoil: impl Fn(&mut v1::Frame) + 'static,
    ) -> (&'static str, &'static str, Spoil) {
        (name, field, Box::new(spoil))
    }
    vec![
        case("truncated JPEG", "color", |frame| frame.color.truncate(frame.color.len() / 2)),
        case("no JPEG", "color", |frame| frame.color = b"what is this".as_slice().into()),
        case("no color", "color", |frame| frame.color.clear()),
        case("100 megapixels", "color", |frame| frame.color = huge_png_header().into()),
        case("0x0 PNG", "color", |frame| frame.color = png_header(0, 0).into()),
        case("unknown color format", "color_format", |frame| frame.color_format = 77),
        case("truncated PNG", "depth", |frame| frame.depth.truncate(frame.depth.len() / 2)),
        case("depth of another size", "depth", |frame| {
            frame.set_depth_format(v1::DepthFormat::U16);
            frame.depth = vec![1; 100].into();
        }),
        case("depths out of range", "depth", |frame| {
            frame.set_depth_format(v1::DepthFormat::F32Metres);
            frame.depth = 5000.0_f32.to_le_bytes().repeat(320 * 240).into();
        }),
        case("no pose", "world_from_camera", |frame| frame.world_from_camera = None),
        case("NaN position", "world_from_camera.translation_metres", |frame| {
            let pose = frame.world_from_camera.get_or_insert_default();
            pose.translation_metres.get_or_insert_default().x = f64::NAN;
        }),
        case("NaN rotation", "world_from_camera.rotation", |frame| {
            let pose = frame.world_from_camera.get_or_insert_default();
            pose.rotation.get_or_insert_default().w = f64::NAN;
        }),
        case("not rigid", "world_from_camera.rotation", |frame| {
            let pose = frame.world_from_camera.get_or_insert_default();
            let rotation = pose.rotation.get_or_insert_default();
            *rotation = v1::Quaternion { w: 2.0, x: 0.0, y: 0.0, z: 1.0 };
        }),
        case("covariance of 5 numbers", "pose_covariance", |frame| {
            frame.pose_covariance = vec![1.0; 5];
        }),
        case("an old sequence", "sequence", |frame| frame.sequence = 0),
    ]
}

/// The first bytes of a PNG that says it is this large.
fn png_header(width: u32, height: u32) -> Vec<u8> {
    let mut encoded = Vec::new();
    image::RgbImage::new(1, 1)
        .write_to(&mut std::io::Cursor::new(&mut encoded), image::ImageFormat::Png)
        .expect("it encodes");
    encoded[16..20].copy_from_slice(&width.to_be_bytes());
    encoded[20..24].copy_from_slice(&height.to_be_bytes());
    encoded
}

fn huge_png_header() -> Vec<u8> {
    png_header(10_000, 10_000)
}

#[tokio::test(flavor = "multi_thread")]
async fn bad_frames_are_refused_one_by_one_and_the_stream_goes_on() {
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(3, 4);
    let cases = bad_frames();
    let mut messages = vec![robot.open("spoilt"), message(robot.frame(0))];
    for (at, (name, _, spoil)) in cases.iter().enumerate() {
        let mut frame = robot.frame(1);
        frame.sequence = 1 + at as u64;
        if name.ends_with("PNG") && name.starts_with("0x0") || name.starts_with("100") {
            frame.set_color_format(v1::ColorFormat::Png);
        }
        spoil(&mut frame);
        messages.push(message(frame));
    }
    let mut last = raw(&robot, 2);
    last.sequence = 1000;
    messages.push(message(last));
    let acks = server.send(messages).await.expect("the stream outlives every bad frame");
    assert_eq!(acks.len(), cases.len() + 3, "one ack per message");
    assert_eq!(acks[1].status(), FrameStatus::Tracked, "the first frame is good");
    for ((name, field, _), ack) in cases.iter().zip(&acks[2..]) {
        assert_eq!(ack.status(), FrameStatus::Refused, "{name}: {ack:?}");
        assert!(ack.refused_field.starts_with(field), "{name}: {ack:?}");
        assert!(ack.refused_reason.len() > 5, "{name}: {ack:?}");
    }
    assert_eq!(acks[acks.len() - 1].status(), FrameStatus::Tracked, "the good twin passes");
    let status = server.engine.map("spoilt").expect("it is there").status();
    assert_eq!((status.frames_refused, status.frames_tracked), (cases.len() as u64, 2));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn streams_that_do_not_open_say_why() {
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(3, 1);
    let spoilt = |spoil: &dyn Fn(&mut v1::OpenMap)| {
        let mut opening = robot.open("unopened");
        let Some(Message::Open(open)) = &mut opening.message else { unreachable!("it opens") };
        spoil(open);
        vec![opening, message(robot.frame(0))]
    };
    let intrinsics = |change: fn(&mut v1::Intrinsics)| {
        spoilt(&move |open| change(open.intrinsics.get_or_insert_default()))
    };
    let cases = [
        ("a frame first", "open", Code::InvalidArgument, vec![message(robot.frame(0))]),
        ("zero focal length", "fx", Code::InvalidArgument, intrinsics(|i| i.fx = 0.0)),
        ("NaN focal length", "fy", Code::InvalidArgument, intrinsics(|i| i.fy = f64::NAN)),
        ("0x0", "width", Code::InvalidArgument, intrinsics(|i| i.width = 0)),
        (
            "100 megapixels",
            "width",
            Code::InvalidArgument,
            intrinsics(|i| {
                (i.width, i.height, i.fx, i.fy) = (10_000, 10_000, 9000.0, 9000.0);
            }),
        ),
        (
            "a name with a slash",
            "map",
            Code::InvalidArgument,
            spoilt(&|open| open.map = "a/b".into()),
        ),
        (
            "NaN depth unit",
            "depth_unit",
            Code::InvalidArgument,
            spoilt(&|open| {
                open.depth_unit_metres = f64::NAN;
            }),
        ),
        (
            "an unknown source of poses",
            "pose_source",
            Code::InvalidArgument,
            spoilt(&|open| {
                open.pose_source = 9;
            }),
        ),
    ];
    for (name, says, code, messages) in cases {
        let status = server.send(messages).await.expect_err(name);
        assert_eq!(status.code(), code, "{name}: {status}");
        assert!(status.message().contains(says), "{name}: {status}");
    }
    let acks = server.send(spoilt(&|_| {})).await.expect("the good twin opens");
    assert_eq!(acks[1].status(), FrameStatus::Tracked);
    let acks = server.send(intrinsics(|i| i.cx += 1.0)).await.expect("another camera goes on");
    assert_eq!(acks[1].status(), FrameStatus::Refused, "its frame has a number that the map knows");
    server.stop().await;
}

/// Asks over HTTP and checks the problem that comes back.
async fn assert_problem(
    server: &Server,
    (method, path, body): (Method, &str, Option<String>),
    (status, says): (StatusCode, &str),
) {
    let mut request = reqwest::Client::new().request(method, server.url(path));
    if let Some(body) = body {
        request = request.header("content-type", "application/json").body(body);
    }
    let response = request.send().await.expect("the server answers");
    assert_eq!(response.status(), status, "{path}");
    let kind = response.headers()["content-type"].to_str().expect("text").to_owned();
    assert_eq!(kind, "application/problem+json", "{path}");
    let problem: Value = response.json().await.expect("with JSON");
    assert_eq!(problem["status"], status.as_u16(), "{problem}");
    for field in ["type", "title", "detail"] {
        assert!(problem[field].as_str().is_some_and(|text| !text.is_empty()), "{problem}");
    }
    assert!(problem.to_string().contains(says), "{path}: no {says:?} in {problem}");
}

#[tokio::test(flavor = "multi_thread")]
async fn bad_questions_get_problems() {
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(3, 3);
    server.stream(&robot, "room").await;
    server.settled("room").await;
    let query = "/v1/maps/room/query";
    let cases = [
        (query, Some(json!({"text": ""}).to_string()), 400, "text"),
        (query, Some(json!({"text": " \t"}).to_string()), 400, "text"),
        (query, Some(json!({"text": "x".repeat(10_000)}).to_string()), 400, "text"),
        (query, Some(json!({"text": "cup", "view": {"frame": 999}}).to_string()), 404, "999"),
        (query, Some(json!({"text": "cup", "threshold": 7}).to_string()), 400, "threshold"),
        (query, Some(json!({"text": "cup", "outputs": ["hologram"]}).to_string()), 400, "hologram"),
        (query, Some(json!({"text": "cup", "color": 1}).to_string()), 400, "color"),
        (query, Some(json!({}).to_string()), 400, "text"),
        (query, Some("{\"text\": \"cup\"".into()), 400, "line 1"),
        ("/v1/maps/nowhere/query", Some(json!({"text": "cup"}).to_string()), 404, "nowhere"),
        ("/v1/maps", Some(json!({"name": "a/b"}).to_string()), 400, "name"),
        ("/v1/maps", Some(json!({"name": "room"}).to_string()), 409, "room"),
    ];
    for (path, body, status, says) in cases {
        let status = StatusCode::from_u16(status).expect("a status");
        assert_problem(&server, (Method::POST, path, body), (status, says)).await;
    }
    let gets = [
        ("/v1/maps/nowhere", 404, "nowhere"),
        ("/v1/maps/room/render?frame=999&channel=color", 404, "999"),
        ("/v1/maps/room/render?frame=0&channel=smell", 400, "smell"),
        ("/v1/maps/room/render?frame=0&channel=color&width=100000&height=100000", 400, "width"),
        ("/v1/maps/room/export/mesh.ply?voxel_metres=9", 400, "voxel_metres"),
        ("/v1/nothing", 404, "/v1/nothing"),
    ];
    for (path, status, says) in gets {
        let status = StatusCode::from_u16(status).expect("a status");
        assert_problem(&server, (Method::GET, path, None), (status, says)).await;
    }
    let good = reqwest::Client::new().post(server.url(query)).json(&json!({"text": "cup"}));
    assert!(good.send().await.expect("it answers").status().is_success(), "the good twin passes");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn grpc_questions_name_the_field() {
    let server = Server::start(tiny_config()).await;
    let mut client = server.client().await;
    let ask = |map: &str, text: &str| v1::QueryRequest {
        map: map.into(),
        text: text.into(),
        ..Default::default()
    };
    let missing = client.query(ask("nowhere", "cup")).await.expect_err("no such map");
    assert_eq!(missing.code(), Code::NotFound, "{missing}");
    client.create_map(v1::CreateMapRequest { name: "empty".into() }).await.expect("it is made");
    let empty = client.query(ask("empty", "")).await.expect_err("no text");
    assert_eq!(empty.code(), Code::InvalidArgument, "{empty}");
    assert!(empty.message().contains("text"), "{empty}");
    let nothing = client.query(ask("empty", "cup")).await.expect("an empty map can be asked");
    let nothing = nothing.into_inner();
    assert!(!nothing.present && nothing.coverage == 0.0, "{nothing:?}");
    server.stop().await;
}
