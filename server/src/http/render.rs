//! Pictures of a map: from a tracked frame (GET) or any camera (POST).

use super::extract::{Body, NPY, NamedMap, Options, wants_npy};
use super::view::{Camera, WireView, side};
use super::{Problem, Shared, State};
use crate::export;
use crate::ingest::convert::Refusal;
use crate::pipeline::map::Map;
use crate::pipeline::query::{Channel, MAX_VIEW_SIDE, Picture, RenderRequest, View};
use crate::telemetry::RENDER_SECONDS;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse as _, Response};
use serde::Deserialize;
use std::time::Instant;
use utoipa::ToSchema;

/// What a picture shows.
#[derive(Debug, Clone, Copy, Default, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(super) enum WireChannel {
    /// Color.
    #[default]
    Color,
    /// Depth: 16-bit millimetres, or float32 metres as an array.
    Depth,
    /// Language codes as colors.
    Language,
    /// Opacity.
    Opacity,
}

impl WireChannel {
    fn name(self) -> &'static str {
        match self {
            Self::Color => "color",
            Self::Depth => "depth",
            Self::Language => "language",
            Self::Opacity => "opacity",
        }
    }
}

impl From<WireChannel> for Channel {
    fn from(channel: WireChannel) -> Self {
        match channel {
            WireChannel::Color => Self::Color,
            WireChannel::Depth => Self::Depth,
            WireChannel::Language => Self::Language,
            WireChannel::Opacity => Self::Opacity,
        }
    }
}

/// A picture of a tracked frame.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FrameOptions {
    frame: u64,
    #[serde(default)]
    channel: WireChannel,
    width: Option<u32>,
    height: Option<u32>,
}

/// A picture from a tracked frame or any camera; `width` and `height` scale it.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct RenderBody {
    /// The sequence of a tracked frame …
    #[serde(default)]
    frame: Option<u64>,
    /// … or any camera …
    #[serde(default)]
    camera: Option<Camera>,
    /// … with its pose: 16 numbers, row-major 4x4, metres.
    #[serde(default)]
    world_from_camera: Option<Vec<f64>>,
    #[serde(default)]
    channel: WireChannel,
    #[serde(default)]
    width: Option<u32>,
    #[serde(default)]
    height: Option<u32>,
}

/// What both routes ask for.
struct Wanted {
    view: View,
    channel: WireChannel,
    width: Option<u32>,
    height: Option<u32>,
}

/// Renders the map as a tracked frame saw it, as bright as it was.
#[utoipa::path(
    get, path = "/v1/maps/{name}/render", tag = "maps",
    params(
        ("name" = String, Path),
        ("frame" = u64, Query, description = "the sequence of a tracked frame"),
        ("channel" = Option<WireChannel>, Query),
        ("width" = Option<u32>, Query, description = "columns; height follows if absent"),
        ("height" = Option<u32>, Query, description = "rows; width follows if absent"),
    ),
    responses(
        (status = 200, description = "PNG; depth with Accept: application/x-npy an array",
            content((Vec<u8> = "image/png"), (Vec<u8> = "application/x-npy"))),
        (status = 400, description = "a field is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such map or frame", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn of_frame(
    state: State,
    NamedMap(map): NamedMap,
    Options(options): Options<FrameOptions>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let FrameOptions { frame, channel, width, height } = options;
    let wanted = Wanted { view: View::Frame(frame), channel, width, height };
    picture(&state, &map, wanted, &headers).await
}

/// Renders the map from any camera.
#[utoipa::path(
    post, path = "/v1/maps/{name}/render", tag = "maps", params(("name" = String, Path)),
    request_body = RenderBody,
    responses(
        (status = 200, description = "PNG; depth with Accept: application/x-npy an array",
            content((Vec<u8> = "image/png"), (Vec<u8> = "application/x-npy"))),
        (status = 400, description = "a field is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such map or frame", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn of_view(
    state: State,
    NamedMap(map): NamedMap,
    headers: HeaderMap,
    Body(body): Body<RenderBody>,
) -> Result<Response, Problem> {
    let RenderBody { frame, camera, world_from_camera, channel, width, height } = body;
    let view = WireView { frame, camera, world_from_camera };
    let view = view.checked("", state.config.max_render_pixels)?;
    picture(&state, &map, Wanted { view, channel, width, height }, &headers).await
}

async fn picture(
    state: &Shared,
    map: &Map,
    wanted: Wanted,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let started = Instant::now();
    let size = size(map, &wanted, state.config.max_render_pixels)?;
    let Wanted { view, channel, .. } = wanted;
    let request = RenderRequest { view, channel: channel.into(), size };
    let picture = state.in_time(state.engine.render(map, request)).await??;
    let npy = wants_npy(headers) && matches!(picture, Picture::Depth { .. });
    let written = tokio::task::spawn_blocking(move || write(&picture, npy)).await;
    let file = written.map_err(|_| Problem::internal("writing the picture panicked"))?;
    metrics::histogram!(RENDER_SECONDS, "channel" => channel.name()).record(started.elapsed());
    let kind = if npy { NPY } else { "image/png" };
    // The map goes on changing.
    let headers = [
        (header::CONTENT_TYPE, kind),
        (header::VARY, "accept"),
        (header::CACHE_CONTROL, "no-cache"),
    ];
    Ok((headers, file).into_response())
}

fn write(picture: &Picture, npy: bool) -> Vec<u8> {
    match picture {
        Picture::Rgb { width, height, data } => export::rgb_png(*width, *height, data),
        Picture::Depth { width, height, metres } if npy => {
            export::npy(&[*height as usize, *width as usize], metres)
        }
        Picture::Depth { width, height, metres } => export::depth_png(*width, *height, metres),
    }
}

/// The picture's size, if another than the view's own; a side that is not given follows the other.
fn size(map: &Map, wanted: &Wanted, max_pixels: u64) -> Result<Option<(u32, u32)>, Refusal> {
    for (field, given) in [("width", wanted.width), ("height", wanted.height)] {
        given.map_or(Ok(()), |pixels| side(field, pixels))?;
    }
    let own = match &wanted.view {
        View::Camera { intrinsics, .. } => Some((intrinsics.width, intrinsics.height)),
        View::Frame(_) => map.snapshot().intrinsics.map(|camera| (camera.width, camera.height)),
    };
    // Without a camera there is no frame either, and the renderer says so.
    let Some((own_width, own_height)) = own else { return Ok(None) };
    let follow = |given: u32, own_given: u32, own_other: u32| {
        let other = f64::from(given) * f64::from(own_other) / f64::from(own_given);
        (other.round() as u32).clamp(1, MAX_VIEW_SIDE)
    };
    let size = match (wanted.width, wanted.height) {
        (None, None) => return Ok(None),
        (Some(width), Some(height)) => (width, height),
        (Some(width), None) => (width, follow(width, own_width, own_height)),
        (None, Some(height)) => (follow(height, own_height, own_width), height),
    };
    let pixels = u64::from(size.0) * u64::from(size.1);
    if pixels > max_pixels {
        let reason = format!("expected at most {max_pixels} pixels, found {}x{}", size.0, size.1);
        return Err(Refusal::new("width", reason));
    }
    Ok(Some(size))
}
