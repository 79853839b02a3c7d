//! A robot sends poses or depth in a wrong form: the server says what is wrong, once, and maps all the same.

use lexsplat_proto::v1::{self, InputProblem, frame_message::Message};
use lexsplat_tests::{Robot, Server, tiny_config};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;

const FRAMES: usize = 28;
/// How far the depth camera is beside the color camera, metres.
const ASIDE_METRES: f64 = 0.1;

/// A mistake of a robot's program: its name, what it does to a message, and what the server should say.
type Mistake<'a> = (&'static str, Box<dyn Fn(&mut Message) + 'a>, Option<InputProblem>);

/// A frame of the walk. All but the first are held out: the map costs no time then.
fn frame(robot: &Robot, at: usize) -> v1::Frame {
    v1::Frame { held_out: at > 0, ..robot.frame(at) }
}

/// A change of the unit of depth.
fn unit(factor: f64) -> Box<dyn Fn(&mut Message)> {
    Box::new(move |message| {
        if let Message::Open(open) = message {
            open.depth_unit_metres *= factor;
        }
    })
}

/// A change of every pose.
fn pose(change: impl Fn(Isometry3<f64>) -> Isometry3<f64> + 'static) -> Box<dyn Fn(&mut Message)> {
    Box::new(move |message| {
        if let Message::Frame(frame) = message {
            let pose = frame.world_from_camera.as_mut().expect("it has one");
            let (q, t) =
                (pose.rotation.expect("a rotation"), pose.translation_metres.expect("and"));
            let rotation = UnitQuaternion::new_normalize(Quaternion::new(q.w, q.x, q.y, q.z));
            let changed = change(Isometry3::from_parts(Translation3::new(t.x, t.y, t.z), rotation));
            let (q, t) = (changed.rotation, changed.translation);
            pose.rotation = Some(v1::Quaternion { w: q.w, x: q.i, y: q.j, z: q.k });
            pose.translation_metres = Some(v1::Vector3 { x: t.x, y: t.y, z: t.z });
        }
    })
}

/// A depth camera that sends zeros.
fn without_depth(robot: &Robot) -> Box<dyn Fn(&mut Message)> {
    let bytes = robot.camera.width * robot.camera.height * 4;
    Box::new(move |message| {
        if let Message::Frame(frame) = message {
            frame.depth_format = v1::DepthFormat::F32Metres.into();
            frame.depth = vec![0; bytes as usize].into();
        }
    })
}

/// Depth as a camera beside the color camera sees it.
fn unregistered(robot: &Robot) -> Box<dyn Fn(&mut Message) + '_> {
    Box::new(|message| {
        if let Message::Frame(frame) = message {
            let aside =
                robot.poses[frame.sequence as usize] * Translation3::new(ASIDE_METRES, 0.0, 0.0);
            let view = robot.room.render(&robot.camera, &aside);
            frame.depth = lexsplat_synthetic::depth_png(&view).expect("it encodes").into();
        }
    })
}

/// The warnings of a map's status over HTTP.
async fn http_warnings(server: &Server, map: &str) -> Vec<Value> {
    let status = reqwest::get(server.url(&format!("/v1/maps/{map}"))).await.expect("it answers");
    let status: Value = status.json().await.expect("with JSON");
    status["input_warnings"].as_array().cloned().unwrap_or_default()
}

/// The events of a map up to that of a frame.
async fn events_through(mut events: reqwest::Response, frame: usize) -> String {
    let mut text = String::new();
    let is_last = |text: &str| text.contains(&format!("\"sequence\":{frame},\"tracking_state\""));
    while !is_last(&text) {
        let chunk = events.chunk().await.expect("the server sends").expect("it does not end");
        text.push_str(&String::from_utf8_lossy(&chunk));
    }
    text
}

/// What a status over gRPC says is wrong.
async fn grpc_warnings(server: &Server, map: &str) -> Vec<v1::InputWarning> {
    let status = server.client().await.get_map(v1::GetMapRequest { name: map.into() }).await;
    status.expect("it answers").into_inner().input_warnings
}

#[tokio::test(flavor = "multi_thread")]
async fn a_mistake_is_told_once_and_the_frames_are_mapped() {
    let robot = Robot::new(7, FRAMES);
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let mistakes: Vec<Mistake<'_>> = vec![
        ("right", Box::new(|_| ()), None),
        ("ten-times", unit(10.0), Some(InputProblem::DepthUnit)),
        ("a-tenth", unit(0.1), Some(InputProblem::DepthUnit)),
        ("inverted", pose(|pose| pose.inverse()), Some(InputProblem::InvertedPoses)),
        ("opengl", pose(move |pose| pose * half_turn), Some(InputProblem::CameraAxes)),
        ("aside", unregistered(&robot), Some(InputProblem::UnregisteredDepth)),
        ("no-depth", without_depth(&robot), Some(InputProblem::NoDepth)),
    ];
    let server = Server::start(tiny_config()).await;
    for (map, change, expected) in &mistakes {
        let mut messages = robot.stream(map, (0..FRAMES).map(|at| frame(&robot, at)));
        messages.iter_mut().filter_map(|message| message.message.as_mut()).for_each(change);
        let create = v1::CreateMapRequest { name: (*map).to_owned() };
        server.client().await.create_map(create).await.expect("it is made");
        let events = reqwest::get(server.url(&format!("/v1/maps/{map}/events"))).await;
        let acks = server.send(messages).await.expect("the stream ends well");
        let is_tracked = |ack: &&v1::FrameAck| ack.status() == v1::FrameStatus::Tracked;
        assert_eq!(acks.iter().filter(is_tracked).count(), FRAMES, "{map}: nothing is refused");
        let told: Vec<_> = acks.iter().flat_map(|ack| ack.input_warnings.clone()).collect();
        let problems: Vec<_> = told.iter().map(v1::InputWarning::problem).collect();
        assert_eq!(problems, Vec::from_iter(*expected), "{map}: {told:?}");
        assert_eq!(grpc_warnings(&server, map).await, told, "{map}");
        let events = events_through(events.expect("it answers"), FRAMES - 1).await;
        assert_eq!(events.matches("event: input_warning").count(), told.len(), "{map}: {events}");
    }
    for (map, _, expected) in &mistakes {
        let http = http_warnings(&server, map).await;
        let told: Vec<_> = http.iter().filter_map(|warning| warning["problem"].as_str()).collect();
        let name = expected.map(|problem| match problem {
            InputProblem::DepthUnit => "depth_unit",
            InputProblem::InvertedPoses => "inverted_poses",
            InputProblem::CameraAxes => "camera_axes",
            InputProblem::UnregisteredDepth => "unregistered_depth",
            InputProblem::RepeatedDepth => "repeated_depth",
            InputProblem::BadBeginning => "bad_beginning",
            InputProblem::NoDepth => "no_depth",
            InputProblem::Unspecified => unreachable!("no test expects it"),
        });
        assert_eq!(told, Vec::from_iter(name), "{map}: other maps' mistakes are not its own");
        assert!(
            http.iter().all(|warning| warning["message"].as_str().is_some_and(|m| m.len() > 50))
        );
    }
    server.stop().await;
}
