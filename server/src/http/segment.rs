//! Answers to several texts as JSON, and their labels as files: which of them is each pixel, or each
//! Gaussian?

use super::answers::query_id;
use super::extract::{NPY, NamedMap, Segments, wants_npy};
use super::query::{PointsLink, TimingMs};
use super::{Problem, State};
use crate::export;
use crate::pipeline::query::Segmentation;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;
use utoipa::ToSchema;

/// Which of the texts is what. Label 0 is none of them.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct SegmentationResponse {
    pub(super) query_id: String,
    texts: Vec<String>,
    map: String,
    revision: u64,
    /// How much of what was asked about has been seen with language, 0 to 1.
    coverage: f32,
    /// The relevancy that the best text had to exceed.
    threshold: f32,
    /// One for each text, in order.
    legend: Vec<LegendEntry>,
    /// Labels of the pixels; view queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    labels: Option<LabelsLink>,
    /// Labels of the Gaussians; 3D queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    points: Option<PointsLink>,
    timing_ms: TimingMs,
}

/// What a label means.
#[derive(Debug, Serialize, ToSchema)]
struct LegendEntry {
    /// The value of its pixels.
    label: usize,
    text: String,
    /// Its color in the PNG and the PLY.
    #[schema(example = "#e6194b")]
    color: String,
    /// The share of all pixels, or Gaussians, that have it.
    share: f32,
}

/// Where the labels of the pixels are.
#[derive(Debug, Serialize, ToSchema)]
struct LabelsLink {
    width: u32,
    height: u32,
    url: String,
}

/// The response; its labels are fetched by its id.
pub(super) fn response(
    texts: Vec<String>,
    map: &str,
    found: &Segmentation,
) -> SegmentationResponse {
    let query_id = query_id();
    let url = |what: &str| format!("/v1/maps/{map}/queries/{query_id}/{what}");
    let entry = |(at, (text, &share)): (usize, (&String, &f32))| {
        let [red, green, blue] = export::label_color(at + 1);
        let color = format!("#{red:02x}{green:02x}{blue:02x}");
        LegendEntry { label: at + 1, text: text.clone(), color, share }
    };
    SegmentationResponse {
        legend: texts.iter().zip(&found.shares).enumerate().map(entry).collect(),
        texts,
        map: map.into(),
        revision: found.revision,
        coverage: found.coverage,
        threshold: found.threshold,
        labels: found.image.as_ref().map(|image| {
            let (width, height) = (image.width, image.height);
            LabelsLink { width, height, url: url("labels") }
        }),
        points: found
            .points
            .as_ref()
            .map(|points| PointsLink { count: points.len(), url: url("points") }),
        timing_ms: found.timing.into(),
        query_id,
    }
}

/// The labels of an answer to several texts: PNG with a palette (a pixel's value is its label, 0 is
/// transparent), or uint8 `[height, width]`.
#[utoipa::path(
    get, path = "/v1/maps/{name}/queries/{query_id}/labels", tag = "query",
    params(("name" = String, Path), ("query_id" = String, Path)),
    responses(
        (status = 200, description = "PNG, or with Accept: application/x-npy an array",
            content((Vec<u8> = "image/png"), (Vec<u8> = "application/x-npy"))),
        (status = 404, description = "not kept", body = Problem, content_type = "application/problem+json"),
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
