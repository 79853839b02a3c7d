//! Maps: creating, listing, describing and deleting them; their keyframes and trajectories.

use super::error::Problem;
use super::extract::{Body, NamedMap, Options, Segments};
use super::reading::{self, WaitOptions};
use super::state::State;
use super::to_json::{keyframe, listed, status};
use crate::access::Caller;
use crate::check::Page;
use crate::export;
use crate::maps::{self, MapsError, RenameError};
use crate::pipeline::map::MapError;
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use axum::{Extension, Json};
use lexsplat_proto::json::{self, Frames, Maps, NewMap, Status};
use serde::Deserialize;
use utoipa::IntoParams;

/// A page of maps.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct PageOfMaps {
    /// Number of maps in the answer; all if absent.
    #[param(minimum = 1)]
    pub(crate) limit: Option<u32>,
    /// Only maps whose names come after this one: `next` of the page before.
    pub(crate) after: Option<String>,
}

/// A page of keyframes.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(default, deny_unknown_fields)]
pub(super) struct PageOfFrames {
    /// Number of keyframes in the answer; all if absent.
    #[param(minimum = 1)]
    limit: Option<u32>,
    /// Only keyframes with larger sequence numbers: `next` of the page before.
    after: Option<u64>,
}

/// Creates a map.
#[utoipa::path(
    post, path = "/v1/maps", operation_id = "create_map", tag = "maps", request_body = NewMap,
    responses(
        (status = 201, body = Status),
        (status = 400, description = "the name is invalid", body = json::Problem, content_type = "application/problem+json"),
        (status = 409, description = "a map with this name exists", body = json::Problem, content_type = "application/problem+json"),
        (status = 429, description = "there are as many maps as there may be", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn create(
    state: State,
    Extension(caller): Extension<Caller>,
    Body(NewMap { name }): Body<NewMap>,
) -> Result<impl IntoResponse, Problem> {
    caller.may_use(&name).map_err(|error| Problem::from(error).at("name"))?;
    let map = state.maps.create(&name).await?;
    // Relative to the address of this request.
    let location = format!("maps/{}", map.name());
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], Json(status(map.status()))))
}

/// Lists the maps that the caller may use.
#[utoipa::path(
    get, path = "/v1/maps", operation_id = "list_maps", tag = "maps", params(PageOfMaps),
    responses(
        (status = 200, body = Maps),
        (status = 400, description = "an option is wrong", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn list(
    state: State,
    Extension(caller): Extension<Caller>,
    Options(PageOfMaps { limit, after }): Options<PageOfMaps>,
) -> Result<Json<Maps>, Problem> {
    let page = Page::new(limit, after)?;
    let seen = state.maps.list().into_iter().filter(|map| caller.sees(map.name()));
    let (maps, next) = page.of(seen, |map| map.name().to_owned());
    Ok(Json(Maps { maps: maps.into_iter().map(listed).collect(), next }))
}

/// The status of a map.
#[utoipa::path(
    get, path = "/v1/maps/{name}", operation_id = "get_map", tag = "maps", params(("name" = String, Path)),
    responses(
        (status = 200, body = Status),
        (status = 404, description = "no such map", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn show(NamedMap(map): NamedMap) -> Json<Status> {
    Json(status(map.status()))
}

/// Renames a map. It is saved and loaded again, so its status is that of a map that is being loaded.
#[utoipa::path(
    patch, path = "/v1/maps/{name}", operation_id = "rename_map", tag = "maps", params(("name" = String, Path)),
    request_body = NewMap,
    responses(
        (status = 200, body = Status),
        (status = 400, description = "the new name is invalid", body = json::Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such map", body = json::Problem, content_type = "application/problem+json"),
        (status = 409, description = "the new name is taken, somebody sends frames, or nothing is recorded", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn rename(
    state: State,
    Extension(caller): Extension<Caller>,
    segments: Segments,
    Body(NewMap { name: to }): Body<NewMap>,
) -> Result<Json<Status>, Problem> {
    caller.may_use(&to).map_err(|error| Problem::from(error).at("name"))?;
    maps::rename(&state.maps, segments.get("name"), &to).await?;
    state.imports.forget(segments.get("name"));
    let renamed = state.maps.list().into_iter().find(|map| map.name() == to);
    // Somebody may have deleted it at once.
    renamed
        .map(|map| Json(listed(map)))
        .ok_or_else(|| MapsError::from(MapError::NotFound { name: to }).into())
}

impl From<RenameError> for Problem {
    fn from(error: RenameError) -> Self {
        match error {
            RenameError::Maps(error) => error.into(),
            RenameError::NotRecorded => Self::new(StatusCode::CONFLICT, error.to_string()),
        }
    }
}

/// Deletes a map.
#[utoipa::path(
    delete, path = "/v1/maps/{name}", operation_id = "delete_map", tag = "maps", params(("name" = String, Path)),
    responses(
        (status = 204, description = "the map was deleted"),
        (status = 404, description = "no such map", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn delete(
    state: State,
    Extension(caller): Extension<Caller>,
    segments: Segments,
) -> Result<StatusCode, Problem> {
    let map = segments.get("name");
    state.maps.delete(map).await?;
    state.imports.forget(map);
    tracing::info!(map, caller = caller.name(), "a map was deleted");
    Ok(StatusCode::NO_CONTENT)
}

/// The keyframes of a map.
#[utoipa::path(
    get, path = "/v1/maps/{name}/frames", operation_id = "list_frames", tag = "maps",
    params(("name" = String, Path), PageOfFrames),
    responses(
        (status = 200, body = Frames),
        (status = 400, description = "an option is wrong", body = json::Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such map", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn frames(
    NamedMap(map): NamedMap,
    Options(PageOfFrames { limit, after }): Options<PageOfFrames>,
) -> Result<Json<Frames>, Problem> {
    let page = Page::new(limit, after)?;
    let snapshot = map.snapshot().await;
    let (frames, next) = page.of(&*snapshot.keyframes, |info| info.frame.sequence);
    let frames = frames.into_iter().map(keyframe).collect();
    Ok(Json(Frames { map: map.name().into(), revision: snapshot.revision, frames, next }))
}

/// The poses of all tracked frames as TUM text: `timestamp tx ty tz qx qy qz qw`, camera-to-world.
#[utoipa::path(
    get, path = "/v1/maps/{name}/trajectory", operation_id = "get_trajectory", tag = "maps", params(("name" = String, Path), WaitOptions),
    responses(
        (status = 200, body = String, content_type = "text/plain"),
        (status = 404, description = "no such map", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn trajectory(
    NamedMap(map): NamedMap,
    Options(options): Options<WaitOptions>,
) -> Result<impl IntoResponse, Problem> {
    let reading = options.read(&map).await?;
    let text = export::trajectory(&reading.snapshot.trajectory);
    let content_type = [(header::CONTENT_TYPE, "text/plain; charset=utf-8")];
    Ok((reading::headers(&reading), content_type, text))
}
