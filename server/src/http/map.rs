//! Maps: making, listing, describing and deleting them; their keyframes and trajectories.

use super::extract::{Body, NamedMap, Segments};
use super::view::{Camera, rows};
use super::{Problem, State};
use crate::export;
use crate::pipeline::map::MapStatus;
use crate::pipeline::snapshot::KeyframeInfo;
use axum::Json;
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A map to be made.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct NewMap {
    /// 1 to 64 of A-Z a-z 0-9 . _ - and not a dot first.
    #[schema(example = "kitchen")]
    name: String,
}

/// A map in numbers.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Status {
    name: String,
    /// Increases with every snapshot that readers get.
    revision: u64,
    frames_received: u64,
    frames_tracked: u64,
    frames_lost: u64,
    frames_dropped: u64,
    frames_refused: u64,
    keyframes: u64,
    gaussians: u64,
    /// Device memory of the Gaussians.
    gpu_bytes: u64,
    /// Memory of the keyframes' pictures and codes, the device's too.
    keyframe_bytes: u64,
    /// "empty", "tracking" or "lost".
    tracking_state: &'static str,
    /// Version of the online language compressor.
    olae_version: u64,
    queue_depth: usize,
    queue_capacity: usize,
    /// Nothing waits and the mapper has done its work on what it has.
    settled: bool,
    /// Why the map takes no more frames, if so.
    #[serde(skip_serializing_if = "Option::is_none")]
    failure: Option<String>,
}

impl From<MapStatus> for Status {
    fn from(status: MapStatus) -> Self {
        Self {
            name: status.name,
            revision: status.revision,
            frames_received: status.frames_received,
            frames_tracked: status.frames_tracked,
            frames_lost: status.frames_lost,
            frames_dropped: status.frames_dropped,
            frames_refused: status.frames_refused,
            keyframes: status.keyframes,
            gaussians: status.gaussians,
            gpu_bytes: status.gpu_bytes,
            keyframe_bytes: status.keyframe_bytes,
            tracking_state: status.tracking_state.as_str(),
            olae_version: status.olae_version,
            queue_depth: status.queue_depth,
            queue_capacity: status.queue_capacity,
            settled: status.settled,
            failure: status.failure,
        }
    }
}

/// All maps, by name.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Maps {
    maps: Vec<Status>,
}

/// A map's keyframes.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Frames {
    map: String,
    revision: u64,
    frames: Vec<Keyframe>,
}

/// A keyframe.
#[derive(Debug, Serialize, ToSchema)]
struct Keyframe {
    sequence: u64,
    /// Seconds.
    timestamp: f64,
    timestamp_nanos: u64,
    /// Row-major 4x4, metres.
    world_from_camera: [f64; 16],
    camera: Camera,
    /// Whether its language is in the map.
    has_language: bool,
}

/// Makes a map.
#[utoipa::path(
    post, path = "/v1/maps", tag = "maps", request_body = NewMap,
    responses(
        (status = 201, body = Status),
        (status = 400, description = "not a name", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "it is there already", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn create(
    state: State,
    Body(NewMap { name }): Body<NewMap>,
) -> Result<impl IntoResponse, Problem> {
    let engine = state.engine.clone();
    // Making a map takes device memory and a thread.
    let made = tokio::task::spawn_blocking(move || engine.create(&name)).await;
    let map = made.map_err(|_| Problem::internal("making the map panicked"))??;
    let location = format!("/v1/maps/{}", map.name());
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], Json(Status::from(map.status()))))
}

/// Lists all maps.
#[utoipa::path(get, path = "/v1/maps", tag = "maps", responses((status = 200, body = Maps)))]
pub(super) async fn list(state: State) -> Json<Maps> {
    Json(Maps { maps: state.engine.maps().iter().map(|map| map.status().into()).collect() })
}

/// A map in numbers.
#[utoipa::path(
    get, path = "/v1/maps/{name}", tag = "maps", params(("name" = String, Path)),
    responses(
        (status = 200, body = Status),
        (status = 404, description = "no such map", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn show(NamedMap(map): NamedMap) -> Json<Status> {
    Json(map.status().into())
}

/// Deletes a map.
#[utoipa::path(
    delete, path = "/v1/maps/{name}", tag = "maps", params(("name" = String, Path)),
    responses(
        (status = 204, description = "it is gone"),
        (status = 404, description = "no such map", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn delete(state: State, segments: Segments) -> Result<StatusCode, Problem> {
    let name = segments.get("name");
    state.engine.delete(name).await?;
    state.store.forget(name).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// A map's keyframes.
#[utoipa::path(
    get, path = "/v1/maps/{name}/frames", tag = "maps", params(("name" = String, Path)),
    responses(
        (status = 200, body = Frames),
        (status = 404, description = "no such map", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn frames(NamedMap(map): NamedMap) -> Json<Frames> {
    let snapshot = map.snapshot();
    Json(Frames {
        map: map.name().into(),
        revision: snapshot.revision,
        frames: snapshot.keyframes.iter().map(keyframe).collect(),
    })
}

fn keyframe(info: &KeyframeInfo) -> Keyframe {
    Keyframe {
        sequence: info.frame.sequence,
        timestamp: export::seconds(info.frame.timestamp_nanos),
        timestamp_nanos: info.frame.timestamp_nanos,
        world_from_camera: rows(&info.frame.world_from_camera),
        camera: info.intrinsics.into(),
        has_language: info.has_language,
    }
}

/// Every tracked frame's pose as TUM text: `timestamp tx ty tz qx qy qz qw`, camera-to-world.
#[utoipa::path(
    get, path = "/v1/maps/{name}/trajectory", tag = "maps", params(("name" = String, Path)),
    responses(
        (status = 200, body = String, content_type = "text/plain"),
        (status = 404, description = "no such map", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn trajectory(NamedMap(map): NamedMap) -> impl IntoResponse {
    let text = export::trajectory(&map.snapshot().trajectory);
    ([(header::CONTENT_TYPE, "text/plain; charset=utf-8")], text)
}
