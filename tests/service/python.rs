//! The Python package: its wheel is built and installed, and its own tests (`client/python/tests`, pytest)
//! talk to servers of this process.

use lexsplat_server::access::{Scope, issue};
use lexsplat_server::config::TlsConfig;
use lexsplat_synthetic::{Camera, Plan, Room, View, depth_png, jpeg, write};
use lexsplat_tests::{Authority, Server, program, root, tiny_config};
use nalgebra::{Isometry3, Vector3};
use serde_json::json;
use std::path::Path;
use std::process::Command;

/// Where `deploy/setup.sh --tests` installs what the package needs.
const DEPENDENCIES: &str = ".deps/client";

/// The room, and the walk through it.
const PLAN: Plan = Plan { seed: 5, frames: 48, every: 4, camera: COLOR };
/// Color, and depth that is registered to it.
const COLOR: Camera = Camera { width: 160, height: 120, fx: 114.0, fy: 114.0, cx: 79.5, cy: 59.5 };
/// Depth of a camera of its own.
const DEPTH: Camera = Camera { width: 144, height: 128, fx: 96.0, fy: 97.0, cx: 70.0, cy: 65.0 };
/// Depth that a phone takes through color's lens: pixel edges stay edges.
const PHONE: Camera = Camera { width: 80, height: 60, fx: 57.0, fy: 57.0, cx: 39.5, cy: 29.5 };

/// Writes what devices see on the walk: depth of a camera 5 cm beside color's, and depth of a phone.
fn write_device(folder: &Path) {
    let turn = Vector3::y() * 2.0_f64.to_radians();
    let color_from_depth = Isometry3::new(Vector3::new(0.05, 0.004, -0.003), turn);
    let list = |c: Camera| json!([c.width, c.height, c.fx, c.fy, c.cx, c.cy]);
    let calibration = json!({
        "color": list(COLOR),
        "depth": list(DEPTH),
        "phone": list(PHONE),
        "color_from_depth": color_from_depth.to_homogeneous().transpose().as_slice(),
    });
    std::fs::create_dir(folder).expect("it can be made");
    std::fs::write(folder.join("calibration.json"), calibration.to_string()).expect("disk");
    let room = Room::new(PLAN.seed);
    for (at, pose) in room.path(PLAN.frames).iter().step_by(PLAN.every).enumerate() {
        let save = |name: &str, bytes: Vec<u8>| {
            std::fs::write(folder.join(format!("{name}{at:06}")), bytes).expect("disk");
        };
        let depth = |view: &View| depth_png(view).expect("it encodes");
        save("color", jpeg(&room.render(&COLOR, pose)).expect("it encodes"));
        save("depth", depth(&room.render(&DEPTH, &(pose * color_from_depth))));
        save("phone", depth(&room.render(&PHONE, pose)));
    }
}

/// Builds the wheel as a user's pip does, and installs it into an empty folder.
fn install(folder: &Path) {
    let wheels = folder.join("wheels");
    let pip = |arguments: &[&str]| {
        let output = Command::new("python3")
            .env("PYTHONPATH", root().join(DEPENDENCIES))
            .args(["-m", "pip", "--quiet", "--disable-pip-version-check"])
            .args(arguments)
            .output()
            .expect("python3 runs");
        let complained = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{complained} (make test installs what it needs)");
    };
    let (source, target) = (root().join("client/python"), folder.join("installed"));
    let text = |path: &Path| path.to_str().expect("it is text").to_owned();
    let build = ["wheel", "--no-deps", "--no-index", "--no-build-isolation", "--wheel-dir"];
    pip(&[&build[..], &[&text(&wheels), &text(&source)]].concat());
    let mut made = std::fs::read_dir(&wheels).expect("pip made it");
    let wheel = made.next().expect("one wheel").expect("it can be listed").path();
    assert!(made.next().is_none(), "nothing but the wheel");
    pip(&["install", "--no-deps", "--no-index", "--target", &text(&target), &text(&wheel)]);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_python_client_passes_its_tests() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let folder = folder.path();
    install(folder);
    let (room, device) = (folder.join("room"), folder.join("device"));
    write(&room, &PLAN, |_| {}).expect("the room can be written");
    write_device(&device);

    let mut config = tiny_config();
    config.server.data_dir = Some(folder.join("data"));
    let open = Server::start(config).await;
    let (token, line) =
        issue("python", &[Scope::Read, Scope::Write], "own*", None).expect("a token");
    let authority = Authority::new("the robots' authority");
    let certified = authority.issue("127.0.0.1");
    let [certificate, key, ca] =
        ["server.pem", "server.key", "ca.pem"].map(|name| folder.join(name));
    for (file, pem) in
        [(&certificate, &*certified.certificate), (&key, &*certified.key), (&ca, authority.pem())]
    {
        std::fs::write(file, pem).expect("it can be written");
    }
    let mut config = tiny_config();
    config.access.entries = vec![line];
    config.server.tls = Some(TlsConfig { certificate, key, client_ca: None });
    let guarded = Server::start(config).await;

    let package = root().join("client/python");
    let path = [folder.join("installed"), root().join(DEPENDENCIES)];
    let mut tests = Command::new("python3");
    tests
        .current_dir(&package)
        .env("PYTHONPATH", std::env::join_paths(path).expect("no colons"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env_remove("LEXSPLAT_TOKEN")
        .env_remove("LEXSPLAT_CA")
        .env("LEXSPLAT_TEST_ROOM", &room)
        .env("LEXSPLAT_TEST_DEVICE", &device)
        .env("LEXSPLAT_TEST_PROGRAM", program("lexsplat-server"))
        .env("LEXSPLAT_TEST_GRPC", &open.grpc)
        .env("LEXSPLAT_TEST_GUARDED", &guarded.grpc)
        .env("LEXSPLAT_TEST_TOKEN", &*token)
        .env("LEXSPLAT_TEST_CA", &ca)
        .args(["-m", "pytest"]);
    let output = tests.output().expect("python3 runs");
    let said = String::from_utf8_lossy(&output.stdout);
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}{complained}");
    print!("{said}");
    open.stop().await;
    guarded.stop().await;
}
