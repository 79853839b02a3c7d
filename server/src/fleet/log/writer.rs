//! Writing the frames of one stream.

use super::super::bus::Bus;
use super::record::{Head, Record, split};
use crate::telemetry::FLEET_PUBLISH_SECONDS;
use async_nats::jetstream::context::PublishErrorKind;
use async_nats::jetstream::message::PublishMessage;
use async_nats::jetstream::stream::LastRawMessageErrorKind;
use lexsplat_proto::v1;
use prost::bytes::Bytes;
use std::time::{Duration, Instant};

/// How long JetStream may take for a message, with elections and reconnections.
const PATIENCE: Duration = Duration::from_secs(30);
/// Between two tries.
const AGAIN: Duration = Duration::from_millis(200);
/// Kept free in a message for its headers, bytes.
const HEADERS: usize = 4096;

/// Why the log does not have a record.
#[derive(Debug, thiserror::Error)]
pub(in super::super) enum WriteError {
    /// Another message came first.
    #[error("somebody else sends frames to the map, or it was deleted")]
    Taken,
    #[error("the log of the fleet takes no frames: {0}")]
    Unavailable(String),
}

/// The one writer of a map's log.
pub(in super::super) struct Writer {
    bus: Bus,
    subject: String,
    /// Unique name of the stream.
    stream: String,
    /// Records that were written.
    written: u64,
    /// Position of the newest message.
    last: u64,
    through: Option<u64>,
}

impl Writer {
    /// Begins a stream behind what the log has.
    ///
    /// # Errors
    /// [`WriteError`].
    pub(in super::super) async fn open(bus: &Bus, open: &v1::OpenMap) -> Result<Self, WriteError> {
        let subject = bus.frames_of(&open.map);
        let newest = newest(bus, &subject).await.map_err(WriteError::Unavailable)?;
        let (last, through) = newest.map_or((0, None), |(last, head)| (last, head.through));
        let stream = bus.unique();
        let mut writer = Self { bus: bus.clone(), subject, stream, written: 0, last, through };
        writer.write(&Record::Open(open.clone())).await?;
        Ok(writer)
    }

    /// Sequence of the newest frame of the log.
    pub(in super::super) fn through(&self) -> Option<u64> {
        self.through
    }

    /// Unique name of the stream.
    pub(in super::super) fn stream(&self) -> &str {
        &self.stream
    }

    /// Appends a record. When this returns, JetStream has it.
    ///
    /// # Errors
    /// [`WriteError`]; then nothing more can be written.
    pub(in super::super) async fn write(&mut self, record: &Record) -> Result<(), WriteError> {
        let began = Instant::now();
        let longest = self.bus.client.server_info().max_payload.saturating_sub(HEADERS).max(1024);
        let id = format!("{}/{}", self.stream, self.written);
        self.written += 1;
        for (mut head, payload) in split(record, &id, self.through, longest) {
            head.before = self.last;
            self.last = self.publish(&head, payload).await?;
            self.through = head.through;
        }
        metrics::histogram!(FLEET_PUBLISH_SECONDS).record(began.elapsed());
        Ok(())
    }

    /// Publishes a message until it is known what became of it. Returns its position.
    async fn publish(&self, head: &Head, payload: Bytes) -> Result<u64, WriteError> {
        let began = Instant::now();
        loop {
            let message = PublishMessage::build()
                .headers(head.to_headers())
                .payload(payload.clone())
                .expected_last_subject_sequence(head.before);
            let published =
                match self.bus.jetstream.send_publish(self.subject.clone(), message).await {
                    Ok(acked) => acked.await,
                    Err(error) => Err(error),
                };
            let error = match published {
                Ok(ack) => return Ok(ack.sequence),
                Err(error) => error,
            };
            // It may have arrived although nobody said so.
            match newest(&self.bus, &self.subject).await {
                Ok(Some((position, newest))) if newest.id == head.id => return Ok(position),
                Ok(newest)
                    if newest.as_ref().map_or(0, |(position, _)| *position) != head.before =>
                {
                    return Err(WriteError::Taken);
                }
                Ok(_) if error.kind() == PublishErrorKind::WrongLastSequence => {
                    return Err(WriteError::Taken);
                }
                Ok(_) | Err(_) if began.elapsed() > PATIENCE => {
                    return Err(WriteError::Unavailable(error.to_string()));
                }
                Ok(_) | Err(_) => {
                    tracing::warn!(%error, subject = self.subject, "the log has not taken a message: trying again");
                    tokio::time::sleep(AGAIN).await;
                }
            }
        }
    }
}

/// Position and headers of the newest message of a subject.
async fn newest(bus: &Bus, subject: &str) -> Result<Option<(u64, Head)>, String> {
    match bus.frames.get_last_raw_message_by_subject(subject).await {
        Ok(message) => Ok(Some((message.sequence, Head::of(&message.headers)?))),
        Err(error) if error.kind() == LastRawMessageErrorKind::NoMessageFound => Ok(None),
        Err(error) => Err(error.to_string()),
    }
}
