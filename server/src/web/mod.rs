//! The dashboard: one page that talks to the HTTP interface like any other client.
//!
//! Its files are part of the binary and load nothing from elsewhere.

use axum::Router;
use axum::http::{HeaderName, header};
use axum::response::IntoResponse;
use axum::routing::get;

/// The page runs its own script and style only, and talks to its own server only.
const POLICY: &str =
    "default-src 'self'; img-src 'self' blob: data:; object-src 'none'; frame-ancestors 'none'";

/// `/` and the page's files.
pub fn router<S: Clone + Send + Sync + 'static>() -> Router<S> {
    Router::new()
        .route("/", get(async || file("text/html; charset=utf-8", include_str!("index.html"))))
        .route(
            "/dashboard/style.css",
            get(async || file("text/css; charset=utf-8", include_str!("style.css"))),
        )
        .route(
            "/dashboard/app.js",
            get(async || file("text/javascript; charset=utf-8", include_str!("app.js"))),
        )
        .route(
            "/dashboard/plan.js",
            get(async || file("text/javascript; charset=utf-8", include_str!("plan.js"))),
        )
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
