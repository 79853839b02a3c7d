//! Rendered images of a map: from a tracked frame (GET) or any camera (POST).

use super::error::Problem;
use super::extract::{Asker, Body, NPY, NamedMap, Options, wants_npy};
use super::reading::{self, WaitOptions};
use super::schema::Binary;
use super::state::{Shared, State};
use crate::check;
use crate::export;
use crate::pipeline::map::Reading;
use crate::pipeline::query::{Client, RenderedImage};
use crate::telemetry::RENDER_SECONDS;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse as _, Response};
use lexsplat_proto::json::{self, Channel, RenderRequest};
use serde::Deserialize;
use std::time::Instant;

/// The query string of a rendered image of a tracked frame.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FrameOptions {
    frame: u64,
    #[serde(default)]
    channel: Channel,
    width: Option<u32>,
    height: Option<u32>,
    wait: Option<String>,
    min_sequence: Option<u64>,
    wait_seconds: Option<f64>,
}

/// Renders the map from the pose of a tracked frame, with that frame's exposure.
#[utoipa::path(
    get, path = "/v1/maps/{name}/render", operation_id = "render_frame", tag = "maps",
    params(
        ("name" = String, Path),
        ("frame" = u64, Query, description = "the sequence number of a tracked frame"),
        ("channel" = Option<Channel>, Query),
        ("width" = Option<u32>, Query, description = "columns; if only height is given, they follow from it"),
        ("height" = Option<u32>, Query, description = "rows; if only width is given, they follow from it"),
        WaitOptions,
    ),
    responses(
        (status = 200, description = "PNG; depth and spread with Accept: application/x-npy an array",
            content((inline(Binary) = "image/png"), (inline(Binary) = "application/x-npy"))),
        (status = 400, description = "a field is wrong", body = json::Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such map or frame", body = json::Problem, content_type = "application/problem+json"),
        (status = 429, description = "too many questions of this client wait", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn of_frame(
    state: State,
    NamedMap(map): NamedMap,
    Asker(client): Asker,
    Options(options): Options<FrameOptions>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let FrameOptions { frame, channel, width, height, wait, min_sequence, wait_seconds } = options;
    let waiting = WaitOptions { wait, min_sequence, wait_seconds };
    let frame = Some(frame);
    let request = RenderRequest { frame, channel, width, height, ..RenderRequest::default() };
    picture(&state, &client, &waiting.read(&map).await?, request, &headers).await
}

/// Renders the map from any camera.
#[utoipa::path(
    post, path = "/v1/maps/{name}/render", operation_id = "render_view", tag = "maps", params(("name" = String, Path), WaitOptions),
    request_body = RenderRequest,
    responses(
        (status = 200, description = "PNG; depth and spread with Accept: application/x-npy an array",
            content((inline(Binary) = "image/png"), (inline(Binary) = "application/x-npy"))),
        (status = 400, description = "a field is wrong", body = json::Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such map or frame", body = json::Problem, content_type = "application/problem+json"),
        (status = 429, description = "too many questions of this client wait", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn of_view(
    state: State,
    NamedMap(map): NamedMap,
    Asker(client): Asker,
    Options(waiting): Options<WaitOptions>,
    headers: HeaderMap,
    Body(request): Body<RenderRequest>,
) -> Result<Response, Problem> {
    picture(&state, &client, &waiting.read(&map).await?, request, &headers).await
}

async fn picture(
    state: &Shared,
    client: &Client,
    reading: &Reading,
    request: RenderRequest,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let started = Instant::now();
    let channel = channel_name(request.channel);
    let (snapshot, most) = (reading.snapshot.clone(), state.config.max_render_pixels);
    let request = check::render_request(request, |frame| snapshot.camera(frame), most)?;
    let picture = state.in_time(state.engine().render(client, snapshot, request)).await??;
    let npy = wants_npy(headers) && !matches!(picture, RenderedImage::Rgb { .. });
    let written = tokio::task::spawn_blocking(move || write(&picture, npy)).await;
    let file = written
        .map_err(|_| Problem::internal("writing the image panicked: see the server's log"))?;
    metrics::histogram!(RENDER_SECONDS, "channel" => channel).record(started.elapsed());
    let kind = if npy { NPY } else { "image/png" };
    // The same URL gives another image when the map has changed.
    let headers = [
        (header::CONTENT_TYPE, kind),
        (header::VARY, "accept"),
        (header::CACHE_CONTROL, "no-cache"),
    ];
    Ok((headers, reading::headers(reading), file).into_response())
}

fn write(picture: &RenderedImage, npy: bool) -> Vec<u8> {
    match picture {
        RenderedImage::Rgb { width, height, data } => export::rgb_png(*width, *height, data),
        RenderedImage::Depth { width, height, metres: values }
        | RenderedImage::Spread { width, height, values }
            if npy =>
        {
            export::npy(&[*height as usize, *width as usize], values)
        }
        RenderedImage::Depth { width, height, metres } => {
            export::depth_png(*width, *height, metres)
        }
        RenderedImage::Spread { width, height, values } => {
            export::heatmap_png(*width, *height, values)
        }
    }
}

/// The channel's name in metrics.
fn channel_name(channel: Channel) -> &'static str {
    match channel {
        Channel::Color => "color",
        Channel::Depth => "depth",
        Channel::Language => "language",
        Channel::Opacity => "opacity",
        Channel::Spread => "spread",
    }
}
