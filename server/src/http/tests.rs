//! The routes, without a socket, in front of a real pipeline and a map of one small frame.

use super::*;
use crate::pipeline::frame::Frame;
use crate::test_support::{CAMERA, engine};
use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, Request};
use nalgebra::Isometry3;
use serde_json::{Value, json};
use std::time::Instant;
use tower::Service as _;

/// The sequence of the one frame.
const FRAME: u64 = 7;
/// How long the mapper may take for it.
const PATIENCE: Duration = Duration::from_secs(120);

struct Server {
    router: Router,
    _ready: watch::Sender<bool>,
    stopping: CancellationToken,
}

struct Reply {
    status: u16,
    headers: HeaderMap,
    body: Bytes,
}

impl Reply {
    fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap()
    }

    fn header(&self, name: &str) -> &str {
        self.headers[name].to_str().unwrap()
    }
}

impl Server {
    fn start() -> Self {
        let (ready_in, ready) = watch::channel(true);
        let stopping = CancellationToken::new();
        let router = router(Context {
            engine: engine(),
            store: Store::default(),
            config: HttpConfig { max_body_bytes: 16 << 10, ..HttpConfig::default() },
            ready,
            stopping: stopping.clone(),
        });
        Self { router, _ready: ready_in, stopping }
    }

    async fn send(&self, request: Request<Body>) -> Reply {
        let response = self.router.clone().call(request).await.unwrap();
        let (status, headers) = (response.status().as_u16(), response.headers().clone());
        let body = axum::body::to_bytes(response.into_body(), usize::MAX).await.unwrap();
        Reply { status, headers, body }
    }

    async fn get(&self, path: &str) -> Reply {
        self.send(Request::get(path).body(Body::empty()).unwrap()).await
    }

    async fn get_with(&self, path: &str, name: &str, value: &str) -> Reply {
        self.send(Request::get(path).header(name, value).body(Body::empty()).unwrap()).await
    }

    async fn post(&self, path: &str, body: impl Into<Body>) -> Reply {
        self.send(Request::post(path).body(body.into()).unwrap()).await
    }

    /// Checks that the answer is a problem with this status and field.
    async fn problem(&self, request: Request<Body>, status: u16, field: &str) {
        let what = format!("{} {}", request.method(), request.uri());
        let reply = self.send(request).await;
        let text = String::from_utf8_lossy(&reply.body).into_owned();
        assert_eq!(reply.status, status, "{what}: {text}");
        assert_eq!(reply.header("content-type"), "application/problem+json", "{what}");
        let problem = reply.json();
        assert_eq!(problem["status"], status);
        for key in ["type", "title", "detail"] {
            assert!(problem[key].as_str().is_some_and(|text| !text.is_empty()), "{what}: {text}");
        }
        assert_eq!(problem["field"].as_str().unwrap_or_default(), field, "{what}: {text}");
    }

    async fn problem_get(&self, path: &str, status: u16, field: &str) {
        self.problem(Request::get(path).body(Body::empty()).unwrap(), status, field).await;
    }

    async fn problem_post(&self, path: &str, body: &Value, status: u16, field: &str) {
        let request = Request::post(path).body(body.to_string().into()).unwrap();
        self.problem(request, status, field).await;
    }
}

/// A wall 2 m away, red on the left and blue on the right.
fn wall() -> Frame {
    let pixels = (CAMERA.width * CAMERA.height) as usize;
    let column = |at: usize| at as u32 % CAMERA.width;
    let rgb = |at| if column(at) < CAMERA.width / 2 { [200, 40, 40] } else { [40, 40, 200] };
    Frame {
        sequence: FRAME,
        timestamp_nanos: 1_500_000_000,
        intrinsics: CAMERA,
        rgb: (0..pixels).flat_map(rgb).collect::<Vec<u8>>().into(),
        depth_metres: vec![2.0; pixels].into(),
        world_from_camera: Some(Isometry3::identity()),
        hint: None,
        labels: None,
        held_out: false,
    }
}

/// A map of the wall that the mapper has finished.
async fn mapped(name: &str) -> Arc<crate::pipeline::map::Map> {
    let map = engine().open(name).unwrap();
    let guard = map.claim(CAMERA).unwrap();
    guard.map().submit(wall()).await.unwrap().await.unwrap();
    let started = Instant::now();
    while !(map.status().settled && map.snapshot().keyframes.len() == 1) {
        assert!(started.elapsed() < PATIENCE, "{:?}", map.status());
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    map
}

#[tokio::test]
async fn unknown_things_are_problems() {
    let server = Server::start();
    server.problem_get("/v2/maps", 404, "").await;
    server.problem_get("/v1/maps/nowhere", 404, "name").await;
    server.problem_get("/v1/maps/%ff", 400, "").await;
    server.problem_get("/v1/maps/nowhere/render?frame=1", 404, "name").await;
    server.problem_get("/v1/maps/nowhere/events", 404, "name").await;
    let patch = Request::patch("/v1/maps").body(Body::empty()).unwrap();
    server.problem(patch, 405, "").await;
    let delete = Request::delete("/v1/maps/nowhere").body(Body::empty()).unwrap();
    server.problem(delete, 404, "name").await;
}

#[tokio::test]
async fn maps_are_made_listed_and_deleted() {
    let server = Server::start();
    let made = server.post("/v1/maps", json!({"name": "crud"}).to_string()).await;
    assert_eq!((made.status, made.header("location")), (201, "/v1/maps/crud"));
    assert_eq!(made.json()["tracking_state"], "empty");
    server.problem_post("/v1/maps", &json!({"name": "crud"}), 409, "name").await;
    server.problem_post("/v1/maps", &json!({"name": "../x"}), 400, "name").await;
    server.problem_post("/v1/maps", &json!({"nam": "x"}), 400, "nam").await;
    server.problem_post("/v1/maps", &json!({"name": 3}), 400, "name").await;
    let listed = server.get("/v1/maps").await.json();
    assert!(listed["maps"].as_array().unwrap().iter().any(|map| map["name"] == "crud"));
    let metrics = server.get("/metrics").await;
    let text = std::str::from_utf8(&metrics.body).unwrap();
    assert!(text.contains("lexsplat_map_gaussians{map=\"crud\"} 0\n"), "{text}");
    let delete = Request::delete("/v1/maps/crud").body(Body::empty()).unwrap();
    assert_eq!(server.send(delete).await.status, 204);
    assert_eq!(server.get("/v1/maps/crud").await.status, 404);
    let text = server.get("/metrics").await.body;
    assert!(!std::str::from_utf8(&text).unwrap().contains("map=\"crud\""));
}

#[tokio::test]
async fn bad_questions_name_their_field() {
    let server = Server::start();
    engine().open("questions").unwrap();
    let path = "/v1/maps/questions/query";
    let pose: Vec<f64> = Isometry3::<f64>::identity().to_homogeneous().as_slice().to_vec();
    let camera = json!({"width": 64, "height": 48, "fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5});
    let with = |key: &str, value: Value| {
        let mut body = json!({"text": "cup"});
        body[key] = value;
        body
    };
    let mut wide = camera.clone();
    wide["width"] = json!(100_000);
    for (body, field) in [
        (json!({}), "text"),
        (json!({"text": "  "}), "text"),
        (json!({"text": "x".repeat(10_000)}), "text"),
        (json!({"text": 3}), "text"),
        (with("txt", json!("cup")), "txt"),
        (with("threshold", json!(1.5)), "threshold"),
        (with("threshold", json!(-0.5)), "threshold"),
        (with("smoothing", json!(-1)), "smoothing"),
        (with("smoothing", json!(100_000)), "smoothing"),
        (with("max_objects", json!(0)), "max_objects"),
        (with("negatives", json!(["a", ""])), "negatives[1]"),
        (with("outputs", json!(["heat"])), "outputs"),
        (with("outputs", json!(["heatmap"])), "outputs"),
        (with("view", json!({})), "view.frame"),
        (with("view", json!({"frame": "x"})), "view.frame"),
        (with("view", json!({"camera": camera})), "view.world_from_camera"),
        (with("view", json!({"camera": wide, "world_from_camera": pose})), "view.camera.width"),
        (
            with("view", json!({"camera": camera, "world_from_camera": [1]})),
            "view.world_from_camera",
        ),
    ] {
        server.problem_post(path, &body, 400, field).await;
    }
    server.problem_post(path, &with("view", json!({"frame": 999})), 404, "view.frame").await;
    let broken = server.post(path, "{\"text\":\n oops}").await;
    assert!(broken.json()["detail"].to_string().contains("line 2 column"), "{:?}", broken.body);
    let long = json!({"text": "x".repeat(20_000)});
    server.problem_post(path, &long, 413, "").await;
    let good = server.post(path, json!({"text": "cup"}).to_string()).await;
    assert_eq!(good.status, 200, "{:?}", good.body);
    assert_eq!(good.json()["present"], false, "the map is empty");
}

#[tokio::test]
async fn a_question_about_a_view_has_a_heat_map_to_fetch() {
    let server = Server::start();
    mapped("asked").await;
    let body = json!({"text": "red wall", "view": {"frame": FRAME}});
    let reply = server.post("/v1/maps/asked/query", body.to_string()).await;
    assert_eq!(reply.status, 200, "{:?}", reply.body);
    let answer = reply.json();
    assert_eq!(answer["heatmap"]["width"], 64);
    assert_eq!(answer["mask"]["size"], json!([48, 64]));
    let url = answer["heatmap"]["url"].as_str().unwrap();
    let picture = server.get(url).await;
    assert_eq!(picture.header("content-type"), "image/png");
    let picture = image::load_from_memory(&picture.body).unwrap();
    assert_eq!((picture.width(), picture.height()), (64, 48));
    let array = server.get_with(url, "accept", "application/x-npy").await;
    assert_eq!(array.header("content-type"), "application/x-npy");
    assert!(array.body.starts_with(b"\x93NUMPY"));
    assert_eq!(array.body.len() % 64, (64 * 48 * 4) % 64);
    server.problem_get(&url.replace("heatmap", "points"), 404, "").await;
    server.problem_get("/v1/maps/asked/queries/0/heatmap", 404, "query_id").await;

    let body = json!({"text": "red wall", "threshold": 0});
    let answer = server.post("/v1/maps/asked/query", body.to_string()).await.json();
    assert!(answer.get("heatmap").is_none() && answer["objects"].is_array(), "{answer}");
    let points = server.get(answer["points"]["url"].as_str().unwrap()).await;
    let text = String::from_utf8_lossy(&points.body);
    assert!(text.contains(&format!("element vertex {}\n", answer["points"]["count"])), "{text}");
}

#[tokio::test]
async fn pictures_have_the_size_that_is_asked_for() {
    let server = Server::start();
    mapped("pictured").await;
    let path = |rest: &str| format!("/v1/maps/pictured/render?frame={FRAME}{rest}");
    for (rest, size) in [("", (64, 48)), ("&width=32", (32, 24)), ("&width=20&height=30", (20, 30))]
    {
        for channel in ["color", "language", "opacity", "depth"] {
            let reply = server.get(&path(&format!("&channel={channel}{rest}"))).await;
            assert_eq!(reply.status, 200, "{:?}", reply.body);
            let picture = image::load_from_memory(&reply.body).unwrap();
            assert_eq!((picture.width(), picture.height()), size, "{channel}{rest}");
            assert_eq!(channel == "depth", picture.color() == image::ColorType::L16);
        }
    }
    let depth = server.get_with(&path("&channel=depth"), "accept", "application/x-npy").await;
    assert_eq!(depth.header("content-type"), "application/x-npy");
    for (rest, field) in [
        ("&width=0", "width"),
        ("&height=5000", "height"),
        ("&width=4096&height=4096", "width"),
        ("&channel=smell", "channel"),
        ("&wdth=3", "wdth"),
    ] {
        server.problem_get(&path(rest), 400, field).await;
    }
    server.problem_get("/v1/maps/pictured/render?frame=999", 404, "view.frame").await;
    server.problem_get("/v1/maps/pictured/render?frame=x", 400, "frame").await;
    server.problem_get("/v1/maps/pictured/render", 400, "frame").await;
    let pose: Vec<f64> = Isometry3::<f64>::identity().to_homogeneous().as_slice().to_vec();
    let camera = json!({"width": 30, "height": 20, "fx": 30, "fy": 30, "cx": 15, "cy": 10});
    let body = json!({"camera": camera, "world_from_camera": pose});
    let reply = server.post("/v1/maps/pictured/render", body.to_string()).await;
    let picture = image::load_from_memory(&reply.body).unwrap().into_rgb8();
    assert_eq!(picture.dimensions(), (30, 20));
    let (left, right) = (picture.get_pixel(7, 10), picture.get_pixel(23, 10));
    assert!(left[0] > left[2] && right[2] > right[0], "{left:?} {right:?}");
}

#[tokio::test]
async fn frames_trajectories_and_files_are_served() {
    let server = Server::start();
    mapped("filed").await;
    let frames = server.get("/v1/maps/filed/frames").await.json();
    assert_eq!(frames["frames"][0]["sequence"], FRAME);
    assert_eq!(frames["frames"][0]["timestamp"], 1.5);
    assert_eq!(frames["frames"][0]["camera"]["fx"], 60.0);
    let trajectory = server.get("/v1/maps/filed/trajectory").await;
    let text = std::str::from_utf8(&trajectory.body).unwrap();
    assert_eq!(text.lines().filter(|line| line.starts_with("1.500000000 ")).count(), 1, "{text}");

    let path = "/v1/maps/filed/export/splats.ply";
    let whole = server.get(path).await;
    assert!(whole.body.starts_with(b"ply\n"));
    let part = server.get_with(path, "range", "bytes=0-2").await;
    assert_eq!((part.status, &part.body[..]), (206, &b"ply"[..]));
    let same = server.get_with(path, "if-none-match", whole.header("etag")).await;
    assert_eq!(same.status, 304);
    assert_eq!(server.get_with(path, "if-none-match", "\"other\"").await.status, 200);
    assert!(server.get("/v1/maps/filed/export/points.ply").await.body.starts_with(b"ply\n"));
    let starts = |body: &Bytes, with: &[u8]| assert!(body.starts_with(with), "{:?}", &body[..20]);
    starts(&server.get("/v1/maps/filed/export/splats.spz").await.body, b"\x1f\x8b");
    let glb = server.get("/v1/maps/filed/export/splats.glb").await;
    starts(&glb.body, b"glTF");
    assert_eq!(glb.header("content-type"), "model/gltf-binary");
    starts(&server.get("/v1/maps/filed/export/language.npz").await.body, b"PK\x03\x04");
    server.problem_get("/v1/maps/filed/export/splats.obj", 404, "file").await;
}

#[tokio::test]
async fn several_words_have_labels_to_fetch_and_places_are_checked() {
    let server = Server::start();
    mapped("labelled").await;
    let path = "/v1/maps/labelled/query";
    let body = json!({"texts": ["red wall", "blue sky"], "view": {"frame": FRAME}, "threshold": 0});
    let reply = server.post(path, body.to_string()).await;
    assert_eq!(reply.status, 200, "{:?}", reply.body);
    let answer = reply.json();
    assert_eq!(answer["legend"][1]["text"], "blue sky");
    assert_eq!(answer["legend"][1]["label"], 2);
    assert!(answer.get("heatmap").is_none() && answer["legend"][0]["color"].is_string());
    let url = answer["labels"]["url"].as_str().unwrap();
    let picture = image::load_from_memory(&server.get(url).await.body).unwrap();
    assert_eq!((picture.width(), picture.height()), (64, 48));
    let array = server.get_with(url, "accept", "application/x-npy").await;
    assert_eq!(array.body.len() % 64, (64 * 48) % 64);
    assert!(String::from_utf8_lossy(&array.body).contains("'|u1'"));
    server.problem_get(&url.replace("labels", "points"), 404, "").await;

    let body = json!({"texts": ["red wall", "blue sky"]});
    let answer = server.post(path, body.to_string()).await.json();
    let url = answer["points"]["url"].as_str().unwrap();
    let points = server.get(url).await;
    assert!(String::from_utf8_lossy(&points.body).contains("property uchar label\n"));
    server.problem_get(&url.replace("points", "labels"), 404, "").await;

    let near = json!({"text": "wall", "near": [0.0, 0.0, 1.0], "threshold": 0.0});
    let answer = server.post(path, near.to_string()).await.json();
    for object in answer["objects"].as_array().unwrap() {
        assert!(object["distance"].as_f64().unwrap() >= 0.0, "{object}");
    }
    let frame = json!({"frame": FRAME});
    for (body, field) in [
        (json!({"texts": ["a"]}), "texts"),
        (json!({"texts": ["a", "b"], "text": "c"}), "text"),
        (json!({"texts": ["a", "b", "a"]}), "texts[2]"),
        (json!({"texts": ["a", 3]}), "texts[1]"),
        (json!({"texts": ["a", "b"], "outputs": ["mask"]}), "outputs"),
        (json!({"text": "a", "near": [1.0, 2.0]}), "near"),
        (json!({"text": "a", "near": [0, 0, 0], "view": frame}), "near"),
        (json!({"text": "a", "within": {"min": [0, 0, 0]}}), "within.max"),
        (json!({"text": "a", "within": {"min": [1, 0, 0], "max": [0, 1, 1]}}), "within.max"),
    ] {
        server.problem_post(path, &body, 400, field).await;
    }
}

#[tokio::test]
async fn meshes_have_options() {
    let server = Server::start();
    mapped("meshed").await;
    let path = |options: &str| format!("/v1/maps/meshed/export/mesh.ply{options}");
    let plain = server.get(&path("?voxel=0.04")).await;
    assert_eq!(plain.status, 200, "{:?}", plain.body);
    let text = String::from_utf8_lossy(&plain.body);
    assert!(text.contains("property list uchar int vertex_indices"), "{text}");
    assert!(!text.contains("element face 0\n") && !text.contains("relevancy"), "{text}");
    let asked = server.get(&path("?voxel=0.04&text=red+wall")).await;
    assert!(String::from_utf8_lossy(&asked.body).contains("property float relevancy\n"));
    // Another question is another file.
    assert_ne!(plain.header("etag"), asked.header("etag"));
    let part = server.get_with(&path("?voxel=0.04&text=red+wall"), "range", "bytes=0-2").await;
    assert_eq!((part.status, &part.body[..]), (206, &b"ply"[..]));
    for (options, field) in
        [("?voxel=0", "voxel"), ("?voxel=NaN", "voxel"), ("?text=", "text"), ("?vxl=1", "vxl")]
    {
        server.problem_get(&path(options), 400, field).await;
    }
    server.problem_get("/v1/maps/meshed/export/splats.ply?voxel=0.1", 400, "voxel").await;
}

#[tokio::test]
async fn events_begin_with_the_status_and_end_with_the_server() {
    let server = Server::start();
    let map = mapped("watched").await;
    server
        .problem(
            Request::get("/v1/maps/watched/events")
                .header("last-event-id", "x")
                .body(Body::empty())
                .unwrap(),
            400,
            "Last-Event-ID",
        )
        .await;
    let request = || Request::get("/v1/maps/watched/events").body(Body::empty()).unwrap();
    let response = server.router.clone().call(request()).await.unwrap();
    assert_eq!(response.headers()["content-type"], "text/event-stream");
    let guard = map.claim(CAMERA).unwrap();
    let next = Frame { sequence: FRAME + 1, ..wall() };
    guard.map().submit(next).await.unwrap().await.unwrap();
    let stopping = server.stopping.clone();
    tokio::spawn(async move {
        tokio::time::sleep(Duration::from_millis(500)).await;
        stopping.cancel();
    });
    let body = axum::body::to_bytes(response.into_body(), usize::MAX).await.unwrap();
    let text = std::str::from_utf8(&body).unwrap();
    assert!(text.starts_with("event: status\n"), "{text}");
    assert!(text.contains("event: frame\nid: ") && text.contains("\"sequence\":8"), "{text}");
    assert_eq!(server.get("/readyz").await.status, 503, "it stops");
}

#[tokio::test]
async fn the_server_describes_itself() {
    let server = Server::start();
    assert_eq!(server.get("/healthz").await.json()["status"], "alive");
    assert_eq!(server.get("/readyz").await.json()["status"], "ready");
    let document = server.get("/openapi.json").await.json();
    assert!(document["openapi"].as_str().unwrap().starts_with("3.1"), "{document}");
    for (path, method) in [
        ("/v1/maps", "post"),
        ("/v1/maps/{name}", "delete"),
        ("/v1/maps/{name}/query", "post"),
        ("/v1/maps/{name}/frames", "get"),
        ("/v1/maps/{name}/render", "post"),
        ("/v1/maps/{name}/trajectory", "get"),
        ("/v1/maps/{name}/export/{file}", "get"),
        ("/v1/maps/{name}/events", "get"),
    ] {
        assert!(document["paths"][path][method].is_object(), "{method} {path}");
    }
    let page = server.get("/").await;
    assert!(page.header("content-type").starts_with("text/html"));
    for file in ["style.css", "app.js", "plan.js"] {
        let reply = server.get(&format!("/dashboard/{file}")).await;
        assert_eq!(reply.status, 200);
        let html = std::str::from_utf8(&page.body).unwrap();
        let script = server.get("/dashboard/app.js").await.body;
        let named = html.contains(file) || String::from_utf8_lossy(&script).contains(file);
        assert!(named, "{file} is used by the page");
    }
}
