//! `GET /v1/maps/{name}/export/{file}`: the map as a file, with `ETag` and ranges.

use super::extract::{NamedMap, Options, Segments};
use super::range::{Tagged, respond};
use super::{Problem, State};
use crate::export::{self, Format, MeshOptions};
use crate::ingest::convert::question::Question;
use crate::pipeline::snapshot::MapSnapshot;
use axum::http::HeaderMap;
use axum::response::Response;
use serde::Deserialize;
use sha2::{Digest as _, Sha256};
use std::sync::{Arc, Mutex, Weak};
use utoipa::IntoParams;

/// What can be chosen about `mesh.ply`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, IntoParams)]
#[serde(default, deny_unknown_fields)]
pub(super) struct ExportOptions {
    /// mesh.ply: side of a voxel, 0.002 to 1 metre; 0.02 if absent.
    voxel: Option<f32>,
    /// mesh.ply: words, whose relevancy becomes a property of the vertices.
    text: Option<String>,
}

impl ExportOptions {
    fn checked(&self) -> Result<MeshOptions, Problem> {
        let question = self.text.as_ref().map(|text| Question::about(text).checked("smoothing"));
        Ok(MeshOptions { voxel_metres: self.voxel, question: question.transpose()? })
    }
}

/// The newest file, so that its parts are not written anew one by one.
#[derive(Default)]
pub(super) struct LastFile(Mutex<Option<Last>>);

struct Last {
    of: Weak<MapSnapshot>,
    format: Format,
    options: ExportOptions,
    file: Tagged,
}

impl LastFile {
    fn get(
        &self,
        snapshot: &Arc<MapSnapshot>,
        format: Format,
        options: &ExportOptions,
    ) -> Option<Tagged> {
        let last = self.0.lock().expect("no thread panics while it holds the file");
        last.as_ref()
            .filter(|last| last.format == format && last.options == *options)
            .filter(|last| last.of.ptr_eq(&Arc::downgrade(snapshot)))
            .map(|last| last.file.clone())
    }

    fn put(&self, last: Last) {
        *self.0.lock().expect("no thread panics while it holds the file") = Some(last);
    }
}

/// The map as a file.
#[utoipa::path(
    get, path = "/v1/maps/{name}/export/{file}", tag = "maps",
    params(
        ("name" = String, Path),
        ("file" = String, Path, description = "splats.ply, splats.spz, splats.glb, language.npz, points.ply, mesh.ply or trajectory.tum"),
        ExportOptions,
    ),
    responses(
        (status = 200, description = "all of it", content_type = "application/octet-stream"),
        (status = 206, description = "the part that Range asks for", content_type = "application/octet-stream"),
        (status = 304, description = "unchanged since the entity tag"),
        (status = 400, description = "an option is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such map or file", body = Problem, content_type = "application/problem+json"),
        (status = 416, description = "no such part", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn file(
    state: State,
    NamedMap(map): NamedMap,
    segments: Segments,
    Options(options): Options<ExportOptions>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let format: Format = segments.get("file").parse()?;
    let snapshot = map.snapshot();
    if let Some(file) = state.last_file.get(&snapshot, format, &options) {
        return Ok(respond(file, &headers, format.media_type()));
    }
    let mesh = options.checked()?;
    let data = export::file(&state.engine, snapshot.clone(), format, mesh).await?;
    let tagged = tokio::task::spawn_blocking(move || {
        let digest = Sha256::digest(&data);
        let etag: String = digest[..16].iter().map(|byte| format!("{byte:02x}")).collect();
        Tagged { etag: format!("\"{etag}\""), data: data.into() }
    });
    let file = tagged.await.map_err(|_| Problem::internal("reading the file panicked"))?;
    let of = Arc::downgrade(&snapshot);
    state.last_file.put(Last { of, format, options, file: file.clone() });
    Ok(respond(file, &headers, format.media_type()))
}
