//! Creating, describing, deleting and exporting maps over gRPC.

use super::chunks::{Chunks, chunks};
use super::context::Context;
use super::status;
use crate::check;
use crate::export::{self, Format};
use crate::maps::{Listed, RenameError, rename as rename_map};
use crate::pipeline::input_warning::{InputProblem, InputWarning};
use crate::pipeline::map::{MapStatus, Reading};
use crate::pipeline::query::Client;
use crate::pipeline::up::MapUp;
use lexsplat_proto::v1;
use tonic::metadata::MetadataValue;
use tonic::{Response, Status};

pub(super) async fn create(context: &Context, name: &str) -> Result<v1::MapStatus, Status> {
    let map = context.maps.create(name).await.map_err(|error| status::of_maps(&error, "name"))?;
    Ok(wire_status(map.status()))
}

pub(super) async fn rename(context: &Context, name: &str, to: &str) -> Result<(), Status> {
    rename_map(&context.maps, name, to).await.map_err(|error| match error {
        RenameError::Maps(error) => status::of_maps(&error, "new_name"),
        RenameError::NotRecorded => Status::failed_precondition(error.to_string()),
    })
}

pub(super) async fn delete(context: &Context, name: &str) -> Result<(), Status> {
    context.maps.delete(name).await.map_err(|error| status::of_maps(&error, "name"))
}

/// A map in the list of maps.
pub(crate) fn wire_listed(listed: Listed) -> v1::MapStatus {
    let loading = listed.loading.map(|progress| v1::LoadProgress {
        frames_done: progress.frames_done,
        frames_total: progress.frames_total,
    });
    v1::MapStatus { loading, ..wire_status(listed.status) }
}

pub(super) fn wire_status(status: MapStatus) -> v1::MapStatus {
    v1::MapStatus {
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
        queue_depth: u32::try_from(status.queue_depth).unwrap_or(u32::MAX),
        settled: status.settled,
        refinement: status.refinement.as_str().into(),
        failure: status.failure.unwrap_or_default(),
        recording_damage: status.recording_damage.unwrap_or_default(),
        input_warnings: wire_warnings(status.input_warnings),
        up: status.up.map(wire_up),
    }
}

fn wire_up(up: MapUp) -> v1::MapUp {
    let MapUp { direction, source, confidence } = up;
    let direction = v1::Vector3 { x: direction.x, y: direction.y, z: direction.z };
    v1::MapUp {
        direction: Some(direction),
        source: source.as_str().into(),
        confidence: confidence as f32,
    }
}

/// Warnings about the input.
pub(super) fn wire_warnings(warnings: Vec<InputWarning>) -> Vec<v1::InputWarning> {
    let wire = |InputWarning { problem, message }| {
        let problem = match problem {
            InputProblem::DepthUnit => v1::InputProblem::DepthUnit,
            InputProblem::InvertedPoses => v1::InputProblem::InvertedPoses,
            InputProblem::CameraAxes => v1::InputProblem::CameraAxes,
            InputProblem::UnregisteredDepth => v1::InputProblem::UnregisteredDepth,
            InputProblem::RepeatedDepth => v1::InputProblem::RepeatedDepth,
            InputProblem::BadBeginning => v1::InputProblem::BadBeginning,
            InputProblem::NoDepth => v1::InputProblem::NoDepth,
        };
        v1::InputWarning { problem: problem.into(), message }
    };
    warnings.into_iter().map(wire).collect()
}

/// The exported file in chunks.
pub(super) async fn export(
    context: &Context,
    client: &Client,
    request: v1::ExportRequest,
) -> Result<Response<Chunks>, Status> {
    let map = context.maps.loaded(&request.map).await;
    let map = map.map_err(|error| status::of_maps(&error, "map"))?;
    let format = request.format.parse::<Format>().map_err(|error| status::of_export(&error))?;
    let text = (!request.text.is_empty()).then_some(&*request.text);
    let options = check::file_options(request.voxel_metres, text, Some(&request.up))
        .map_err(|refusal| status::refused(&refusal))?;
    let wait = check::wait(Some(&request.wait), request.min_sequence, request.wait_seconds)
        .map_err(|refusal| status::refused(&refusal))?;
    let reading = map.read(&wait).await;
    let file =
        export::file(context.maps.engine(), client, reading.snapshot.clone(), format, options)
            .await
            .map_err(|error| status::of_export(&error))?;
    let mut response = Response::new(chunks(file));
    let metadata = response.metadata_mut();
    let Reading { snapshot, settled, converged } = reading;
    metadata.insert("lexsplat-revision", snapshot.revision.into());
    for (name, is) in [("lexsplat-settled", settled), ("lexsplat-converged", converged)] {
        metadata.insert(name, MetadataValue::from_static(if is { "true" } else { "false" }));
    }
    if let Some(through) = snapshot.through {
        metadata.insert("lexsplat-through", through.into());
    }
    Ok(response)
}
