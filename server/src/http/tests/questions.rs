//! Questions and their answers.

use super::{FRAME, Server, mapped};
use crate::test_support::engine;
use nalgebra::Isometry3;
use serde_json::{Value, json};

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
        (with("smoothing_pixels", json!(-1)), "smoothing_pixels"),
        (with("smoothing_pixels", json!(100_000)), "smoothing_pixels"),
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

/// The path of a link, which is relative to the address of the question.
fn below(map: &str, link: &Value) -> String {
    let link = link.as_str().unwrap();
    assert!(link.starts_with("queries/"), "{link}");
    format!("/v1/maps/{map}/{link}")
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
    let url = &below("asked", &answer["heatmap"]["url"]);
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
    let points = server.get(&below("asked", &answer["points"]["url"])).await;
    let text = String::from_utf8_lossy(&points.body);
    assert!(text.contains(&format!("element vertex {}\n", answer["points"]["count"])), "{text}");
}

#[tokio::test]
async fn several_texts_have_labels_to_fetch_and_places_are_checked() {
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
    let url = &below("labelled", &answer["labels"]["url"]);
    let picture = image::load_from_memory(&server.get(url).await.body).unwrap();
    assert_eq!((picture.width(), picture.height()), (64, 48));
    let array = server.get_with(url, "accept", "application/x-npy").await;
    assert_eq!(array.body.len() % 64, (64 * 48) % 64);
    assert!(String::from_utf8_lossy(&array.body).contains("'|u1'"));
    server.problem_get(&url.replace("labels", "points"), 404, "").await;

    let body = json!({"texts": ["red wall", "blue sky"]});
    let answer = server.post(path, body.to_string()).await.json();
    let url = &below("labelled", &answer["points"]["url"]);
    let points = server.get(url).await;
    assert!(String::from_utf8_lossy(&points.body).contains("property uchar label\n"));
    server.problem_get(&url.replace("points", "labels"), 404, "").await;

    let near = json!({"text": "wall", "near_metres": [0.0, 0.0, 1.0], "threshold": 0.0});
    let answer = server.post(path, near.to_string()).await.json();
    for object in answer["objects"].as_array().unwrap() {
        assert!(object["distance_metres"].as_f64().unwrap() >= 0.0, "{object}");
    }
    let frame = json!({"frame": FRAME});
    for (body, field) in [
        (json!({"texts": vec!["a"; 33]}), "texts"),
        (json!({"texts": ["a", "b"], "text": "c"}), "text"),
        (json!({"texts": ["a", "b", "a"]}), "texts[2]"),
        (json!({"texts": ["a", 3]}), "texts[1]"),
        (json!({"texts": ["a", "b"], "outputs": ["mask"]}), "outputs"),
        (json!({"text": "a", "near_metres": [1.0, 2.0]}), "near_metres"),
        (json!({"text": "a", "near_metres": [0, 0, 0], "view": frame}), "near_metres"),
        (json!({"text": "a", "within": {"min_metres": [0, 0, 0]}}), "within.max_metres"),
        (
            json!({"text": "a", "within": {"min_metres": [1, 0, 0], "max_metres": [0, 1, 1]}}),
            "within.max_metres",
        ),
    ] {
        server.problem_post(path, &body, 400, field).await;
    }
}
