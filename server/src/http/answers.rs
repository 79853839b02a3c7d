//! Fetching the heat map, uncertainty, labels and points of recent answers.

use super::answer_cache::Kept;
use super::error::Problem;
use super::extract::{NPY, NamedMap, Segments, wants_npy};
use super::schema::Binary;
use super::state::{Shared, State};
use crate::export;
use crate::pipeline::query::{Heatmap, LabelledPoint, ScoredPoint};
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse as _, Response};
use lexsplat_proto::json;

/// The relevancy of every pixel: PNG in color, or float32 npy `[height, width]`.
#[utoipa::path(
    get, path = "/v1/maps/{name}/queries/{query_id}/heatmap", operation_id = "get_heatmap", tag = "query",
    params(("name" = String, Path), ("query_id" = String, Path)),
    responses(
        (status = 200, description = "PNG; with Accept: application/x-npy an array",
            content((inline(Binary) = "image/png"), (inline(Binary) = "application/x-npy"))),
        (status = 404, description = "the answer is no longer kept, or has no such part", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn heatmap(
    state: State,
    NamedMap(map): NamedMap,
    segments: Segments,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let missing = "the answer has no heat map: ask for output \"heatmap\"";
    image(&state, map.name(), &segments, &headers, |kept| kept.heatmap.as_ref(), missing).await
}

/// The probability that a pixel is in the mask and should not be, or the other way round: PNG in color, or
/// float32 npy `[height, width]`.
#[utoipa::path(
    get, path = "/v1/maps/{name}/queries/{query_id}/uncertainty", operation_id = "get_uncertainty", tag = "query",
    params(("name" = String, Path), ("query_id" = String, Path)),
    responses(
        (status = 200, description = "PNG; with Accept: application/x-npy an array",
            content((inline(Binary) = "image/png"), (inline(Binary) = "application/x-npy"))),
        (status = 404, description = "the answer is no longer kept, or has no such part", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn uncertainty(
    state: State,
    NamedMap(map): NamedMap,
    segments: Segments,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let missing = "the answer has no uncertainty: ask for output \"uncertainty\" about a view";
    image(&state, map.name(), &segments, &headers, |kept| kept.uncertainty.as_ref(), missing).await
}

/// One of the images of an answer. `missing`: what to tell those whose answer has none.
async fn image(
    state: &Shared,
    map: &str,
    segments: &Segments,
    headers: &HeaderMap,
    of: fn(&Kept) -> Option<&Heatmap>,
    missing: &str,
) -> Result<Response, Problem> {
    let kept = state.answers.find(map, segments.get("query_id"))?;
    if of(&kept).is_none() {
        return Err(Problem::not_found(missing));
    }
    let npy = wants_npy(headers);
    let written = tokio::task::spawn_blocking(move || {
        let Heatmap { width, height, values } = of(&kept).expect("checked above");
        match npy {
            true => export::npy(&[*height as usize, *width as usize], values),
            false => export::heatmap_png(*width, *height, values),
        }
    });
    let file = written
        .await
        .map_err(|_| Problem::internal("writing the image panicked: see the server's log"))?;
    let kind = if npy { NPY } else { "image/png" };
    Ok(([(header::CONTENT_TYPE, kind), (header::VARY, "accept")], file).into_response())
}

/// The points of an answer. With `text`: points 2 cm apart on the surface of what was found, as PLY
/// (x, y, z, score) or float32 npy `[count, 4]`. With `texts`: all Gaussians with language, as PLY
/// (x, y, z, red, green, blue, label, score) or float32 npy `[count, 5]` (x, y, z, label, score).
#[utoipa::path(
    get, path = "/v1/maps/{name}/queries/{query_id}/points", operation_id = "get_points", tag = "query",
    params(("name" = String, Path), ("query_id" = String, Path)),
    responses(
        (status = 200, description = "PLY; with Accept: application/x-npy an array",
            content((inline(Binary) = "application/octet-stream"), (inline(Binary) = "application/x-npy"))),
        (status = 404, description = "the answer is no longer kept, or has no such part", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn points(
    state: State,
    NamedMap(map): NamedMap,
    segments: Segments,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let kept = state.answers.find(map.name(), segments.get("query_id"))?;
    let npy = wants_npy(&headers);
    let kind = if npy { NPY } else { "application/octet-stream" };
    let file = match (&kept.points, &kept.labelled) {
        (Some(points), _) if npy => {
            let row = |p: &ScoredPoint| [p.position.x, p.position.y, p.position.z, p.score];
            export::npy(
                &[points.len(), 4],
                points.iter().map(row).collect::<Vec<_>>().as_flattened(),
            )
        }
        (Some(points), _) => export::scored_points_ply(points),
        (None, Some(points)) if npy => {
            let row = |p: &LabelledPoint| {
                [p.position.x, p.position.y, p.position.z, f32::from(p.label), p.score]
            };
            export::npy(
                &[points.len(), 5],
                points.iter().map(row).collect::<Vec<_>>().as_flattened(),
            )
        }
        (None, Some(points)) => export::labelled_points_ply(points),
        (None, None) => {
            let detail = "the answer has no points: ask for output \"points\" without a view";
            return Err(Problem::not_found(detail));
        }
    };
    Ok(([(header::CONTENT_TYPE, kind), (header::VARY, "accept")], file).into_response())
}

/// The labels of the pixels of an answer to `texts`: PNG with a palette (the value of a pixel is
/// its label, 0 is transparent), or uint8 npy `[height, width]`.
#[utoipa::path(
    get, path = "/v1/maps/{name}/queries/{query_id}/labels", operation_id = "get_labels", tag = "query",
    params(("name" = String, Path), ("query_id" = String, Path)),
    responses(
        (status = 200, description = "PNG; with Accept: application/x-npy an array",
            content((inline(Binary) = "image/png"), (inline(Binary) = "application/x-npy"))),
        (status = 404, description = "the answer is no longer kept, or has no such part", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn labels(
    state: State,
    NamedMap(map): NamedMap,
    segments: Segments,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let image = state.answers.labels(map.name(), segments.get("query_id"))?;
    let (kind, file) = match wants_npy(&headers) {
        false => ("image/png", export::labels_png(image.width, image.height, &image.labels)),
        true => {
            let shape = [image.height as usize, image.width as usize];
            (NPY, export::npy(&shape, &image.labels))
        }
    };
    Ok(([(header::CONTENT_TYPE, kind), (header::VARY, "accept")], file).into_response())
}
