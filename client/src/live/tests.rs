//! The protocol's messages, and frames made of messages in any order.

use super::board::{BridgeEvent, BridgeProgress};
use super::bridge::bridge;
use super::intake::{Arrived, Intake};
use super::options::{BridgeError, BridgeOptions};
use super::protocol::{Channel, Data, Said, data, said, subscribe, unsubscribe};
use crate::dataset::RgbdFrame;
use crate::messages::Decoder;
use crate::rig::Wanted;
use crate::stream::Poses;
use serde_json::{Value, json};
use std::future::pending;
use std::sync::Mutex;
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpListener;

#[test]
fn what_a_robot_says_is_read() {
    let text = r#"{"op":"advertise","channels":[{"id":7,"topic":"/rgb","encoding":"cdr",
        "schemaName":"sensor_msgs/msg/Image","schema":"","schemaEncoding":"ros2msg"}]}"#;
    let channel = Channel {
        id: 7,
        topic: "/rgb".into(),
        encoding: "cdr".into(),
        schema_name: "sensor_msgs/msg/Image".into(),
    };
    assert_eq!(said(text).unwrap(), Said::Advertise { channels: vec![channel] });
    let gone = said(r#"{"op":"unadvertise","channelIds":[7,8]}"#).unwrap();
    assert_eq!(gone, Said::Unadvertise { channel_ids: vec![7, 8] });
    assert_eq!(said(r#"{"op":"parameterValues","parameters":[]}"#).unwrap(), Said::Other);
    for wrong in ["", "{}", "[]", r#"{"op":"advertise","channels":3}"#] {
        assert!(said(wrong).unwrap_err().starts_with("expected JSON of the protocol"), "{wrong}");
    }
    let message = [&[1][..], &9_u32.to_le_bytes(), &77_u64.to_le_bytes(), b"payload"].concat();
    let expected = Data { subscription: 9, nanos: 77, payload: "payload".into() };
    assert_eq!(data(&message.clone().into()), Some(expected));
    assert_eq!(data(&message[..12].to_vec().into()), None, "too short");
    assert_eq!(data(&[&[2], &message[1..]].concat().into()), None, "another kind");
    assert_eq!(
        serde_json::from_str::<Value>(&subscribe(&[(3, 7)])).unwrap(),
        json!({"op": "subscribe", "subscriptions": [{"id": 3, "channelId": 7}]})
    );
    assert_eq!(
        serde_json::from_str::<Value>(&unsubscribe(&[3])).unwrap(),
        json!({"op": "unsubscribe", "subscriptionIds": [3]})
    );
}

/// A robot whose messages are JSON of Foxglove's schemas.
struct Robot {
    intake: Intake,
    counts: BridgeProgress,
}

const MILLI: u64 = 1_000_000;
/// A second after the epoch: a time of 0 is none.
const START: u64 = 1000;

impl Robot {
    fn new(poses: Option<Poses>) -> Self {
        let intake = Intake::new(&Wanted::default(), poses);
        Self { intake, counts: BridgeProgress::default() }
    }

    fn take(&mut self, topic: &str, schema: &str, milliseconds: u64, mut message: Value) {
        let milliseconds = START + milliseconds;
        let (sec, nsec) = (milliseconds / 1000, milliseconds % 1000 * MILLI);
        message["timestamp"] = json!({ "sec": sec, "nsec": nsec });
        message["frame_id"] = "camera".into();
        let arrived = Arrived {
            topic: topic.into(),
            decoder: Decoder::of("json", &format!("foxglove.{schema}")).unwrap(),
            nanos: 1,
            payload: message.to_string().into(),
        };
        self.intake.take(arrived, &mut self.counts);
    }

    fn color(&mut self, milliseconds: u64) {
        let data = "AAAAAAAAAAAAAAAA"; // 12 bytes: 2x2 pixels
        let picture = json!({"width": 2, "height": 2, "encoding": "rgb8", "step": 6, "data": data});
        self.take("/rgb", "RawImage", milliseconds, picture);
    }

    fn depth(&mut self, milliseconds: u64) {
        let data = "6APoA+gD6AM="; // four times 1000
        let picture =
            json!({"width": 2, "height": 2, "encoding": "16UC1", "step": 4, "data": data});
        self.take("/depth", "RawImage", milliseconds, picture);
    }

    fn info(&mut self) {
        let k = [2.0, 0.0, 0.5, 0.0, 2.0, 0.5, 0.0, 0.0, 1.0];
        let r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let p = [2.0, 0.0, 0.5, 0.0, 0.0, 2.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.0];
        let info = json!({"width": 2, "height": 2, "distortion_model": "", "D": [],
            "K": k, "R": r, "P": p});
        self.take("/camera_info", "CameraCalibration", 0, info);
    }

    fn pose(&mut self, milliseconds: u64) {
        let x = milliseconds as f64 / 1000.0;
        let position = json!({"x": x, "y": 0.0, "z": 0.0});
        let orientation = json!({"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0});
        let pose = json!({"pose": {"position": position, "orientation": orientation}});
        self.take("/pose", "PoseInFrame", milliseconds, pose);
    }

    /// Times of the frames that are whole, milliseconds.
    fn frames(&mut self) -> Vec<u64> {
        let at = |frame: &RgbdFrame| frame.timestamp_nanos / MILLI - START;
        self.intake.frames(&mut self.counts).iter().map(at).collect()
    }
}

/// A robot whose topics are chosen.
fn running(poses: Option<Poses>, has_poses: bool) -> Robot {
    let mut robot = Robot::new(poses);
    robot.color(0);
    robot.depth(0);
    robot.info();
    if has_poses {
        robot.pose(0);
        robot.pose(50);
    }
    let (spec, notes) = robot.intake.choose("kitchen").unwrap();
    let expected =
        if has_poses && poses != Some(Poses::Estimate) { Poses::Given } else { Poses::Estimate };
    assert_eq!((spec.poses, spec.map.as_str()), (expected, "kitchen"), "{notes:?}");
    robot
}

#[test]
fn topics_are_chosen_when_all_are_there() {
    let mut robot = Robot::new(None);
    robot.color(0);
    let error = robot.intake.choose("kitchen").unwrap_err();
    assert!(error.contains("expected a topic with depth pictures"), "{error}");
    robot.depth(0);
    let error = robot.intake.choose("kitchen").unwrap_err();
    assert!(error.contains("expected a calibration (CameraInfo) beside /rgb"), "{error}");
    robot.info();
    robot.intake.choose("kitchen").unwrap();
    // Poses that are to be given have to be there.
    let mut robot = Robot::new(Some(Poses::Given));
    robot.color(0);
    robot.depth(0);
    robot.info();
    let error = robot.intake.choose("kitchen").unwrap_err();
    assert!(error.starts_with("no poses") && error.contains("--poses estimate"), "{error}");
    robot.pose(0);
    robot.pose(50);
    robot.intake.choose("kitchen").unwrap();
}

#[test]
fn pictures_are_paired_in_any_order() {
    let mut robot = running(Some(Poses::Estimate), false);
    robot.color(100);
    assert_eq!(robot.frames(), [0; 0], "its depth may still come");
    robot.depth(103);
    assert_eq!(robot.frames(), [100]);
    robot.depth(203);
    robot.color(200);
    robot.depth(303);
    robot.color(400);
    robot.color(300);
    assert_eq!(robot.frames(), [200, 300]);
    // The depth of 400 never comes: later ones say so.
    robot.color(500);
    robot.depth(500);
    assert_eq!(robot.frames(), [500]);
    assert_eq!((robot.counts.unpaired, robot.counts.frames), (1, 4));
    // Without any depth a picture waits only so long, and not more than so many.
    (600..900).step_by(5).for_each(|at| robot.color(at));
    assert_eq!(robot.frames(), [0; 0]);
    robot.color(1300);
    robot.frames();
    assert!(robot.counts.unpaired > 40, "{:?}", robot.counts);
    (2000..3000).step_by(5).for_each(|at| robot.color(at));
    assert!(robot.counts.unpaired > 140, "{:?}", robot.counts);
}

#[test]
fn a_clock_that_was_set_back_begins_anew() {
    let mut robot = running(Some(Poses::Estimate), false);
    robot.color(9000);
    robot.depth(9000);
    robot.color(9100);
    assert_eq!(robot.frames(), [9000]);
    robot.color(1000);
    robot.depth(1000);
    assert_eq!(robot.frames(), [1000]);
    assert_eq!(robot.counts.unpaired, 1);
}

#[test]
fn a_picture_waits_for_its_pose() {
    let mut robot = running(None, true);
    robot.color(100);
    robot.depth(100);
    assert_eq!(robot.frames(), [0; 0], "its pose may still come");
    robot.pose(90);
    robot.pose(110);
    let frames = robot.intake.frames(&mut robot.counts);
    let place = frames[0].world_from_camera.unwrap().translation.x;
    assert!((place - 0.1).abs() < 1e-9, "between two poses: {place}");
    // A pose that never comes costs its frame only.
    robot.color(2000);
    robot.depth(2000);
    robot.color(3100);
    robot.depth(3100);
    assert_eq!(robot.frames(), [0; 0]);
    assert_eq!(robot.counts.without_pose, 1);
    // Negative control: nobody waits where poses are estimated.
    let mut robot = running(Some(Poses::Estimate), true);
    robot.color(2000);
    robot.depth(2000);
    assert_eq!(robot.frames(), [2000]);
}

#[test]
fn what_was_missing_is_told_by_the_counts() {
    let none = BridgeProgress::default();
    assert_eq!(none.missing(), "it sent no pictures");
    let mut robot = running(Some(Poses::Estimate), false);
    robot.color(100);
    assert_eq!(robot.counts.missing(), "no depth came with 1 color pictures");
    let mut robot = running(None, true);
    for milliseconds in [2000, 3100] {
        robot.color(milliseconds);
        robot.depth(milliseconds);
    }
    robot.frames();
    assert_eq!(robot.counts.missing(), "1 frames had no pose");
}

#[test]
fn damaged_messages_are_counted() {
    let mut robot = running(Some(Poses::Estimate), false);
    let decoder = Decoder::of("json", "foxglove.RawImage").unwrap();
    for payload in ["", "{}", "{\"width\":2}", "nonsense"] {
        let arrived = Arrived { topic: "/rgb".into(), decoder, nanos: 1, payload: payload.into() };
        robot.intake.take(arrived, &mut robot.counts);
    }
    let before = robot.counts.damaged;
    assert!(before >= 3, "{:?}", robot.counts);
    // A picture of another size than the camera's.
    let picture = json!({"width": 1, "height": 1, "encoding": "rgb8", "step": 3, "data": "AAAA"});
    robot.take("/rgb", "RawImage", 100, picture);
    robot.depth(100);
    assert_eq!(robot.frames(), [0; 0]);
    assert_eq!(robot.counts.damaged, before + 1);
    robot.color(200);
    robot.depth(200);
    assert_eq!(robot.frames(), [200], "control");
}

/// An address at which nothing listens.
const NOWHERE: &str = "127.0.0.1:1";

/// A bridge from a port to a server that is not there, and what it told.
async fn bridged(port: &str, seconds: f64) -> (Result<BridgeProgress, BridgeError>, String) {
    let options = BridgeOptions::new(port, NOWHERE, "kitchen");
    let told = Mutex::new(String::new());
    let tell = |event| {
        if let BridgeEvent::Told(what) = event {
            *told.lock().unwrap() += &format!("{what}\n");
        }
    };
    let ended = bridge(&options, tokio::time::sleep(Duration::from_secs_f64(seconds)), tell).await;
    let told = told.into_inner().unwrap();
    (ended, told)
}

/// Answers every connection so, after it has read the request; a WebSocket without a protocol if with
/// nothing.
async fn answering(answer: &'static str) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().to_string();
    tokio::spawn(async move {
        while let Ok((mut socket, _)) = listener.accept().await {
            if answer.is_empty() {
                let _ = tokio_tungstenite::accept_async(socket).await;
                continue;
            }
            let _ = socket.read(&mut [0; 4096]).await;
            let _ = socket.write_all(answer.as_bytes()).await;
        }
    });
    port
}

#[tokio::test]
async fn a_port_that_is_no_robot_ends_the_bridge() {
    for (answer, expected) in [
        (
            "HTTP/1.1 200 OK\r\ncontent-length: 0\r\n\r\n",
            "a web server answers without a WebSocket: 200 OK",
        ),
        ("HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\n\r\n", "404 Not Found"),
        ("SSH-2.0-OpenSSH_9.2\r\n", "what answers is no WebSocket"),
        ("", "a WebSocket answers that does not speak Foxglove's protocol (rosbridge?)"),
    ] {
        let port = answering(answer).await;
        let (ended, told) = bridged(&port, 60.0).await;
        let error = ended.unwrap_err();
        assert!(matches!(error, BridgeError::NoRobot { .. }), "{answer}: {error}\n{told}");
        let error = error.to_string();
        assert!(error.contains(expected) && error.contains("start foxglove_bridge"), "{error}");
        assert!(!told.contains("trying again"), "{told}");
    }
    // Negative controls: what may become a robot is tried again, and it is an error if it never does.
    let nobody = TcpListener::bind("127.0.0.1:0").await.unwrap().local_addr().unwrap().to_string();
    let busy = "HTTP/1.1 503 Service Unavailable\r\ncontent-length: 0\r\n\r\n";
    for (port, expected) in
        [(nobody, "nothing listens there"), (answering(busy).await, "503 Service Unavailable")]
    {
        let (ended, told) = bridged(&port, 1.0).await;
        assert!(told.contains("trying again in 0.5 s"), "{told}");
        let error = ended.unwrap_err();
        assert!(matches!(error, BridgeError::NoFrames { .. }), "{error}");
        assert!(error.to_string().starts_with("no frame came from ws://127.0.0.1:"), "{error}");
        assert!(error.to_string().contains(expected), "{error}");
        let no_server = "no server at 127.0.0.1:1: start lexsplat-server; frames will wait for it";
        assert!(told.contains(no_server), "{told}");
    }
}

#[tokio::test]
async fn wrong_names_and_addresses_end_the_bridge_at_once() {
    for (map, grpc, expected) in [
        ("a/b", NOWHERE, "map: expected 1 to 64 of A-Z a-z 0-9 . _ - and not a dot first"),
        ("", NOWHERE, "map: expected"),
        (".hidden", NOWHERE, "map: expected"),
        ("kitchen", "nowhere", "grpc: expected HOST:PORT"),
    ] {
        let error = bridge(&BridgeOptions::new(NOWHERE, grpc, map), pending(), |_| {}).await;
        let error = error.unwrap_err().to_string();
        assert!(error.starts_with(expected), "{error}");
    }
}
