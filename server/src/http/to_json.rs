//! Pipeline types as JSON types.

use crate::export;
use crate::maps::{Listed, LoadProgress};
use crate::pipeline::frame::Intrinsics;
use crate::pipeline::input_warning::InputWarning;
use crate::pipeline::map::{MapStatus, Reading};
use crate::pipeline::query::{
    Answer, Heatmap, Object, ScoredBox, Segmentation, Timing, Understood,
};
use crate::pipeline::snapshot::KeyframeInfo;
use crate::pipeline::up::MapUp;
use lexsplat_proto::json;
use nalgebra::Isometry3;

/// A map in the list of maps.
pub(crate) fn listed(listed: Listed) -> json::Status {
    let state = match listed.loading {
        Some(_) => json::MapState::Loading,
        None => state(&listed.status),
    };
    let loading = listed.loading.map(progress);
    json::Status { state, loading, ..status(listed.status) }
}

fn state(status: &MapStatus) -> json::MapState {
    if status.failure.is_some() { json::MapState::Failed } else { json::MapState::Ready }
}

pub(super) fn progress(progress: LoadProgress) -> json::LoadProgress {
    let LoadProgress { frames_done, frames_total } = progress;
    json::LoadProgress { frames_done, frames_total }
}

/// A map that is being loaded, for the readiness of the server.
pub(super) fn map_loading(map: String, loaded: LoadProgress) -> json::MapLoading {
    json::MapLoading { map, progress: progress(loaded) }
}

pub(super) fn status(status: MapStatus) -> json::Status {
    json::Status {
        state: state(&status),
        loading: None,
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
        tracking_state: status.tracking_state.as_str().into(),
        olae_version: status.olae_version,
        queue_depth: status.queue_depth,
        queue_capacity: status.queue_capacity,
        settled: status.settled,
        refinement: status.refinement.as_str().into(),
        failure: status.failure,
        recording_damage: status.recording_damage,
        up: status.up.map(up),
        input_warnings: status.input_warnings.into_iter().map(input_warning).collect(),
    }
}

fn up(up: MapUp) -> json::Up {
    let MapUp { direction, source, confidence } = up;
    json::Up {
        direction: direction.into_inner().into(),
        source: source.as_str().into(),
        confidence,
    }
}

fn input_warning(warning: InputWarning) -> json::InputWarning {
    json::InputWarning { problem: warning.problem.as_str().into(), message: warning.message }
}

pub(super) fn keyframe(info: &KeyframeInfo) -> json::Keyframe {
    json::Keyframe {
        sequence: info.frame.sequence,
        timestamp: export::seconds(info.frame.timestamp_nanos),
        timestamp_nanos: info.frame.timestamp_nanos,
        world_from_camera: rows(&info.frame.world_from_camera),
        camera: camera(info.intrinsics),
        has_language: info.has_language,
    }
}

fn camera(intrinsics: Intrinsics) -> json::Camera {
    let Intrinsics { width, height, fx, fy, cx, cy } = intrinsics;
    json::Camera { width, height, fx, fy, cx, cy }
}

/// A transform as 16 numbers, row-major.
pub(super) fn rows(transform: &Isometry3<f64>) -> [f64; 16] {
    let matrix = transform.to_homogeneous();
    std::array::from_fn(|at| matrix[(at / 4, at % 4)])
}

/// Address of a part of an answer, relative to that of the question, `…/v1/maps/{name}/query`: a proxy may
/// show the server below a path that the server does not know.
fn link(query_id: &str, part: &str) -> String {
    format!("queries/{query_id}/{part}")
}

/// An answer as JSON; the heat map and the points become links with `query_id`.
pub(super) fn answer(
    query_id: String,
    text: String,
    reading: &Reading,
    answer: &Answer,
) -> json::Answer {
    let map = &reading.snapshot.map;
    let url = |what: &str| link(&query_id, what);
    json::Answer {
        text,
        map: map.clone(),
        revision: answer.revision,
        through: reading.snapshot.through,
        settled: reading.settled,
        converged: reading.converged,
        understood: understood(&answer.understood),
        present: answer.present,
        reason: answer.reason.clone(),
        confidence: answer.confidence,
        coverage: answer.coverage,
        threshold: answer.threshold,
        heatmap: answer.heatmap.as_ref().map(|image| image_link(image, url("heatmap"))),
        uncertainty: answer.uncertainty.as_ref().map(|image| image_link(image, url("uncertainty"))),
        mask: answer
            .mask
            .as_ref()
            .map(|mask| json::Rle { size: [mask.height, mask.width], counts: mask.counts.clone() }),
        boxes: answer.boxes.as_ref().map(|boxes| boxes.iter().map(pixel_box).collect()),
        peak: answer.peak.map(|peak| json::Peak { x: peak.x, y: peak.y, score: peak.score }),
        points: answer
            .points
            .as_ref()
            .map(|points| json::PointsLink { count: points.len(), url: url("points") }),
        objects: answer.objects.as_ref().map(|objects| objects.iter().map(object).collect()),
        timing_ms: timing(answer.timing),
        query_id,
    }
}

fn image_link(image: &Heatmap, url: String) -> json::HeatmapLink {
    let (min, max) = export::extremes(&image.values);
    json::HeatmapLink { width: image.width, height: image.height, min, max, url }
}

fn understood(found: &Understood) -> json::Understood {
    let Understood { object, attributes, relation, others } = found.clone();
    json::Understood { object, attributes, relation, others }
}

fn pixel_box(found: &ScoredBox) -> json::PixelBox {
    let ScoredBox { x, y, width, height, score } = *found;
    json::PixelBox { x, y, width, height, score }
}

fn object(found: &Object) -> json::Object {
    let q = found.rotation;
    json::Object {
        score: found.score,
        confidence: found.confidence,
        center: found.center.into(),
        size: found.size.into(),
        rotation: [q.w, q.i, q.j, q.k],
        aabb_min: found.aabb_min.into(),
        aabb_max: found.aabb_max.into(),
        points: found.points,
        distance: found.distance,
    }
}

/// A segmentation as JSON; the labels become links with `query_id`.
pub(super) fn segmentation(
    query_id: String,
    texts: Vec<String>,
    reading: &Reading,
    found: &Segmentation,
) -> json::Segmentation {
    let map = &reading.snapshot.map;
    let url = |what: &str| link(&query_id, what);
    let entry = |(at, (text, &share)): (usize, (&String, &f32))| {
        let [red, green, blue] = export::label_color(at + 1);
        let color = format!("#{red:02x}{green:02x}{blue:02x}");
        json::LegendEntry { label: at + 1, text: text.clone(), color, share }
    };
    json::Segmentation {
        legend: texts.iter().zip(&found.shares).enumerate().map(entry).collect(),
        texts,
        map: map.clone(),
        revision: found.revision,
        through: reading.snapshot.through,
        settled: reading.settled,
        converged: reading.converged,
        coverage: found.coverage,
        threshold: found.threshold,
        labels: found.image.as_ref().map(|image| {
            let (width, height) = (image.width, image.height);
            json::LabelsLink { width, height, url: url("labels") }
        }),
        points: found
            .points
            .as_ref()
            .map(|points| json::PointsLink { count: points.len(), url: url("points") }),
        timing_ms: timing(found.timing),
        query_id,
    }
}

fn timing(timing: Timing) -> json::Timing {
    let Timing { text, render, decode, score, total } = timing;
    json::Timing { text, render, decode, score, total }
}
