//! `GET /openapi.json`: the OpenAPI 3.1 document, generated from the annotations of the handlers.

use super::schema::SharedErrors;
use super::{answers, backup, events, export, health, import, map, query, render, session};
use axum::Json;
use lexsplat_proto::json;
use utoipa::openapi::security::{Http, HttpAuthScheme, SecurityScheme};
use utoipa::{Modify, OpenApi};

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
        session::log_in,
        session::log_out,
        map::list,
        map::create,
        map::show,
        map::rename,
        map::delete,
        map::frames,
        map::trajectory,
        query::ask,
        answers::heatmap,
        answers::uncertainty,
        answers::points,
        answers::labels,
        render::of_frame,
        render::of_view,
        export::file,
        backup::take,
        backup::put,
        import::show,
        import::begin,
        import::stop,
        events::stream,
    ),
    modifiers(&Bearer, &SharedErrors),
    security(("bearer" = [])),
    components(schemas(
        json::Problem,
        json::FrameEvent,
        json::InputWarningEvent,
        json::RevisionEvent,
        json::MissedEvent,
    ))
)]
pub(super) struct Document;

/// Callers send a bearer token where the server asks for one.
struct Bearer;

impl Modify for Bearer {
    fn modify(&self, document: &mut utoipa::openapi::OpenApi) {
        let bearer = SecurityScheme::Http(Http::new(HttpAuthScheme::Bearer));
        document.components.get_or_insert_default().add_security_scheme("bearer", bearer);
    }
}

/// This document.
#[utoipa::path(get, path = "/openapi.json", operation_id = "get_openapi", tag = "health", responses((status = 200, description = "OpenAPI 3.1")))]
pub(crate) async fn document() -> Json<utoipa::openapi::OpenApi> {
    Json(Document::openapi())
}
