//! A client that shares nothing with lexsplat but the wire: Python's gRPC and the server's reflection.

use lexsplat_server::access::{Scope, issue};
use lexsplat_synthetic as synthetic;
use lexsplat_tests::{Robot, Server, python, said, tiny_config};

/// The example with a token, and without one.
#[tokio::test(flavor = "multi_thread")]
async fn python_says_who_it_is() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let plan =
        synthetic::Plan { seed: 5, frames: 1, every: 1, camera: synthetic::Camera::new(160, 120) };
    synthetic::write(folder.path(), &plan, |_| {}).expect("the room can be written");
    let (token, line) = issue("python", &[Scope::Write], "asked", None).expect("a token");
    let mut config = tiny_config();
    config.access.entries = vec![line];
    let server = Server::start(config).await;
    for (token, map, expected) in [
        (Some(&*token), "asked", "1 frames tracked"),
        (Some(&*token), "other", "may not use the map"),
        (None, "asked", "asks who is calling"),
    ] {
        let mut robot = python("client/examples/robot.py", &["python"]);
        robot.env_remove("LEXSPLAT_TOKEN").arg(folder.path());
        robot.args(["--server", &server.grpc, "--map", map]);
        robot.args(token.iter().flat_map(|token| ["--token", token]));
        let output = robot.output().expect("python3 runs");
        let said = String::from_utf8_lossy(&output.stdout);
        let complained = String::from_utf8_lossy(&output.stderr);
        assert!(said.contains(expected) || complained.contains(expected), "{said}{complained}");
        assert_eq!(output.status.success(), expected.contains("tracked"), "{said}{complained}");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn python_streams_and_a_heat_map_comes_back_as_npy() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let plan =
        synthetic::Plan { seed: 5, frames: 12, every: 1, camera: synthetic::Camera::new(160, 120) };
    synthetic::write(folder.path(), &plan, |_| {}).expect("the room can be written");
    let server = Server::start(tiny_config()).await;
    let labels = ["--frames", "2", "--labels"];
    for (map, options, tracked) in
        [("outside", &[][..], "12 frames tracked"), ("labelled", &labels, "2 frames tracked")]
    {
        let mut robot = python("client/examples/robot.py", &["python"]);
        robot.arg(folder.path()).args(["--server", &server.grpc, "--map", map]).args(options);
        let said = said(&mut robot);
        assert!(said.contains(tracked) && !said.contains("refused"), "{said}");
        server.settled(map).await;
    }

    let http = reqwest::Client::new();
    let answer: serde_json::Value = http
        .post(format!("http://{}/v1/maps/outside/query", server.http))
        .json(&serde_json::json!({"text": "chair", "view": {"frame": 0}}))
        .send()
        .await
        .expect("the server answers")
        .json()
        .await
        .expect("with JSON");
    let url = answer["heatmap"]["url"].as_str().unwrap_or_else(|| panic!("no heat map: {answer}"));
    let npy = http
        .get(format!("http://{}/v1/maps/outside/{url}", server.http))
        .header("Accept", "application/x-npy")
        .send()
        .await
        .expect("the server answers")
        .bytes()
        .await
        .expect("with bytes");
    assert_eq!(&npy[..6], b"\x93NUMPY");
    // A comma may follow the last size of a shape.
    let header = String::from_utf8_lossy(&npy[10..128]).replace(", )", ")");
    assert!(header.contains("'<f4'") && header.contains("(120, 160)"), "{header}");
    assert_eq!(npy.len() % 64, (120 * 160 * 4) % 64, "a header of whole 64 bytes, then the values");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn health_is_told_the_way_grpc_tells_it() {
    use tonic_health::pb::HealthCheckRequest;
    use tonic_health::pb::health_check_response::ServingStatus;
    use tonic_health::pb::health_client::HealthClient;
    let server = Server::start(tiny_config()).await;
    let channel = tonic::transport::Channel::from_shared(format!("http://{}", server.grpc))
        .expect("it is an address")
        .connect()
        .await
        .expect("it listens");
    let mut health = HealthClient::new(channel);
    let mut ask =
        async |service: &str| health.check(HealthCheckRequest { service: service.into() }).await;
    let mapping = ask("lexsplat.v1.Mapping").await.expect("it is known").into_inner();
    assert_eq!(mapping.status(), ServingStatus::Serving);
    assert!(ask("lexsplat.v1.Nothing").await.is_err(), "what is not there is not healthy");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn another_library_reads_a_recording() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let mut config = tiny_config();
    config.server.data_dir = Some(folder.path().to_owned());
    let server = Server::start(config).await;
    let robot = Robot::new(7, 3);
    server.stream(&robot, "recorded").await;
    server.stop().await;
    let mut reader = python("tests/outside/recording.py", &["mcap"]);
    let said = said(reader.arg(folder.path().join("recorded.map/0001.mcap")));
    let found: serde_json::Value = serde_json::from_str(&said).expect("JSON");
    for (topic, schema, messages) in [
        ("/camera/calibration", "foxglove.CameraCalibration", 1),
        ("/camera/color", "foxglove.CompressedImage", 3),
        ("/camera/depth", "foxglove.CompressedImage", 3),
        ("/camera/pose", "foxglove.PoseInFrame", 3),
        ("/lexsplat/frame", "lexsplat.v1.Frame", 3),
    ] {
        let wanted = serde_json::json!({"schema": schema, "messages": messages});
        assert_eq!(found["topics"][topic], wanted, "{topic}");
    }
    assert_eq!(found["color"], "ffd8ff", "a JPEG image");
    let is_near = |found: &serde_json::Value, wanted: f64| {
        found.as_f64().is_some_and(|found| (found - wanted).abs() < 1e-9)
    };
    assert!(is_near(&found["fx"], robot.camera.fx), "{found}");
    let position = robot.poses[0].translation.vector;
    assert!((0..3).all(|axis| is_near(&found["position"][axis], position[axis])), "{found}");
}
