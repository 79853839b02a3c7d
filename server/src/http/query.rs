//! `POST /v1/maps/{name}/query`: where is it?

use super::answers::query_id;
use super::extract::{Body, NamedMap};
use super::segment::{self, SegmentationResponse};
use super::view::WireView;
use super::{Problem, State};
use crate::export;
use crate::ingest::convert::question::{Asked, Question};
use crate::pipeline::query::{Answer, Object, ScoredBox, Timing};
use crate::telemetry::QUERY_SECONDS;
use axum::Json;
use serde::{Deserialize, Serialize};
use std::time::Instant;
use utoipa::ToSchema;

/// A question in plain words: `text`, or `texts` that are compared with each other. Without `view` it
/// is a 3D query.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct QueryRequest {
    /// What is looked for.
    #[serde(default)]
    #[schema(example = "coffee cup")]
    text: Option<String>,
    /// Instead of `text`, 2 to 32 of them: which of them is each pixel, or each Gaussian?
    #[serde(default)]
    #[schema(example = json!(["chair", "table", "floor"]))]
    texts: Option<Vec<String>>,
    /// What it is not; absent or empty: the bundle's own.
    #[serde(default)]
    negatives: Option<Vec<String>>,
    /// Answer for this view.
    #[serde(default)]
    view: Option<WireView>,
    /// Only with `text`: any of heatmap, mask, boxes, points, objects; absent or empty: all that fit.
    #[serde(default)]
    outputs: Option<Vec<String>>,
    /// Relevancy above which something counts, 0 to 1; absent: the bundle's, with `texts` 0.5.
    #[serde(default)]
    threshold: Option<f32>,
    /// Side of the mean filter, pixels.
    #[serde(default)]
    smoothing: Option<u32>,
    /// The most objects in the answer.
    #[serde(default)]
    max_objects: Option<u32>,
    /// 3D: objects nearest to this point (metres in the map's world) come first, with `distance`.
    #[serde(default)]
    near: Option<[f32; 3]>,
    /// 3D: only points, and objects whose centres are, in this box.
    #[serde(default)]
    within: Option<WireBounds>,
}

/// An axis-aligned box, metres in the map's world.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct WireBounds {
    /// The least corner.
    min: [f32; 3],
    /// The greatest corner.
    max: [f32; 3],
}

/// An answer to `text`, or to `texts`.
#[derive(Debug, Serialize, ToSchema)]
#[serde(untagged)]
#[allow(clippy::large_enum_variant, reason = "one per request")]
pub(super) enum QueryReply {
    /// Where it is.
    Answer(QueryResponse),
    /// Which of them is what.
    Segmentation(SegmentationResponse),
}

/// What the map answers. Scores are relevancies in 0..1; metres in the map's world; pixels.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct QueryResponse {
    query_id: String,
    text: String,
    map: String,
    revision: u64,
    /// Whether what was asked for is there.
    present: bool,
    /// How sure that is, 0 to 1.
    confidence: f32,
    /// How much of what was asked about has been seen with language, 0 to 1.
    coverage: f32,
    threshold: f32,
    #[serde(skip_serializing_if = "Option::is_none")]
    heatmap: Option<HeatmapLink>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mask: Option<Rle>,
    #[serde(skip_serializing_if = "Option::is_none")]
    boxes: Option<Vec<PixelBox>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    peak: Option<PeakPixel>,
    #[serde(skip_serializing_if = "Option::is_none")]
    points: Option<PointsLink>,
    #[serde(skip_serializing_if = "Option::is_none")]
    objects: Option<Vec<SpaceObject>>,
    timing_ms: TimingMs,
}

/// Where the heat map is.
#[derive(Debug, Serialize, ToSchema)]
struct HeatmapLink {
    width: u32,
    height: u32,
    min: f32,
    max: f32,
    url: String,
}

/// Where the points are.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct PointsLink {
    pub(super) count: usize,
    pub(super) url: String,
}

/// A mask as COCO run lengths: column-major, starting with zeros.
#[derive(Debug, Serialize, ToSchema)]
struct Rle {
    /// Height, width.
    size: [u32; 2],
    counts: Vec<u32>,
}

/// A box in pixels; x, y is its top-left corner.
#[derive(Debug, Serialize, ToSchema)]
struct PixelBox {
    x: f32,
    y: f32,
    width: f32,
    height: f32,
    score: f32,
}

/// The most relevant pixel.
#[derive(Debug, Serialize, ToSchema)]
struct PeakPixel {
    x: f32,
    y: f32,
    score: f32,
}

/// A thing in space, with an oriented and an axis-aligned box, metres.
#[derive(Debug, Serialize, ToSchema)]
struct SpaceObject {
    score: f32,
    center: [f32; 3],
    size: [f32; 3],
    /// Quaternion (w, x, y, z).
    rotation: [f32; 4],
    aabb_min: [f32; 3],
    aabb_max: [f32; 3],
    points: usize,
    /// From `near` to the oriented box, metres; 0 inside.
    #[serde(skip_serializing_if = "Option::is_none")]
    distance: Option<f32>,
}

/// Where the time went, milliseconds.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct TimingMs {
    text: f32,
    render: f32,
    decode: f32,
    score: f32,
    total: f32,
}

impl From<Timing> for TimingMs {
    fn from(timing: Timing) -> Self {
        let Timing { text, render, decode, score, total } = timing;
        Self { text, render, decode, score, total }
    }
}

/// Asks a map in plain words.
#[utoipa::path(
    post, path = "/v1/maps/{name}/query", tag = "query",
    params(("name" = String, Path, description = "the map")),
    request_body = QueryRequest,
    responses(
        (status = 200, body = QueryReply),
        (status = 400, description = "a field is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such map or frame", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn ask(
    state: State,
    NamedMap(map): NamedMap,
    Body(request): Body<QueryRequest>,
) -> Result<Json<QueryReply>, Problem> {
    let started = Instant::now();
    let max_pixels = state.config.max_render_pixels;
    let view = request.view.map(|view| view.checked("view.", max_pixels)).transpose()?;
    let question = Question {
        text: request.text.unwrap_or_default(),
        texts: request.texts.unwrap_or_default(),
        negatives: request.negatives.unwrap_or_default(),
        view,
        outputs: request.outputs.unwrap_or_default(),
        threshold: request.threshold,
        smoothing_pixels: request.smoothing,
        max_objects: request.max_objects,
        near: request.near,
        within: request.within.map(|within| [within.min, within.max]),
    };
    let reply = match question.asked("smoothing")? {
        Asked::One(query) => {
            let text = query.text.clone();
            let mut answer = state.in_time(state.engine.query(&map, query)).await??;
            let response = response(text, map.name(), &answer);
            state.answers.keep(&response.query_id, map.name(), &mut answer);
            QueryReply::Answer(response)
        }
        Asked::Several(contest) => {
            let texts = contest.texts.clone();
            let found = state.in_time(state.engine.segment(&map, contest)).await??;
            let response = segment::response(texts, map.name(), &found);
            state.answers.keep_labels(&response.query_id, map.name(), found);
            QueryReply::Segmentation(response)
        }
    };
    metrics::histogram!(QUERY_SECONDS, "edge" => "http").record(started.elapsed());
    Ok(Json(reply))
}

fn response(text: String, map: &str, answer: &Answer) -> QueryResponse {
    let query_id = query_id();
    let url = |what: &str| format!("/v1/maps/{map}/queries/{query_id}/{what}");
    QueryResponse {
        text,
        map: map.into(),
        revision: answer.revision,
        present: answer.present,
        confidence: answer.confidence,
        coverage: answer.coverage,
        threshold: answer.threshold,
        heatmap: answer.heatmap.as_ref().map(|heatmap| {
            let (min, max) = export::extremes(&heatmap.values);
            let (width, height) = (heatmap.width, heatmap.height);
            HeatmapLink { width, height, min, max, url: url("heatmap") }
        }),
        mask: answer
            .mask
            .as_ref()
            .map(|mask| Rle { size: [mask.height, mask.width], counts: mask.counts.clone() }),
        boxes: answer.boxes.as_ref().map(|boxes| boxes.iter().map(pixel_box).collect()),
        peak: answer.peak.map(|peak| PeakPixel { x: peak.x, y: peak.y, score: peak.score }),
        points: answer
            .points
            .as_ref()
            .map(|points| PointsLink { count: points.len(), url: url("points") }),
        objects: answer.objects.as_ref().map(|objects| objects.iter().map(object).collect()),
        timing_ms: answer.timing.into(),
        query_id,
    }
}

fn pixel_box(found: &ScoredBox) -> PixelBox {
    let ScoredBox { x, y, width, height, score } = *found;
    PixelBox { x, y, width, height, score }
}

fn object(found: &Object) -> SpaceObject {
    let q = found.rotation;
    SpaceObject {
        score: found.score,
        center: found.center.into(),
        size: found.size.into(),
        rotation: [q.w, q.i, q.j, q.k],
        aabb_min: found.aabb_min.into(),
        aabb_max: found.aabb_max.into(),
        points: found.points,
        distance: found.distance,
    }
}
