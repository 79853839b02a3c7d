//! Maps and their files.

use super::{FRAME, Server, mapped};
use axum::body::{Body, Bytes};
use axum::http::Request;
use serde_json::json;

#[tokio::test]
async fn maps_are_made_listed_and_deleted() {
    let server = Server::start();
    let made = server.post("/v1/maps", json!({"name": "crud"}).to_string()).await;
    assert_eq!((made.status, made.header("location")), (201, "maps/crud"));
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
async fn maps_are_renamed() {
    let server = Server::start();
    server.post("/v1/maps", json!({"name": "first"}).to_string()).await;
    let patch = |map: &str, body: &serde_json::Value| {
        let request = Request::patch(format!("/v1/maps/{map}"));
        let request = request.header("content-type", "application/json");
        request.body(Body::from(body.to_string())).unwrap()
    };
    let second = json!({"name": "second"});
    server.problem(patch("nowhere", &second), 404, "name").await;
    server.problem(patch("first", &json!({"name": "../x"})), 400, "name").await;
    let renamed = server.send(patch("first", &second)).await;
    assert_eq!((renamed.status, &renamed.json()["name"]), (200, &json!("second")));
    assert_eq!(server.get("/v1/maps/first").await.status, 404);
    // This server has no data directory, so frames cannot be kept.
    mapped("kept").await;
    let refused = server.send(patch("kept", &json!({"name": "other"}))).await;
    assert_eq!(refused.status, 409);
    assert!(refused.json()["detail"].as_str().unwrap().contains("--data-dir"));
    assert_eq!(server.get("/v1/maps/kept").await.json()["frames_received"], 1);
}

#[tokio::test]
async fn lists_come_in_pages() {
    let server = Server::start();
    for name in ["page-a", "page-b", "page-c"] {
        server.post("/v1/maps", json!({"name": name}).to_string()).await;
    }
    let (mut after, mut seen) = (None, Vec::new());
    loop {
        let after_that = after.map(|after| format!("&after={after}")).unwrap_or_default();
        let page = server.get(&format!("/v1/maps?limit=2{after_that}")).await.json();
        let maps = page["maps"].as_array().unwrap();
        assert!(maps.len() <= 2);
        seen.extend(maps.iter().map(|map| map["name"].as_str().unwrap().to_owned()));
        let Some(next) = page["next"].as_str() else { break };
        after = Some(next.to_owned());
    }
    let all = server.get("/v1/maps").await.json();
    let all = all["maps"].as_array().unwrap().iter();
    let all: Vec<_> = all.map(|map| map["name"].as_str().unwrap().to_owned()).collect();
    assert_eq!(seen, all);
    assert!(["page-a", "page-b", "page-c"].iter().all(|name| seen.iter().any(|map| map == name)));
    mapped("paged").await;
    let frames = server.get("/v1/maps/paged/frames?limit=1").await.json();
    assert_eq!(
        (frames["frames"][0]["sequence"].as_u64(), &frames["next"]),
        (Some(FRAME), &json!(null))
    );
    let rest = server.get(&format!("/v1/maps/paged/frames?after={FRAME}")).await.json();
    assert_eq!(rest["frames"], json!([]));
    server.problem_get("/v1/maps?limit=0", 400, "limit").await;
    server.problem_get("/v1/maps?limit=x", 400, "limit").await;
    server.problem_get("/v1/maps/paged/frames?after=x", 400, "after").await;
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
async fn meshes_have_options() {
    let server = Server::start();
    mapped("meshed").await;
    let path = |options: &str| format!("/v1/maps/meshed/export/mesh.ply{options}");
    let plain = server.get(&path("?voxel_metres=0.04")).await;
    assert_eq!(plain.status, 200, "{:?}", plain.body);
    let text = String::from_utf8_lossy(&plain.body);
    assert!(text.contains("property list uchar int vertex_indices"), "{text}");
    assert!(!text.contains("element face 0\n") && !text.contains("relevancy"), "{text}");
    let asked = server.get(&path("?voxel_metres=0.04&text=red+wall")).await;
    assert!(String::from_utf8_lossy(&asked.body).contains("property float relevancy\n"));
    // Another question is another file.
    assert_ne!(plain.header("etag"), asked.header("etag"));
    let part =
        server.get_with(&path("?voxel_metres=0.04&text=red+wall"), "range", "bytes=0-2").await;
    assert_eq!((part.status, &part.body[..]), (206, &b"ply"[..]));
    for (options, field) in [
        ("?voxel_metres=0", "voxel_metres"),
        ("?voxel_metres=NaN", "voxel_metres"),
        ("?text=", "text"),
        ("?vxl=1", "vxl"),
    ] {
        server.problem_get(&path(options), 400, field).await;
    }
    server
        .problem_get("/v1/maps/meshed/export/splats.ply?voxel_metres=0.1", 400, "voxel_metres")
        .await;
}
