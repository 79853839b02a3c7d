//! `GET /v1/maps/{name}/export/{file}`: a map as a file, with `ETag` and ranges.

use super::error::Problem;
use super::extract::{Asker, NamedMap, Options, Segments};
use super::file_cache::{ExportOptions, Exported};
use super::range::{Tagged, respond};
use super::reading::{self, WaitOptions};
use super::schema::Binary;
use super::state::State;
use crate::check;
use crate::export::{self, Format, TrajectoryEntry};
use axum::http::HeaderMap;
use axum::response::{IntoResponse as _, Response};
use lexsplat_proto::json;
use serde::Deserialize;
use sha2::{Digest as _, Sha256};
use std::sync::Arc;
use utoipa::openapi::schema::{Schema, Type};
use utoipa::openapi::{ObjectBuilder, RefOr};
use utoipa::{PartialSchema, ToSchema};

/// The whole query string: the options of the file, and those of waiting.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct AllOptions {
    voxel_metres: Option<f32>,
    text: Option<String>,
    up: Option<String>,
    wait: Option<String>,
    min_sequence: Option<u64>,
    wait_seconds: Option<f64>,
}

impl AllOptions {
    fn split(self) -> (WaitOptions, ExportOptions) {
        let Self { voxel_metres, text, up, wait, min_sequence, wait_seconds } = self;
        (WaitOptions { wait, min_sequence, wait_seconds }, ExportOptions { voxel_metres, text, up })
    }
}

/// The names of files, for the OpenAPI document.
enum FileName {}

impl PartialSchema for FileName {
    fn schema() -> RefOr<Schema> {
        let names = Format::ALL.map(Format::name);
        ObjectBuilder::new().schema_type(Type::String).enum_values(Some(names)).into()
    }
}

impl ToSchema for FileName {}

/// The map as a file.
#[utoipa::path(
    get, path = "/v1/maps/{name}/export/{file}", operation_id = "export_map", tag = "maps",
    params(
        ("name" = String, Path),
        ("file" = inline(FileName), Path, description = "the kind of file"),
        ExportOptions,
        WaitOptions,
    ),
    responses(
        (status = 200, description = "the whole file", content(
            (inline(Binary) = "application/octet-stream"),
            (inline(Binary) = "model/gltf-binary"),
            (String = "text/plain"),
            (Vec<TrajectoryEntry> = "application/json"),
        )),
        (status = 206, description = "the part that Range asks for", body = inline(Binary), content_type = "application/octet-stream"),
        (status = 304, description = "the file still has the entity tag in If-None-Match"),
        (status = 400, description = "an option is wrong", body = json::Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such map or file", body = json::Problem, content_type = "application/problem+json"),
        (status = 409, description = "the map is too far from the origin for the format", body = json::Problem, content_type = "application/problem+json"),
        (status = 416, description = "the range is outside the file", body = json::Problem, content_type = "application/problem+json"),
        (status = 429, description = "too many questions of this client wait", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn file(
    state: State,
    NamedMap(map): NamedMap,
    Asker(client): Asker,
    segments: Segments,
    Options(options): Options<AllOptions>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let format: Format = segments.get("file").parse()?;
    let (waiting, options) = options.split();
    let reading = waiting.read(&map).await?;
    let snapshot = reading.snapshot.clone();
    let of = reading::headers(&reading);
    if let Some(file) = state.last_file.get(&snapshot, format, &options) {
        return Ok((of, respond(file, &headers, format.media_type())).into_response());
    }
    let ExportOptions { voxel_metres, text, up } = &options;
    let checked = check::file_options(*voxel_metres, text.as_deref(), up.as_deref())?;
    let data = export::file(state.engine(), &client, snapshot.clone(), format, checked).await?;
    let tagged = tokio::task::spawn_blocking(move || {
        let digest = Sha256::digest(&data);
        let etag: String = digest[..16].iter().map(|byte| format!("{byte:02x}")).collect();
        Tagged { etag: format!("\"{etag}\""), data: data.into() }
    });
    let file = tagged
        .await
        .map_err(|_| Problem::internal("hashing the file panicked: see the server's log"))?;
    let snapshot = Arc::downgrade(&snapshot);
    state.last_file.put(Exported { snapshot, format, options, file: file.clone() });
    Ok((of, respond(file, &headers, format.media_type())).into_response())
}
