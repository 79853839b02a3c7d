//! Backups over HTTP: a map as one file, and back.

use super::error::Problem;
use super::extract::{Segments, expect_type};
use super::pace::Pace;
use super::received::with_received;
use super::schema::Binary;
use super::state::State;
use crate::maps::{self, BackupError};
use axum::Json;
use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::IntoResponse;
use lexsplat_proto::json;
use std::io::Write;
use tokio::runtime::Handle;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;

const TAR: &str = "application/x-tar";
/// Bytes in a part of the archive.
const PART_BYTES: usize = 256 << 10;
/// Parts that may wait for the reader.
const BACKLOG: usize = 4;

/// The recording of a map and its newest checkpoint in one tar. Mapping goes on meanwhile. A client that
/// takes less than 16 KiB a second for long gets no more.
#[utoipa::path(
    get, path = "/v1/maps/{name}/backup", operation_id = "back_up_map", tag = "maps", params(("name" = String, Path)),
    responses(
        (status = 200, description = "a tar", body = inline(Binary), content_type = "application/x-tar"),
        (status = 404, description = "no such map", body = json::Problem, content_type = "application/problem+json"),
        (status = 409, description = "nothing is recorded", body = json::Problem, content_type = "application/problem+json"),
        (status = 503, description = "as many backups as the server makes at a time are being read", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn take(state: State, segments: Segments) -> Result<impl IntoResponse, Problem> {
    let name = segments.get("name");
    let (backup, place) = maps::backup(&state.maps, name).await?;
    let (parts, stream) = mpsc::channel(BACKLOG);
    let (map, pace) = (name.to_owned(), Pace::new(state.body_limit));
    tokio::spawn(async move {
        let failed = parts.clone();
        let written = tokio::task::spawn_blocking(move || {
            let parts = Parts { parts, pace, runtime: Handle::current() };
            let written = backup.write(std::io::BufWriter::with_capacity(PART_BYTES, parts));
            drop(place);
            written
        });
        if let Ok(Err(error)) = written.await {
            tracing::warn!(map, %error, "a backup broke off");
            // The reader must not take a part for the whole. If this fails, it is gone.
            let _ = failed.send(Err(error)).await;
        }
    });
    let headers = [
        (header::CONTENT_TYPE, TAR.to_owned()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{name}.lexsplat.tar\"")),
    ];
    Ok((headers, Body::from_stream(ReceiverStream::new(stream))))
}

/// Puts a backup in place as a new map. It is checked first; then it is loaded. A client that sends less than
/// 16 KiB a second for long is refused.
#[utoipa::path(
    put, path = "/v1/maps/{name}/backup", operation_id = "restore_map", tag = "maps", params(("name" = String, Path)),
    request_body(content = inline(Binary), content_type = "application/x-tar"),
    responses(
        (status = 201, description = "the map is there and is being loaded", body = json::Restored),
        (status = 400, description = "the archive is damaged or no backup", body = json::Problem, content_type = "application/problem+json"),
        (status = 408, description = "the archive comes too slowly", body = json::Problem, content_type = "application/problem+json"),
        (status = 409, description = "a map with this name exists, or nothing is recorded", body = json::Problem, content_type = "application/problem+json"),
        (status = 415, description = "the body is no tar", body = json::Problem, content_type = "application/problem+json"),
        (status = 429, description = "there are as many maps as there may be", body = json::Problem, content_type = "application/problem+json"),
        (status = 503, description = "as many backups as the server takes at a time are being put in place", body = json::Problem, content_type = "application/problem+json"),
        (status = 507, description = "a quota has no room for it", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn put(
    state: State,
    segments: Segments,
    headers: HeaderMap,
    body: Body,
) -> Result<impl IntoResponse, Problem> {
    let name = segments.get("name");
    let restored = with_received(body, state.body_limit, async |received| {
        expect_type(&headers, TAR)?;
        Ok(maps::restore(&state.maps, name, received).await?)
    });
    let restored = restored.await?;
    let body = json::Restored { frames: restored.frames, warnings: restored.warnings };
    // Relative to the address of this request.
    Ok((StatusCode::CREATED, [(header::LOCATION, format!("../{name}"))], Json(body)))
}

impl From<BackupError> for Problem {
    fn from(error: BackupError) -> Self {
        match error {
            BackupError::Maps(error) => error.into(),
            BackupError::NotRecorded | BackupError::Empty { .. } => {
                Self::new(StatusCode::CONFLICT, error.to_string())
            }
            BackupError::Busy => Self::unavailable(error.to_string()),
            BackupError::Slow { .. } => Self::new(StatusCode::REQUEST_TIMEOUT, error.to_string()),
            BackupError::Refused { .. } => Self::bad_request(error.to_string()),
        }
    }
}

/// Writes into a response.
struct Parts {
    parts: mpsc::Sender<std::io::Result<Bytes>>,
    pace: Pace,
    runtime: Handle,
}

impl Write for Parts {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let part = Ok(Bytes::copy_from_slice(bytes));
        let sent = self.runtime.block_on(self.pace.wait(self.parts.send(part)))?;
        sent.map_err(|_| std::io::Error::from(std::io::ErrorKind::BrokenPipe))?;
        self.pace.moved(bytes.len());
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
