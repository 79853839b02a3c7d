//! Heat maps, labels and points of the newest answers, kept until newer ones need their place.

use super::extract::{NPY, NamedMap, Segments, wants_npy};
use super::{Problem, State};
use crate::export;
use crate::pipeline::query::{
    Answer, Heatmap, LabelImage, LabelledPoint, ScoredPoint, Segmentation,
};
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse as _, Response};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};

/// A new query's id: 128 random bits, so that nobody can guess another's.
pub fn query_id() -> String {
    format!("{:032x}", rand::random::<u128>())
}

/// What is kept of an answer.
#[derive(Default)]
struct Kept {
    id: String,
    map: String,
    heatmap: Option<Heatmap>,
    points: Option<Vec<ScoredPoint>>,
    labels: Option<Arc<LabelImage>>,
    labelled: Option<Vec<LabelledPoint>>,
}

impl Kept {
    fn bytes(&self) -> usize {
        let heatmap = self.heatmap.as_ref().map_or(0, |heatmap| heatmap.values.len());
        let points = self.points.as_ref().map_or(0, Vec::len);
        let labels = self.labels.as_ref().map_or(0, |image| image.labels.len());
        let labelled = self.labelled.as_ref().map_or(0, Vec::len);
        heatmap * size_of::<f32>()
            + points * size_of::<ScoredPoint>()
            + labels
            + labelled * size_of::<LabelledPoint>()
    }
}

/// The newest answers, oldest first; bounded in number and bytes.
pub(super) struct Answers {
    kept: Mutex<VecDeque<Arc<Kept>>>,
    max_count: usize,
    max_bytes: usize,
}

impl Answers {
    pub(super) fn new(max_count: usize, max_bytes: usize) -> Self {
        Self { kept: Mutex::default(), max_count, max_bytes }
    }

    fn locked(&self) -> MutexGuard<'_, VecDeque<Arc<Kept>>> {
        self.kept.lock().expect("no thread panics while it holds the answers")
    }

    /// Takes the heat map and the points out of the answer; the newest answer is always kept.
    pub(super) fn keep(&self, id: &str, map: &str, answer: &mut Answer) {
        let (heatmap, points) = (answer.heatmap.take(), answer.points.take());
        if heatmap.is_none() && points.is_none() {
            return;
        }
        self.push(Kept { id: id.into(), map: map.into(), heatmap, points, ..Kept::default() });
    }

    /// Keeps the labels of an answer to several texts.
    pub(super) fn keep_labels(&self, id: &str, map: &str, found: Segmentation) {
        let (labels, labelled) = (found.image.map(Arc::new), found.points);
        self.push(Kept { id: id.into(), map: map.into(), labels, labelled, ..Kept::default() });
    }

    fn push(&self, newest: Kept) {
        let mut kept = self.locked();
        kept.push_back(Arc::new(newest));
        let mut bytes: usize = kept.iter().map(|answer| answer.bytes()).sum();
        while kept.len() > 1 && (kept.len() > self.max_count || bytes > self.max_bytes) {
            bytes -= kept.pop_front().map_or(0, |oldest| oldest.bytes());
        }
    }

    /// The labels of an answer's pixels.
    pub(super) fn labels(&self, map: &str, id: &str) -> Result<Arc<LabelImage>, Problem> {
        let detail = "the answer has no labels: ask with \"texts\" about a view";
        self.find(map, id)?.labels.clone().ok_or_else(|| Problem::not_found(detail))
    }

    fn find(&self, map: &str, id: &str) -> Result<Arc<Kept>, Problem> {
        let found = self.locked().iter().find(|kept| kept.id == id && kept.map == map).cloned();
        found.ok_or_else(|| {
            let detail = format!("query {id:?} is not among the newest answers: ask again");
            Problem::not_found(detail).at("query_id")
        })
    }
}

/// The relevancy of every pixel of an answer: PNG in color, or float32 `[height, width]`.
#[utoipa::path(
    get, path = "/v1/maps/{name}/queries/{query_id}/heatmap", tag = "query",
    params(("name" = String, Path), ("query_id" = String, Path)),
    responses(
        (status = 200, description = "PNG, or with Accept: application/x-npy an array",
            content((Vec<u8> = "image/png"), (Vec<u8> = "application/x-npy"))),
        (status = 404, description = "not kept", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn heatmap(
    state: State,
    NamedMap(map): NamedMap,
    segments: Segments,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let kept = state.answers.find(map.name(), segments.get("query_id"))?;
    if kept.heatmap.is_none() {
        return Err(Problem::not_found("the answer has no heat map: ask for output \"heatmap\""));
    }
    let npy = wants_npy(&headers);
    let written = tokio::task::spawn_blocking(move || {
        let heatmap = kept.heatmap.as_ref().expect("it was there a moment ago");
        let (width, height) = (heatmap.width, heatmap.height);
        match npy {
            true => export::npy(&[height as usize, width as usize], &heatmap.values),
            false => export::heatmap_png(width, height, &heatmap.values),
        }
    });
    let file = written.await.map_err(|_| Problem::internal("writing the heat map panicked"))?;
    let kind = if npy { NPY } else { "image/png" };
    Ok(([(header::CONTENT_TYPE, kind), (header::VARY, "accept")], file).into_response())
}

/// The points of an answer, 2 cm apart on the surface of what was found: PLY (x, y, z, score), or float32
/// `[count, 4]`; after `texts` all Gaussians with language: PLY (x, y, z, red, green, blue, label, score), or
/// float32 `[count, 5]` (x, y, z, label, score).
#[utoipa::path(
    get, path = "/v1/maps/{name}/queries/{query_id}/points", tag = "query",
    params(("name" = String, Path), ("query_id" = String, Path)),
    responses(
        (status = 200, description = "PLY, or with Accept: application/x-npy an array",
            content((Vec<u8> = "application/octet-stream"), (Vec<u8> = "application/x-npy"))),
        (status = 404, description = "not kept", body = Problem, content_type = "application/problem+json"),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::query::Timing;

    fn answer(pixels: usize) -> Answer {
        Answer {
            revision: 1,
            present: true,
            confidence: 1.0,
            coverage: 1.0,
            threshold: 0.5,
            heatmap: Some(Heatmap { width: pixels as u32, height: 1, values: vec![0.5; pixels] }),
            mask: None,
            boxes: None,
            peak: None,
            points: None,
            objects: None,
            timing: Timing::default(),
        }
    }

    #[test]
    fn the_newest_are_kept_within_number_and_bytes() {
        let answers = Answers::new(3, 100);
        for id in ["a", "b", "c", "d"] {
            answers.keep(id, "kitchen", &mut answer(5));
        }
        assert!(answers.find("kitchen", "a").is_err());
        assert!(answers.find("kitchen", "b").is_ok());
        assert!(answers.find("garage", "b").is_err());
        answers.keep("e", "kitchen", &mut answer(21));
        assert!(answers.find("kitchen", "d").is_err());
        answers.keep("f", "kitchen", &mut answer(500));
        assert!(answers.find("kitchen", "e").is_err());
        assert!(answers.find("kitchen", "f").is_ok());
        assert_ne!(query_id(), query_id());
    }
}
