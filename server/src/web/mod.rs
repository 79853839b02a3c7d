//! The dashboard: a web page that uses the HTTP interface like any other client.
//!
//! Its files are compiled into the binary and load nothing from other servers.

mod docs;

use axum::Router;
use axum::http::{HeaderName, header};
use axum::response::IntoResponse;
use axum::routing::get;

/// Content security policy: scripts, styles and requests only from and to this server.
const POLICY: &str =
    "default-src 'self'; img-src 'self' blob: data:; object-src 'none'; frame-ancestors 'none'";

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const JAVASCRIPT: &str = "text/javascript; charset=utf-8";

/// Paths and texts of the JavaScript modules.
const SCRIPTS: [(&str, &str); 13] = [
    ("/dashboard/address.js", include_str!("address.js")),
    ("/dashboard/app.js", include_str!("app.js")),
    ("/dashboard/keyframes.js", include_str!("keyframes.js")),
    ("/dashboard/manage.js", include_str!("manage.js")),
    ("/dashboard/page.js", include_str!("page.js")),
    ("/dashboard/plan.js", include_str!("plan.js")),
    ("/dashboard/questions.js", include_str!("questions.js")),
    ("/dashboard/server.js", include_str!("server.js")),
    ("/dashboard/session.js", include_str!("session.js")),
    ("/dashboard/state.js", include_str!("state.js")),
    ("/dashboard/status.js", include_str!("status.js")),
    ("/dashboard/timeline.js", include_str!("timeline.js")),
    ("/dashboard/view.js", include_str!("view.js")),
];

/// `/` and the files of the page, and `/docs`.
pub(crate) fn router<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let page = get(async || file(HTML, include_str!("index.html")));
    let style = get(async || file(CSS, include_str!("style.css")));
    let router = docs::router().route("/", page).route("/dashboard/style.css", style);
    SCRIPTS.iter().fold(router, |router, &(path, text)| {
        router.route(path, get(async move || file(JAVASCRIPT, text)))
    })
}

fn file(content_type: &'static str, text: &'static str) -> impl IntoResponse {
    let headers: [(HeaderName, &str); 4] = [
        (header::CONTENT_TYPE, content_type),
        (header::CACHE_CONTROL, "no-cache"),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    ];
    (headers, text)
}
