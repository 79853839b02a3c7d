//! The dashboard: a web page that uses the HTTP interface like any other client.
//!
//! Its files are compiled into the binary and load nothing from other servers.

mod docs;
mod file;

use axum::Router;
use axum::http::HeaderMap;
use axum::routing::get;
use file::File;

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const JAVASCRIPT: &str = "text/javascript; charset=utf-8";

/// Paths, types and texts of the page's files.
const FILES: [(&str, &str, &str); 27] = [
    ("/", HTML, include_str!("index.html")),
    ("/dashboard/space.css", CSS, include_str!("space.css")),
    ("/dashboard/style.css", CSS, include_str!("style.css")),
    ("/dashboard/address.js", JAVASCRIPT, include_str!("address.js")),
    ("/dashboard/app.js", JAVASCRIPT, include_str!("app.js")),
    ("/dashboard/channels.js", JAVASCRIPT, include_str!("channels.js")),
    ("/dashboard/floor.js", JAVASCRIPT, include_str!("floor.js")),
    ("/dashboard/imports.js", JAVASCRIPT, include_str!("imports.js")),
    ("/dashboard/keyframes.js", JAVASCRIPT, include_str!("keyframes.js")),
    ("/dashboard/manage.js", JAVASCRIPT, include_str!("manage.js")),
    ("/dashboard/measure.js", JAVASCRIPT, include_str!("measure.js")),
    ("/dashboard/motion.js", JAVASCRIPT, include_str!("motion.js")),
    ("/dashboard/page.js", JAVASCRIPT, include_str!("page.js")),
    ("/dashboard/pick.js", JAVASCRIPT, include_str!("pick.js")),
    ("/dashboard/plan.js", JAVASCRIPT, include_str!("plan.js")),
    ("/dashboard/questions.js", JAVASCRIPT, include_str!("questions.js")),
    ("/dashboard/relevancy.js", JAVASCRIPT, include_str!("relevancy.js")),
    ("/dashboard/room.js", JAVASCRIPT, include_str!("room.js")),
    ("/dashboard/scene.js", JAVASCRIPT, include_str!("scene.js")),
    ("/dashboard/server.js", JAVASCRIPT, include_str!("server.js")),
    ("/dashboard/session.js", JAVASCRIPT, include_str!("session.js")),
    ("/dashboard/space.js", JAVASCRIPT, include_str!("space.js")),
    ("/dashboard/splats.js", JAVASCRIPT, include_str!("splats.js")),
    ("/dashboard/state.js", JAVASCRIPT, include_str!("state.js")),
    ("/dashboard/status.js", JAVASCRIPT, include_str!("status.js")),
    ("/dashboard/timeline.js", JAVASCRIPT, include_str!("timeline.js")),
    ("/dashboard/view.js", JAVASCRIPT, include_str!("view.js")),
];
/// three.js and Spark in one file; `renderer/build.js` makes it.
const RENDERER: &str = include_str!("renderer/splat-renderer.js");

/// `/` and the files of the page, and `/docs`.
pub(crate) fn router<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let renderer = ("/dashboard/splat-renderer.js", JAVASCRIPT, RENDERER);
    FILES.into_iter().chain([renderer]).fold(docs::router(), |router, (path, kind, text)| {
        let file = File::new(kind, text);
        router.route(path, get(async move |headers: HeaderMap| file.answer(&headers).await))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_renderer_is_made_of_the_packages_that_are_pinned() {
        let made = RENDERER.lines().next().unwrap();
        let pinned: serde_json::Value =
            serde_json::from_str(include_str!("renderer/package.json")).unwrap();
        let lock: serde_json::Value =
            serde_json::from_str(include_str!("renderer/package-lock.json")).unwrap();
        for group in ["dependencies", "devDependencies"] {
            for (name, version) in pinned[group].as_object().unwrap() {
                let version = version.as_str().unwrap();
                assert!(made.contains(&format!("{name} {version}")), "{name} {version}: {made}");
                let locked = &lock["packages"][format!("node_modules/{name}")];
                assert_eq!(locked["version"], version, "{name}");
                assert!(locked["integrity"].as_str().unwrap().starts_with("sha512-"), "{name}");
            }
        }
        assert!(include_str!("renderer/NOTICE").contains("three.js authors"));
    }
}
