//! Errors, events and the description of the service.

use super::{FRAME, Server, mapped, wall};
use crate::access::rules;
use crate::pipeline::frame::Frame;
use axum::body::Body;
use axum::http::Request;
use std::time::Duration;
use tower::Service as _;

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
    let guard = map.claim().unwrap();
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
    assert_eq!(server.get("/readyz").await.status, 503, "the server is stopping");
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
    for (path, methods) in document["paths"].as_object().unwrap() {
        for method in methods.as_object().unwrap().keys() {
            let rule = rules::of_http(&method.to_uppercase(), path);
            assert!(rule.is_some(), "who may {method} {path}?");
        }
    }
    let page = server.get("/").await;
    assert!(page.header("content-type").starts_with("text/html"));
    // Every file that the page or one of its scripts names is served.
    let mut texts = vec![String::from_utf8_lossy(&page.body).into_owned()];
    let mut files = std::collections::BTreeSet::new();
    while let Some(text) = texts.pop() {
        // A proxy may show the page below a path: no address begins at the root.
        for root in ["\"/", "'/dashboard", "'/v1", "`/v1"] {
            assert!(!text.contains(root), "{root} in {text}");
        }
        let named = ["\"dashboard/", "from './", "import('./"].into_iter();
        for rest in named.flat_map(|start| text.split(start).skip(1)) {
            let file: String = rest.chars().take_while(|c| !"\"'".contains(*c)).collect();
            if files.insert(file.clone()) {
                let reply = server.get(&format!("/dashboard/{file}")).await;
                assert_eq!(reply.status, 200, "{file}");
                // That of others imports nothing.
                if file != "splat-renderer.js" {
                    texts.push(String::from_utf8_lossy(&reply.body).into_owned());
                }
            }
        }
    }
    for file in ["style.css", "app.js", "address.js", "plan.js", "view.js", "splat-renderer.js"] {
        assert!(files.contains(file), "{file} is used by the page");
    }
    assert_eq!(files.len(), 27, "{files:?}");
}
