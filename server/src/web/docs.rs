//! `/docs`: the description of the HTTP interface as a page, where requests can be tried. The page is Swagger
//! UI; it loads nothing from other servers.

use axum::Router;
use axum::extract::Path;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use std::sync::Arc;
use utoipa_swagger_ui::Config;

/// Swagger UI writes styles into the page and has pictures in its style sheet.
const POLICY: &str = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; \
                      object-src 'none'; frame-ancestors 'none'";
/// The description, as the page's address leads to it: a proxy may show the server below a path.
const DOCUMENT: &str = "../openapi.json";

/// `/docs/` and its files.
pub(super) fn router<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let config = Arc::new(Config::from(DOCUMENT).persist_authorization(true));
    let file = move |path: &str| serve(path, config.clone());
    let index = file.clone();
    Router::new()
        .route("/docs", get(async || moved("docs/")))
        .route("/docs/", get(async move || index("")))
        .route("/docs/{*file}", get(async move |Path(path): Path<String>| file(&path)))
}

fn moved(to: &'static str) -> Response {
    (StatusCode::PERMANENT_REDIRECT, [(header::LOCATION, to)]).into_response()
}

fn serve(path: &str, config: Arc<Config<'static>>) -> Response {
    match utoipa_swagger_ui::serve(path, config) {
        Ok(Some(file)) => {
            let headers = [
                (header::CONTENT_TYPE, &*file.content_type),
                (header::CACHE_CONTROL, "no-cache"),
                (header::CONTENT_SECURITY_POLICY, POLICY),
            ];
            (headers, file.bytes.into_owned()).into_response()
        }
        Ok(None) => StatusCode::NOT_FOUND.into_response(),
        Err(error) => {
            tracing::error!(path, error = &*error, "a file of /docs cannot be made");
            StatusCode::INTERNAL_SERVER_ERROR.into_response()
        }
    }
}
