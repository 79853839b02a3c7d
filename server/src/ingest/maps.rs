//! Making, describing, deleting and exporting maps over gRPC.

use super::convert::question::Question;
use super::{CHUNK_BACKLOG, CHUNK_BYTES, MappingService, status};
use crate::export::{self, Format, MeshOptions};
use crate::pipeline::map::MapStatus;
use lexsplat_proto::v1;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Status;

pub(super) async fn create(service: &MappingService, name: &str) -> Result<v1::MapStatus, Status> {
    let engine = service.engine.clone();
    let owned = name.to_owned();
    // Making a map takes device memory and a thread.
    let made = tokio::task::spawn_blocking(move || engine.create(&owned)).await;
    let map = made
        .map_err(|_| Status::internal("making the map panicked"))?
        .map_err(|error| status::of_map(&error, "name"))?;
    Ok(wire_status(map.status()))
}

pub(super) async fn delete(service: &MappingService, name: &str) -> Result<(), Status> {
    service.engine.delete(name).await.map_err(|error| status::of_map(&error, "name"))?;
    service.store.forget(name).await.map_err(|error| Status::internal(error.to_string()))
}

pub(super) fn wire_status(status: MapStatus) -> v1::MapStatus {
    v1::MapStatus {
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
        failure: status.failure.unwrap_or_default(),
    }
}

/// The file in chunks; a slow reader makes the sender wait, a reader that is gone ends it.
pub(super) async fn export(
    service: &MappingService,
    request: v1::ExportRequest,
) -> Result<ReceiverStream<Result<v1::Chunk, Status>>, Status> {
    let map = service.engine.map(&request.map).map_err(|error| status::of_map(&error, "map"))?;
    let format = request.format.parse::<Format>().map_err(|error| status::of_export(&error))?;
    let words = (!request.text.is_empty()).then_some(request.text);
    let question = words.map(|text| Question::about(&text).checked("smoothing_pixels"));
    let question = question.transpose().map_err(|refusal| status::refused(&refusal))?;
    let options = MeshOptions { voxel_metres: request.voxel_metres, question };
    let file = export::file(&service.engine, map.snapshot(), format, options)
        .await
        .map_err(|error| status::of_export(&error))?;
    let mut file = prost::bytes::Bytes::from(file);
    let (chunks, stream) = mpsc::channel(CHUNK_BACKLOG);
    tokio::spawn(async move {
        while !file.is_empty() {
            let data = file.split_to(CHUNK_BYTES.min(file.len()));
            if chunks.send(Ok(v1::Chunk { data })).await.is_err() {
                return;
            }
        }
    });
    Ok(ReceiverStream::new(stream))
}
