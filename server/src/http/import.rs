//! Recordings over HTTP: uploaded as one file, and mapped.

use super::error::Problem;
use super::extract::{Options, Segments, expect_type};
use super::received::with_received;
use super::schema::Binary;
use super::state::State;
use crate::access::Caller;
use crate::import::{ImportError, Wish};
use axum::body::Body;
use axum::http::{HeaderMap, StatusCode};
use axum::response::IntoResponse;
use axum::{Extension, Json};
use lexsplat_proto::json::{self, ImportPoses};
use serde::Deserialize;
use tonic::Code;
use utoipa::IntoParams;

const FILE: &str = "application/octet-stream";

/// How a recording is mapped.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(default, deny_unknown_fields)]
pub(super) struct ImportOptions {
    /// Where poses come from. Absent: they are given if most frames of the recording have one.
    poses: Option<ImportPoses>,
    /// The map has frames of this recording already: map those behind them.
    resume: bool,
}

/// Uploads a recording and maps it. The map is created if there is none; one that has frames takes a
/// recording only with `resume=true`. The body is a file of the kind .mcap, .db3 (ROS 2), .r3d (Record3D) or
/// .sens (ScanNet), or a zip of a folder in a layout that `lexsplat stream` reads (TUM, 7-Scenes, Replica,
/// nerfstudio, recording.toml, rosbag2). The answer comes when the file is received and opened; mapping goes
/// on behind it. A client that sends less than 16 KiB a second for long is refused.
#[utoipa::path(
    post, path = "/v1/maps/{name}/import", operation_id = "import_recording", tag = "maps",
    params(("name" = String, Path), ImportOptions),
    request_body(content = inline(Binary), content_type = "application/octet-stream"),
    responses(
        (status = 202, description = "the recording is being mapped", body = json::Import),
        (status = 400, description = "it is no recording that can be mapped", body = json::Problem, content_type = "application/problem+json"),
        (status = 408, description = "the file comes too slowly", body = json::Problem, content_type = "application/problem+json"),
        (status = 409, description = "the map has frames, another camera, or somebody who sends frames", body = json::Problem, content_type = "application/problem+json"),
        (status = 413, description = "the recording is larger than imports.max_bytes", body = json::Problem, content_type = "application/problem+json"),
        (status = 415, description = "the body is of another type", body = json::Problem, content_type = "application/problem+json"),
        (status = 429, description = "there are as many maps as there may be", body = json::Problem, content_type = "application/problem+json"),
        (status = 503, description = "as many recordings as the server takes at a time are being mapped", body = json::Problem, content_type = "application/problem+json"),
        (status = 507, description = "the disk has no room for it", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn begin(
    state: State,
    segments: Segments,
    Extension(caller): Extension<Caller>,
    Options(ImportOptions { poses, resume }): Options<ImportOptions>,
    headers: HeaderMap,
    body: Body,
) -> Result<impl IntoResponse, Problem> {
    let begun = with_received(body, state.body_limit, async |received| {
        expect_type(&headers, FILE)?;
        Ok(state
            .imports
            .begin(segments.get("name"), &caller, Wish { poses, resume }, received)
            .await?)
    });
    Ok((StatusCode::ACCEPTED, Json(begun.await?)))
}

/// The newest recording that was uploaded into the map since the server started, and how far it is mapped.
#[utoipa::path(
    get, path = "/v1/maps/{name}/import", operation_id = "get_import", tag = "maps", params(("name" = String, Path)),
    responses(
        (status = 200, body = json::Import),
        (status = 404, description = "none was uploaded", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn show(state: State, segments: Segments) -> Result<Json<json::Import>, Problem> {
    let map = segments.get("name");
    state.imports.of(map).map(Json).ok_or_else(|| {
        let detail = format!("no recording was uploaded into {map:?} since the server started");
        Problem::not_found(detail).at("name")
    })
}

/// Stops mapping a recording. The frames so far stay in the map.
#[utoipa::path(
    delete, path = "/v1/maps/{name}/import", operation_id = "stop_import", tag = "maps", params(("name" = String, Path)),
    responses(
        (status = 204, description = "no further frame is sent"),
        (status = 404, description = "none is being mapped", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn stop(state: State, segments: Segments) -> Result<StatusCode, Problem> {
    let map = segments.get("name");
    if state.imports.stop(map).await {
        return Ok(StatusCode::NO_CONTENT);
    }
    let detail = format!("no recording is being mapped into {map:?}");
    Err(Problem::not_found(detail).at("name"))
}

impl From<ImportError> for Problem {
    fn from(error: ImportError) -> Self {
        let status = match error {
            ImportError::Maps(error) => return error.into(),
            ImportError::Busy => StatusCode::SERVICE_UNAVAILABLE,
            ImportError::Already { .. } | ImportError::HasFrames { .. } | ImportError::Stopped => {
                StatusCode::CONFLICT
            }
            ImportError::Slow { .. } => StatusCode::REQUEST_TIMEOUT,
            ImportError::TooLarge { .. } => StatusCode::PAYLOAD_TOO_LARGE,
            ImportError::NoRoom { .. } => StatusCode::INSUFFICIENT_STORAGE,
            ImportError::Refused(_) | ImportError::Broken(_) => StatusCode::BAD_REQUEST,
            ImportError::Stream { code, .. } => of_code(code),
            ImportError::Io(_) | ImportError::Panicked => StatusCode::INTERNAL_SERVER_ERROR,
        };
        Self::new(status, error.to_string())
    }
}

/// The status of a stream that was refused.
fn of_code(code: Code) -> StatusCode {
    match code {
        Code::InvalidArgument => StatusCode::BAD_REQUEST,
        Code::ResourceExhausted => StatusCode::TOO_MANY_REQUESTS,
        Code::Unavailable => StatusCode::SERVICE_UNAVAILABLE,
        Code::Internal => StatusCode::INTERNAL_SERVER_ERROR,
        _ => StatusCode::CONFLICT,
    }
}
