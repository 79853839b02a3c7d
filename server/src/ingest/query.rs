//! Answering questions over gRPC.

use super::context::Context;
use super::status;
use crate::check::{self, Question};
use crate::export::extremes;
use crate::pipeline::map::Reading;
use crate::pipeline::query::{
    Answer, Client, Heatmap, Object, ScoredPoint, Segmentation, Timing, Understood,
};
use crate::query_id::query_id;
use crate::telemetry::QUERY_SECONDS;
use lexsplat_proto::v1;
use std::time::Instant;
use tonic::Status;

pub(super) async fn answer(
    context: &Context,
    client: &Client,
    request: v1::QueryRequest,
) -> Result<v1::QueryResponse, Status> {
    let started = Instant::now();
    let map = context.maps.loaded(&request.map).await;
    let map = map.map_err(|error| status::of_maps(&error, "map"))?;
    let wait = check::wait(Some(&request.wait), request.min_sequence, request.wait_seconds);
    let wait = wait.map_err(|refusal| status::refused(&refusal))?;
    let question = Question::from_wire(request, &context.limits)
        .map_err(|refusal| status::refused(&refusal))?;
    let engine = context.maps.engine();
    let reading = map.read(&wait).await;
    let snapshot = reading.snapshot.clone();
    let failed = |error| status::of_query(&error);
    let response = match question {
        Question::Text(query) => {
            let text = query.text.clone();
            let answer = engine.query(client, snapshot, query).await.map_err(failed)?;
            response(answer, text, map.name().into())
        }
        Question::Texts(request) => {
            let texts = request.texts.clone();
            let found = engine.segment(client, snapshot, request).await.map_err(failed)?;
            segmentation(found, texts, map.name().into())
        }
    };
    let Reading { snapshot, settled, converged } = reading;
    let through = snapshot.through;
    let response = v1::QueryResponse { through, settled, converged, ..response };
    metrics::histogram!(QUERY_SECONDS, "edge" => "grpc").record(started.elapsed());
    Ok(response)
}

fn response(answer: Answer, text: String, map: String) -> v1::QueryResponse {
    v1::QueryResponse {
        query_id: query_id(),
        text,
        map,
        revision: answer.revision,
        present: answer.present,
        confidence: answer.confidence,
        coverage: answer.coverage,
        threshold: answer.threshold,
        heatmap: answer.heatmap.map(heatmap),
        uncertainty: answer.uncertainty.map(heatmap),
        mask: answer.mask.map(|mask| v1::Mask {
            height: mask.height,
            width: mask.width,
            counts: mask.counts,
        }),
        boxes: answer
            .boxes
            .unwrap_or_default()
            .into_iter()
            .map(|b| v1::Box { x: b.x, y: b.y, width: b.width, height: b.height, score: b.score })
            .collect(),
        peak: answer.peak.map(|peak| v1::Peak { x: peak.x, y: peak.y, score: peak.score }),
        points: answer.points.map(|points| point_set(&points)),
        objects: answer.objects.unwrap_or_default().iter().map(object).collect(),
        timing: Some(timing(answer.timing)),
        segmentation: None,
        understood: Some(understood(answer.understood)),
        reason: answer.reason.unwrap_or_default(),
        ..Default::default()
    }
}

fn understood(found: Understood) -> v1::Understood {
    let Understood { object, attributes, relation, others } = found;
    v1::Understood { object, attributes, relation: relation.unwrap_or_default(), others }
}

fn timing(timing: Timing) -> v1::Timing {
    v1::Timing {
        text_ms: timing.text,
        render_ms: timing.render,
        decode_ms: timing.decode,
        score_ms: timing.score,
        total_ms: timing.total,
    }
}

fn segmentation(found: Segmentation, texts: Vec<String>, map: String) -> v1::QueryResponse {
    let legend = texts.into_iter().zip(found.shares).zip(1..);
    let entry = |((text, share), label)| v1::LegendEntry { label, text, share };
    let image = found.image.map(|image| v1::LabelImage {
        width: image.width,
        height: image.height,
        labels: image.labels.into(),
    });
    let points = found.points.map(|points| v1::LabelledPoints {
        count: u32::try_from(points.len()).unwrap_or(u32::MAX),
        rows: points
            .iter()
            .flat_map(|p| [p.position.x, p.position.y, p.position.z, p.score])
            .collect(),
        labels: points.iter().map(|point| point.label).collect(),
    });
    v1::QueryResponse {
        query_id: query_id(),
        map,
        revision: found.revision,
        coverage: found.coverage,
        threshold: found.threshold,
        timing: Some(timing(found.timing)),
        segmentation: Some(v1::Segmentation { legend: legend.map(entry).collect(), image, points }),
        ..Default::default()
    }
}

fn heatmap(heatmap: Heatmap) -> v1::Heatmap {
    let (min, max) = extremes(&heatmap.values);
    let Heatmap { width, height, values } = heatmap;
    v1::Heatmap { width, height, min, max, values }
}

fn point_set(points: &[ScoredPoint]) -> v1::PointSet {
    let rows = points
        .iter()
        .flat_map(|point| [point.position.x, point.position.y, point.position.z, point.score])
        .collect();
    v1::PointSet { count: u32::try_from(points.len()).unwrap_or(u32::MAX), rows }
}

fn object(object: &Object) -> v1::Object {
    let vector = |xyz: [f32; 3]| v1::Vector3 {
        x: f64::from(xyz[0]),
        y: f64::from(xyz[1]),
        z: f64::from(xyz[2]),
    };
    let rotation = object.rotation;
    v1::Object {
        score: object.score,
        center_metres: Some(vector(object.center.into())),
        size_metres: Some(vector(object.size.into())),
        rotation: Some(v1::Quaternion {
            w: f64::from(rotation.w),
            x: f64::from(rotation.i),
            y: f64::from(rotation.j),
            z: f64::from(rotation.k),
        }),
        aabb_min_metres: Some(vector(object.aabb_min.into())),
        aabb_max_metres: Some(vector(object.aabb_max.into())),
        points: u32::try_from(object.points).unwrap_or(u32::MAX),
        distance_metres: object.distance,
        confidence: object.confidence,
    }
}
