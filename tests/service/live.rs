//! A live robot, served by an outside library, is mapped: with a robot that goes away, and a server that
//! does.

use lexsplat_client::live::{BridgeError, BridgeEvent, BridgeOptions, BridgeProgress, bridge};
use lexsplat_client::stream::ClientError;
use lexsplat_server::access::{Scope, issue};
use lexsplat_synthetic as synthetic;
use lexsplat_tests::{Robot, Server, python, tiny_config};
use nalgebra::Isometry3;
use std::future::pending;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::Mutex;
use std::time::Duration;
use tokio::io::copy_bidirectional;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::timeout;

const FRAMES: usize = 18;
const SEED: u64 = 5;
/// The frame at which the robot goes away for a second.
const CUT: usize = 9;
/// A test that takes longer hangs.
const AT_MOST: Duration = Duration::from_secs(300);
/// As of recordings: poses are interpolated between those of the robot.
const CLOSE: [f64; 2] = [0.003, 0.004];

/// A robot in a process of its own.
struct Live {
    process: Child,
    output: BufReader<std::process::ChildStdout>,
    address: String,
}

impl Live {
    /// Simulates a camera's driver; goes away for a second at frame `cut`.
    fn start(room: &Path, device: &str, cut: usize) -> Self {
        let mut process = python("tests/outside/live.py", &["bags"])
            .arg(room)
            .arg(device)
            .arg(cut.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("python3 runs");
        let mut output = BufReader::new(process.stdout.take().expect("it is piped"));
        let mut port = String::new();
        output.read_line(&mut port).expect("it can be read");
        let port: u16 = port.trim().parse().expect("a port (make test installs what it needs)");
        Self { process, output, address: format!("127.0.0.1:{port}") }
    }

    /// Waits until the last picture was sent and had time to come.
    async fn done(mut self) {
        let wait = move || {
            let mut line = String::new();
            self.output.read_line(&mut line).expect("it can be read");
            assert_eq!(line.trim(), "done");
            std::thread::sleep(Duration::from_secs(2));
            self
        };
        drop(tokio::task::spawn_blocking(wait).await.expect("it ends"));
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        drop(self.process.stdin.take());
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Passes bytes on to a server until it is told to cut all connections.
async fn proxy(listener: TcpListener, target: String, mut cuts: watch::Receiver<u32>) {
    let mut connections = JoinSet::new();
    loop {
        tokio::select! {
            accepted = listener.accept() => {
                let (mut from, _) = accepted.expect("it accepts");
                let target = target.clone();
                connections.spawn(async move {
                    if let Ok(mut to) = TcpStream::connect(target).await {
                        let _ = copy_bidirectional(&mut from, &mut to).await;
                    }
                });
            }
            changed = cuts.changed() => match changed {
                Ok(()) => connections.abort_all(),
                Err(_) => return,
            },
        }
    }
}

/// The worst distance in metres and radians between two paths.
fn apart(found: &[Isometry3<f64>], truth: &[Isometry3<f64>]) -> [f64; 2] {
    let differences = found.iter().zip(truth).map(|(found, truth)| found.inverse() * truth);
    differences.fold([0.0, 0.0], |[metres, radians], one| {
        [one.translation.vector.norm().max(metres), one.rotation.angle().max(radians)]
    })
}

fn is_close([metres, radians]: [f64; 2]) -> bool {
    metres < CLOSE[0] && radians < CLOSE[1]
}

/// A room to walk through: its folder and the true poses.
fn room() -> (tempfile::TempDir, Vec<Isometry3<f64>>) {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let camera = synthetic::Camera::new(160, 120);
    let plan = synthetic::Plan { seed: SEED, frames: FRAMES, every: 1, camera };
    synthetic::write(folder.path(), &plan, |_| {}).expect("the room can be written");
    (folder, Robot::with(SEED, FRAMES, camera).poses)
}

/// Compares the last frames of a map, since the first was sent several times before topics were chosen.
/// Returns the worst distances from the truth, and from the frames before those as a negative control.
async fn compared(server: &Server, map: &str, truth: &[Isometry3<f64>]) -> [[f64; 2]; 2] {
    let snapshot = server.engine.map(map).expect("it is there").snapshot().await;
    let path = &snapshot.trajectory;
    let is_whole = path.windows(2).all(|two| two[1].sequence == two[0].sequence + 1);
    assert!(is_whole, "{map}: no frame is missing and none is there twice");
    let found: Vec<_> = path.iter().map(|frame| frame.world_from_camera).collect();
    let last = &found[found.len() - (FRAMES - 1)..];
    let from_first = |path: &[Isometry3<f64>]| {
        path.iter().map(|pose| path[0].inverse() * pose).collect::<Vec<_>>()
    };
    let of = |truth: &[Isometry3<f64>]| apart(&from_first(last), &from_first(truth));
    let both = [of(&truth[1..]), of(&truth[..FRAMES - 1])];
    println!("{map}: {:.2} mm, {:.3} degrees", both[0][0] * 1e3, both[0][1].to_degrees());
    both
}

#[tokio::test(flavor = "multi_thread")]
async fn a_live_robot_is_mapped_although_it_and_the_server_go_away() {
    let (folder, truth) = room();
    let server = Server::start(tiny_config()).await;
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port is free");
    let grpc = listener.local_addr().expect("it is bound").to_string();
    let (cut, cuts) = watch::channel(0);
    let between = tokio::spawn(proxy(listener, server.grpc.clone(), cuts));

    let live = Live::start(folder.path(), "realsense", CUT);
    let options = BridgeOptions::new(&live.address, &grpc, "live");
    let told = Mutex::new(Vec::new());
    let tell = |event: BridgeEvent| match event {
        BridgeEvent::Told(what) => told.lock().expect("nothing panics").push(what),
        // The server's connection breaks once, after some frames.
        BridgeEvent::Progress(BridgeProgress { acknowledged: 5.., .. }) => {
            cut.send_if_modified(|times| std::mem::replace(times, 1) == 0);
        }
        BridgeEvent::Progress(_) => {}
    };
    let counts = timeout(AT_MOST, bridge(&options, live.done(), tell)).await.expect("it ends");
    let told = told.into_inner().expect("nothing panics").join("\n");
    let counts = counts.unwrap_or_else(|error| panic!("{error}\n{told}"));
    println!("{counts:?}\n{told}");
    assert_eq!((counts.robot_connections, counts.server_connections), (2, 2), "{told}");
    assert_eq!((counts.lost, counts.refused, counts.dropped, counts.damaged), (0, 0, 0, 0));
    assert_eq!(counts.acknowledged, counts.frames, "every frame is acknowledged");
    for expected in [
        "color is /camera/color/image_raw (160x120",
        "depth is registered to color (/camera/aligned_depth_to_color/image_raw)",
        "left aside: /camera/depth/image_rect_raw, /camera/infra1/image_rect_raw",
        "map live begins",
        "map live goes on after frame",
        "trying again in 0.5 s",
    ] {
        assert!(told.contains(expected), "{expected}: {told}");
    }

    server.settled("live").await;
    let [found, other] = compared(&server, "live", &truth).await;
    assert!(is_close(found), "{found:?}");
    assert!(!is_close(other), "negative control: {other:?}");
    drop(cut);
    between.await.expect("it ends");
    server.stop().await;
}

/// Poses that the server estimates, metres and radians: 1 mm and 0.05 degrees were measured.
const TRACKED: [f64; 2] = [0.005, 0.004];

#[tokio::test(flavor = "multi_thread")]
async fn cameras_of_other_makers_are_mapped() {
    let (folder, truth) = room();
    let server = Server::start(tiny_config()).await;
    for (device, expected) in [
        ("kinect", ["depth has a camera of its own", "no poses: ", "left aside: /ir/image_raw"]),
        ("oak", ["depth is registered to color", "in odom (/odom)", "left aside: /oak/left"]),
    ] {
        let live = Live::start(folder.path(), device, FRAMES);
        let options = BridgeOptions::new(&live.address, &server.grpc, device);
        let told = Mutex::new(String::new());
        let tell = |event| {
            if let BridgeEvent::Told(what) = event {
                *told.lock().expect("nothing panics") += &format!("{what}\n");
            }
        };
        let counts = timeout(AT_MOST, bridge(&options, live.done(), tell)).await.expect("it ends");
        let told = told.into_inner().expect("nothing panics");
        let counts = counts.unwrap_or_else(|error| panic!("{error}\n{told}"));
        println!("{device}: {counts:?}\n{told}");
        assert_eq!((counts.lost, counts.refused, counts.dropped, counts.damaged), (0, 0, 0, 0));
        assert!(counts.acknowledged >= FRAMES as u64 - 1, "{counts:?}");
        expected.iter().for_each(|part| assert!(told.contains(part), "{part}: {told}"));
        server.settled(device).await;
        let [found, _] = compared(&server, device, &truth).await;
        let limits = if device == "oak" { CLOSE } else { TRACKED };
        let is_close = |[metres, radians]: [f64; 2]| metres < limits[0] && radians < limits[1];
        assert!(is_close(found), "{device}: {found:?}");
        let still = vec![truth[0]; FRAMES];
        let [still, _] = compared(&server, device, &still).await;
        assert!(!is_close(still), "negative control: {device}: {still:?}");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bridge_that_cannot_work_says_why() {
    let nobody = TcpListener::bind("127.0.0.1:0").await.expect("a port is free");
    let address = nobody.local_addr().expect("it is bound").to_string();
    drop(nobody);
    let told = Mutex::new(Vec::new());
    let tell = |event| {
        if let BridgeEvent::Told(what) = event {
            told.lock().expect("nothing panics").push(what);
        }
    };
    // A robot that is not there may come.
    let wait = || tokio::time::sleep(Duration::from_millis(1200));
    let error = bridge(&BridgeOptions::new(&address, &address, "m"), wait(), tell)
        .await
        .expect_err("nobody");
    assert!(matches!(error, BridgeError::NoFrames { .. }), "{error}");
    let found = told.lock().expect("nothing panics").join("\n");
    assert!(found.contains("cannot connect to ws://127.0.0.1:"), "{found}");
    assert!(found.contains("trying again in 1.0 s"), "the waits grow: {found}");
    for wrong in ["ftp://robot:8765", "ws://", "ws://a b", "ws://robot:99999", "robot:port"] {
        let error = bridge(&BridgeOptions::new(wrong, &address, "m"), wait(), tell)
            .await
            .expect_err("wrong");
        assert!(matches!(error, BridgeError::Address { .. }), "{wrong}: {error}");
        assert!(error.to_string().contains("expected ws://HOST:PORT"), "{error}");
    }
    // A server that does not know who is calling says so before any robot is there.
    let mut config = tiny_config();
    let (_, line) = issue("robot", &[Scope::Write], "m", None).expect("a token");
    config.access.entries = vec![line];
    let server = Server::start(config).await;
    let options = BridgeOptions::new(&address, &server.grpc, "m");
    let ended = timeout(AT_MOST, bridge(&options, pending(), |_| {})).await;
    let error = ended.expect("it ends").expect_err("nobody is known");
    assert!(matches!(error, BridgeError::Server(ClientError::Refused { .. })), "{error}");
    assert!(error.to_string().contains("asks who is calling"), "{error}");
    server.stop().await;
}
