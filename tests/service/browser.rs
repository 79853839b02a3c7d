//! What a page of somebody else can do through a browser that reaches the server: nothing.

use lexsplat_tests::{Server, tiny_config};
use reqwest::{Method, Response, StatusCode, header};
use serde_json::Value;

/// Sends a request as a browser does, with these headers.
async fn send(
    server: &Server,
    method: Method,
    path: &str,
    headers: &[(&str, &str)],
    body: &'static str,
) -> Response {
    let mut request = reqwest::Client::new().request(method, server.url(path)).body(body);
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    request.send().await.expect("the server answers")
}

async fn maps(server: &Server) -> usize {
    let reply: Value =
        send(server, Method::GET, "/v1/maps", &[], "").await.json().await.expect("it is JSON");
    reply["maps"].as_array().expect("a list").len()
}

const JSON: (&str, &str) = ("content-type", "application/json");

#[tokio::test(flavor = "multi_thread")]
async fn foreign_pages_and_names_change_nothing() {
    let mut config = tiny_config();
    config.http.hosts = vec!["maps.example.org".into()];
    let server = Server::start(config).await;
    let make = r#"{"name": "made"}"#;
    let own = format!("http://{}", server.http);
    let attacks: [(&[(&str, &str)], StatusCode); 6] = [
        // A form or a simple `fetch` of another page.
        (
            &[("origin", "https://evil.example"), ("content-type", "text/plain")],
            StatusCode::FORBIDDEN,
        ),
        (&[("origin", "null"), JSON], StatusCode::FORBIDDEN),
        (&[("origin", "http://localhost:1"), JSON], StatusCode::FORBIDDEN),
        // A name that was made to point here.
        (
            &[("host", "evil.example"), ("origin", "http://evil.example"), JSON],
            StatusCode::MISDIRECTED_REQUEST,
        ),
        // A page that hides its origin can send these types only.
        (&[("content-type", "text/plain")], StatusCode::UNSUPPORTED_MEDIA_TYPE),
        (
            &[("content-type", "application/x-www-form-urlencoded")],
            StatusCode::UNSUPPORTED_MEDIA_TYPE,
        ),
    ];
    for (headers, expected) in attacks {
        let reply = send(&server, Method::POST, "/v1/maps", headers, make).await;
        assert_eq!(reply.status(), expected, "{headers:?}");
        assert_eq!(reply.headers()[header::CONTENT_TYPE], "application/problem+json");
        assert_eq!(maps(&server).await, 0, "{headers:?} made a map");
    }
    // Negative control: the server's own page does make it, under each of its names.
    let made = send(&server, Method::POST, "/v1/maps", &[("origin", &own), JSON], make).await;
    assert_eq!(made.status(), StatusCode::CREATED);
    let named = [("host", "maps.example.org"), ("origin", "https://maps.example.org"), JSON];
    let again = send(&server, Method::POST, "/v1/maps", &named, make).await;
    assert_eq!(again.status(), StatusCode::CONFLICT, "it got as far as the map");
    assert_eq!(maps(&server).await, 1);
    for headers in [[("origin", "https://evil.example")], [("host", "evil.example")]] {
        let reply = send(&server, Method::DELETE, "/v1/maps/made", &headers, "").await;
        assert!(reply.status().is_client_error(), "{headers:?}: {}", reply.status());
    }
    assert_eq!(maps(&server).await, 1);
    let read = send(&server, Method::GET, "/v1/maps", &[("host", "evil.example")], "").await;
    assert_eq!(read.status(), StatusCode::MISDIRECTED_REQUEST);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn every_answer_tells_the_browser_what_not_to_do() {
    let server = Server::start(tiny_config()).await;
    for (method, path, status) in [
        (Method::GET, "/", 200),
        (Method::GET, "/dashboard/app.js", 200),
        (Method::GET, "/v1/maps", 200),
        (Method::GET, "/metrics", 200),
        (Method::GET, "/v1/maps/nowhere", 404),
        (Method::GET, "/nowhere", 404),
        (Method::PUT, "/v1/maps", 405),
        (Method::POST, "/v1/maps", 415),
    ] {
        let what = format!("{method} {path}");
        let reply = send(&server, method, path, &[], "").await;
        assert_eq!(reply.status().as_u16(), status, "{what}");
        let value = |name: &str| {
            let value = reply.headers().get(name).unwrap_or_else(|| panic!("{what}: no {name}"));
            value.to_str().expect("text").to_owned()
        };
        assert_eq!(value("x-content-type-options"), "nosniff", "{what}");
        assert_eq!(value("referrer-policy"), "no-referrer", "{what}");
        assert_eq!(value("cross-origin-resource-policy"), "same-origin", "{what}");
        let policy = value("content-security-policy");
        assert!(policy.contains("frame-ancestors 'none'"), "{what}: {policy}");
        // The renderer of the 3D view is partly WebAssembly; nothing may make scripts of texts.
        assert!(!policy.replace("'wasm-unsafe-eval'", "").contains("unsafe"), "{what}: {policy}");
        let is_page = path == "/" || path.starts_with("/dashboard");
        assert_eq!(policy.contains("wasm"), is_page, "{what}: {policy}");
        assert!(!reply.headers().contains_key("access-control-allow-origin"), "{what}");
    }
    server.stop().await;
}
