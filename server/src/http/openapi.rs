//! `GET /openapi.json`: OpenAPI 3.1, made from the handlers' own annotations.

use super::{Problem, answers, events, export, health, map, query, render, segment};
use axum::Json;
use utoipa::OpenApi;

#[derive(OpenApi)]
#[openapi(
    info(
        title = "lexsplat",
        description = "Ask a map of Gaussians in plain words. The world is the map's frame, metres; \
                       camera axes are x right, y down, z forward.",
    ),
    paths(
        health::healthz,
        health::readyz,
        health::metrics,
        document,
        map::list,
        map::create,
        map::show,
        map::delete,
        map::frames,
        map::trajectory,
        query::ask,
        answers::heatmap,
        answers::points,
        segment::labels,
        render::of_frame,
        render::of_view,
        export::file,
        events::stream,
    ),
    components(schemas(Problem, events::FrameEvent, events::RevisionEvent, events::MissedEvent))
)]
pub(super) struct Document;

/// This document.
#[utoipa::path(get, path = "/openapi.json", tag = "health", responses((status = 200, description = "OpenAPI 3.1")))]
pub(super) async fn document() -> Json<utoipa::openapi::OpenApi> {
    Json(Document::openapi())
}
