//! `GET /v1/maps/{name}/export/{file}`: the map as a file, with `ETag` and ranges.

use super::extract::{NamedMap, Segments};
use super::range::{Tagged, respond};
use super::{Problem, State};
use crate::export::{self, Format};
use crate::pipeline::snapshot::MapSnapshot;
use axum::http::HeaderMap;
use axum::response::Response;
use sha2::{Digest as _, Sha256};
use std::sync::{Arc, Mutex, Weak};

/// The newest file, so that its parts are not written anew one by one.
#[derive(Default)]
pub(super) struct LastFile(Mutex<Option<Last>>);

struct Last {
    of: Weak<MapSnapshot>,
    format: Format,
    file: Tagged,
}

impl LastFile {
    fn get(&self, snapshot: &Arc<MapSnapshot>, format: Format) -> Option<Tagged> {
        let last = self.0.lock().expect("no thread panics while it holds the file");
        last.as_ref()
            .filter(|last| last.format == format && last.of.ptr_eq(&Arc::downgrade(snapshot)))
            .map(|last| last.file.clone())
    }

    fn put(&self, snapshot: &Arc<MapSnapshot>, format: Format, file: Tagged) {
        let last = Last { of: Arc::downgrade(snapshot), format, file };
        *self.0.lock().expect("no thread panics while it holds the file") = Some(last);
    }
}

/// The map as a file.
#[utoipa::path(
    get, path = "/v1/maps/{name}/export/{file}", tag = "maps",
    params(
        ("name" = String, Path),
        ("file" = String, Path, description = "splats.ply, points.ply or trajectory.tum"),
    ),
    responses(
        (status = 200, description = "all of it", content_type = "application/octet-stream"),
        (status = 206, description = "the part that Range asks for", content_type = "application/octet-stream"),
        (status = 304, description = "unchanged since the entity tag"),
        (status = 404, description = "no such map or file", body = Problem, content_type = "application/problem+json"),
        (status = 416, description = "no such part", body = Problem, content_type = "application/problem+json"),
        (status = 501, description = "not there yet", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn file(
    state: State,
    NamedMap(map): NamedMap,
    segments: Segments,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let format: Format = segments.get("file").parse()?;
    let snapshot = map.snapshot();
    if let Some(file) = state.last_file.get(&snapshot, format) {
        return Ok(respond(file, &headers, "application/octet-stream"));
    }
    let source = snapshot.clone();
    let written = tokio::task::spawn_blocking(move || {
        export::write(format, &source).map(|data| {
            let digest = Sha256::digest(&data);
            let etag: String = digest[..16].iter().map(|byte| format!("{byte:02x}")).collect();
            Tagged { etag: format!("\"{etag}\""), data: data.into() }
        })
    });
    let file = written.await.map_err(|_| Problem::internal("writing the file panicked"))??;
    state.last_file.put(&snapshot, format, file.clone());
    Ok(respond(file, &headers, "application/octet-stream"))
}
