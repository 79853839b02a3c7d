//! Maps: creating, listing, describing and deleting them; their keyframes and trajectories.

use super::error::Problem;
use super::extract::{Body, NamedMap, Options, Segments};
use super::reading::{self, WaitOptions};
use super::state::State;
use super::to_json::{keyframe, listed, status};
use crate::access::Caller;
use crate::export;
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use axum::{Extension, Json};
use lexsplat_proto::json::{self, Frames, Maps, NewMap, Status};

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
#[utoipa::path(get, path = "/v1/maps", operation_id = "list_maps", tag = "maps", responses((status = 200, body = Maps)))]
pub(super) async fn list(state: State, Extension(caller): Extension<Caller>) -> Json<Maps> {
    let seen = state.maps.list().into_iter().filter(|map| caller.sees(map.name()));
    Json(Maps { maps: seen.map(listed).collect() })
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
    tracing::info!(map, caller = caller.name(), "a map was deleted");
    Ok(StatusCode::NO_CONTENT)
}

/// The keyframes of a map.
#[utoipa::path(
    get, path = "/v1/maps/{name}/frames", operation_id = "list_frames", tag = "maps", params(("name" = String, Path)),
    responses(
        (status = 200, body = Frames),
        (status = 404, description = "no such map", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn frames(NamedMap(map): NamedMap) -> Json<Frames> {
    let snapshot = map.snapshot().await;
    Json(Frames {
        map: map.name().into(),
        revision: snapshot.revision,
        frames: snapshot.keyframes.iter().map(keyframe).collect(),
    })
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
