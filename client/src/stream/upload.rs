//! Streaming a whole data set into a map.

use super::connect::{Connection, connect};
use super::connection::{FrameStream, MapSpec};
use super::error::ClientError;
use super::options::{Encoder, Poses, StreamOptions};
use super::producer::Producer;
use super::summary::{Progress, Summary, Tally};
use crate::dataset::Dataset;
use lexsplat_proto::v1::mapping_client::MappingClient;
use std::sync::Arc;

/// Frames read ahead of the wire.
const READ_AHEAD: usize = 4;

/// Streams the frames that the map has not got yet, and waits for every acknowledgement.
///
/// A blocking thread reads or renders frames ahead of a bounded queue. When the server is busy,
/// flow control fills the queue and the thread waits; no frame is dropped. A frame that cannot be read is
/// left out, and the summary says so.
///
/// # Errors
/// [`ClientError`], also if no frame at all can be read. Frames acknowledged before the error are in the
/// map: the same call resumes after them.
pub async fn stream(
    dataset: Arc<dyn Dataset>,
    options: &StreamOptions,
    on_progress: impl FnMut(&Progress),
) -> Result<Summary, ClientError> {
    let client = connect(&options.grpc, &options.access).await?;
    stream_over(client, dataset, options, on_progress).await
}

/// The same over a connection, or to a service in this process; messages of errors call it `options.grpc`.
///
/// # Errors
/// As [`stream()`].
pub async fn stream_over(
    client: MappingClient<Connection>,
    dataset: Arc<dyn Dataset>,
    options: &StreamOptions,
    mut on_progress: impl FnMut(&Progress),
) -> Result<Summary, ClientError> {
    if options.encoder == Encoder::Oracle && dataset.truth().is_none() {
        return Err(ClientError::NoMasks { dataset: dataset.name().to_owned() });
    }
    let spec = MapSpec::of(&*dataset, options);
    let FrameStream { frames, mut acks, opened } =
        FrameStream::over(client, &options.grpc, spec, READ_AHEAD).await?;
    let seen = opened.received_through.max(opened.durable_through);
    let is_new = |index: &usize| seen.is_none_or(|seen| dataset.sequence(*index) > seen);
    let indices: Vec<usize> = (0..dataset.len()).filter(is_new).collect();
    let mut tally = Tally::new(&options.map, &opened, dataset.len(), indices.len());
    on_progress(&tally.progress(&opened));
    let producer = Producer {
        dataset,
        indices,
        needs_poses: options.poses == Poses::Given,
        realtime: options.realtime,
        labels: options.encoder == Encoder::Oracle,
        hold_out_every: options.hold_out_every,
        frames,
    };
    let producing = tokio::task::spawn_blocking(move || producer.run());
    while let Some(ack) = acks.next().await? {
        tally.count(&ack);
        on_progress(&tally.progress(&ack));
    }
    let mut left_out = producing.await.map_err(|_| ClientError::Panicked)?;
    tally.leave_out(&left_out);
    let Summary { sent, resumed_past, .. } = tally.summary;
    if sent + tally.summary.left_out < tally.total {
        return Err(ClientError::unanswered(&options.grpc));
    }
    match left_out.is_empty() {
        false if sent + resumed_past == 0 => Err(left_out.swap_remove(0).1),
        _ => Ok(tally.summary),
    }
}
