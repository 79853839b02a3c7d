//! Rendered images.

use super::{FRAME, Server, mapped};
use nalgebra::Isometry3;
use serde_json::json;

#[tokio::test]
async fn images_have_the_requested_size() {
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
    // More than a software driver can render is refused; a GPU renders it.
    let large = server.get(&path("&width=2048&height=2048")).await;
    let problem = if large.status == 200 { "width".into() } else { large.json()["field"].clone() };
    assert!([200, 400].contains(&large.status) && problem == "width", "{}", large.status);
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
