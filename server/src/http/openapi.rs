//! `GET /openapi.json`: the OpenAPI 3.1 document, generated from the annotations of the handlers.

use super::{answers, backup, events, export, health, map, query, render};
use axum::Json;
use lexsplat_proto::json;
use utoipa::OpenApi;

#[derive(OpenApi)]
#[openapi(
    info(
        title = "lexsplat",
        description = "Questions in plain words to maps of 3D Gaussians. Positions are metres in the \
                       map's world; camera axes are x right, y down, z forward.",
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
        answers::labels,
        render::of_frame,
        render::of_view,
        export::file,
        backup::take,
        backup::put,
        events::stream,
    ),
    components(schemas(
        json::Problem,
        json::FrameEvent,
        json::InputWarningEvent,
        json::RevisionEvent,
        json::MissedEvent,
    ))
)]
pub(super) struct Document;

/// This document.
#[utoipa::path(get, path = "/openapi.json", tag = "health", responses((status = 200, description = "OpenAPI 3.1")))]
pub(super) async fn document() -> Json<utoipa::openapi::OpenApi> {
    Json(Document::openapi())
}
