//! Reading the frames of a map, and waiting for more.

use super::super::bus::Bus;
use super::record::{Assembly, Entry, Head};
use async_nats::jetstream::consumer::pull;
use async_nats::jetstream::consumer::{AckPolicy, DeliverPolicy};
use futures::future::BoxFuture;
use futures::{FutureExt as _, StreamExt as _};
use std::time::Duration;

/// Between two tries to read.
const AGAIN: Duration = Duration::from_millis(300);
/// Messages that are fetched ahead.
const AHEAD: usize = 16;
/// The longest wait for a message before the server is asked again.
const EXPIRES: Duration = Duration::from_secs(10);
/// How often the server says that it is there meanwhile.
const HEARTBEAT: Duration = Duration::from_secs(2);
/// When JetStream forgets a reader that does not read.
const FORGOTTEN: Duration = Duration::from_secs(30);

/// Why the log cannot be read on.
#[derive(Debug, thiserror::Error)]
pub(in super::super) enum ReadError {
    #[error(
        "the log does not have the frames behind position {after}: they were trimmed, and the map is made of a newer \
         checkpoint"
    )]
    Gap { after: u64 },
    #[error("the log has a message that cannot be read, at position {position}: {reason}")]
    Unreadable { position: u64, reason: String },
}

type Beginning = BoxFuture<'static, Result<pull::Stream, async_nats::Error>>;

/// Reads the log of a map behind a position.
pub(in super::super) struct Reader {
    bus: Bus,
    subject: String,
    /// Position of the newest message that was read.
    after: u64,
    messages: Option<pull::Stream>,
    /// The begin of reading, as long as it takes.
    beginning: Option<Beginning>,
    assembly: Assembly,
    /// Messages that wait, as JetStream said with the newest one.
    pending: u64,
}

impl Reader {
    /// Reads `map` behind a position; 0 for all.
    pub(in super::super) fn new(bus: &Bus, map: &str, after: u64) -> Self {
        let (bus, subject) = (bus.clone(), bus.frames_of(map));
        Self {
            bus,
            subject,
            after,
            messages: None,
            beginning: None,
            assembly: Assembly::default(),
            pending: 0,
        }
    }

    /// Messages that wait behind the newest entry.
    pub(in super::super) fn pending(&self) -> u64 {
        self.pending
    }

    /// Position of the newest message that was read.
    pub(in super::super) fn position(&self) -> u64 {
        self.after
    }

    /// The next entry; waits for it as long as it takes. Nothing is lost if the wait is given up.
    ///
    /// # Errors
    /// [`ReadError`].
    pub(in super::super) async fn next(&mut self) -> Result<Entry, ReadError> {
        loop {
            let Some(messages) = &mut self.messages else {
                let begin = || begin(self.bus.clone(), self.subject.clone(), self.after).boxed();
                let begun = self.beginning.get_or_insert_with(begin).await;
                self.beginning = None;
                match begun {
                    Ok(messages) => self.messages = Some(messages),
                    Err(error) => {
                        tracing::warn!(%error, subject = self.subject, "the log cannot be read: trying again");
                        tokio::time::sleep(AGAIN).await;
                    }
                }
                continue;
            };
            let message = match messages.next().await {
                Some(Ok(message)) => message,
                Some(Err(error)) => {
                    tracing::debug!(%error, subject = self.subject, "reading the log again");
                    self.messages = None;
                    tokio::time::sleep(AGAIN).await;
                    continue;
                }
                None => {
                    self.messages = None;
                    continue;
                }
            };
            let Ok((position, pending)) =
                message.info().map(|info| (info.stream_sequence, info.pending))
            else {
                continue;
            };
            if position <= self.after {
                continue;
            }
            let unreadable = |reason| ReadError::Unreadable { position, reason };
            let headers =
                message.headers.as_ref().ok_or_else(|| unreadable("no headers".into()))?;
            let head = Head::of(headers).map_err(unreadable)?;
            if head.before != self.after {
                return Err(ReadError::Gap { after: self.after });
            }
            (self.after, self.pending) = (position, pending);
            let entry = self.assembly.add(&head, &message.payload, position).map_err(unreadable)?;
            if let Some(entry) = entry {
                return Ok(entry);
            }
        }
    }
}

async fn begin(bus: Bus, subject: String, after: u64) -> Result<pull::Stream, async_nats::Error> {
    let consumer = bus.frames.create_consumer(pull::Config {
        deliver_policy: DeliverPolicy::ByStartSequence { start_sequence: after + 1 },
        ack_policy: AckPolicy::None,
        filter_subject: subject,
        inactive_threshold: FORGOTTEN,
        memory_storage: true,
        num_replicas: 1,
        ..pull::Config::default()
    });
    let messages = consumer.await?;
    let messages = messages.stream().max_messages_per_batch(AHEAD);
    Ok(messages.expires(EXPIRES).heartbeat(HEARTBEAT).messages().await?)
}
