//! Acknowledgements on their way from workers to gateways.
//!
//! They are not stored: whoever misses one asks for it again. Each carries its worker's fencing token; a
//! gateway that has seen a greater one drops it.

use super::bus::{Bus, Failed};
use super::registry::{self, MapEntry, is_fenced};
use async_nats::{HeaderMap, Subscriber};
use futures::StreamExt as _;
use lexsplat_proto::v1::FrameAck;
use prost::Message as _;
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::oneshot;

/// Acknowledgements that a worker keeps for those who missed them.
const KEPT: usize = 1024;
/// The most unread acknowledgements that a stream of a gateway may have: so few that a worker has all that it
/// waits for.
pub(crate) const MOST_UNREAD: usize = KEPT / 2;
/// The fencing token of the worker.
const TOKEN: &str = "Lexsplat-Token";

/// The acknowledgements of a map's worker.
pub(super) struct AckLog {
    bus: Bus,
    map: String,
    token: u64,
    kept: Mutex<VecDeque<FrameAck>>,
}

impl AckLog {
    /// `before`: those of the owner before that a checkpoint has.
    pub(super) fn new(bus: &Bus, map: &str, token: u64, before: Vec<FrameAck>) -> Arc<Self> {
        let kept = Mutex::new(before.into());
        Arc::new(Self { bus: bus.clone(), map: map.to_owned(), token, kept })
    }

    fn locked(&self) -> MutexGuard<'_, VecDeque<FrameAck>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Acknowledges a frame.
    pub(super) async fn publish(&self, ack: FrameAck) {
        {
            let mut kept = self.locked();
            kept.push_back(ack.clone());
            let surplus = kept.len().saturating_sub(KEPT);
            kept.drain(..surplus);
        }
        self.send(&ack).await;
    }

    async fn send(&self, ack: &FrameAck) {
        let mut headers = HeaderMap::new();
        headers.insert(TOKEN, self.token.to_string());
        let subject = self.bus.acks_of(&self.map);
        let sent =
            self.bus.client.publish_with_headers(subject, headers, ack.encode_to_vec().into());
        if let Err(error) = sent.await {
            tracing::warn!(%error, map = self.map, "an acknowledgement was not sent: it is asked for again");
        }
    }

    /// The acknowledgements up to a frame, oldest first.
    pub(super) fn through(&self, sequence: u64) -> Vec<FrameAck> {
        self.locked().iter().filter(|ack| ack.sequence <= sequence).cloned().collect()
    }

    /// Whether a frame was acknowledged, or a later one.
    pub(super) fn has(&self, sequence: u64) -> bool {
        self.locked().back().is_some_and(|ack| ack.sequence >= sequence)
    }

    /// Sends acknowledgements again to those who ask.
    ///
    /// # Errors
    /// [`Failed`].
    pub(super) async fn answer(self: Arc<Self>) -> Result<(), Failed> {
        let asked = self.bus.client.subscribe(self.bus.again_of(&self.map)).await;
        let mut asked = asked.map_err(|error| Failed::new("waiting for questions", error))?;
        while let Some(message) = asked.next().await {
            let Some(from) =
                std::str::from_utf8(&message.payload).ok().and_then(|t| t.parse().ok())
            else {
                continue;
            };
            let again: Vec<FrameAck> =
                self.locked().iter().filter(|ack| ack.sequence >= from).cloned().collect();
            for ack in again {
                self.send(&ack).await;
            }
        }
        Ok(())
    }
}

/// A frame that waits: since when, and who is told.
type Waiter = (Instant, oneshot::Sender<FrameAck>);

/// The frames of a gateway that wait for their acknowledgements, by stream and sequence. Cheap to clone.
#[derive(Clone, Default)]
pub(super) struct Waiting(Arc<Mutex<BTreeMap<(String, u64), Waiter>>>);

impl Waiting {
    fn locked(&self) -> MutexGuard<'_, BTreeMap<(String, u64), Waiter>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A frame that will be in the log waits from now on.
    pub(super) fn add(&self, stream: &str, sequence: u64) -> oneshot::Receiver<FrameAck> {
        let (sender, receiver) = oneshot::channel();
        self.locked().insert((stream.to_owned(), sequence), (Instant::now(), sender));
        receiver
    }

    fn acknowledge(&self, stream: &str, ack: FrameAck) {
        if let Some((_, waiter)) = self.locked().remove(&(stream.to_owned(), ack.sequence)) {
            // If this fails, the stream has ended.
            let _ = waiter.send(ack);
        }
    }

    /// The first frame of a stream that has waited for so long.
    fn overdue(&self, stream: &str, patience: Duration) -> Option<u64> {
        let waiting = self.locked();
        let mut of_stream = waiting.range((stream.to_owned(), 0)..=(stream.to_owned(), u64::MAX));
        let (&(_, sequence), (since, _)) = of_stream.next()?;
        (since.elapsed() > patience).then_some(sequence)
    }

    /// Forgets the frames of a stream.
    pub(super) fn forget(&self, stream: &str) {
        self.locked().retain(|(of, _), _| of != stream);
    }

    /// How long the oldest frame has waited.
    pub(super) fn oldest(&self) -> Duration {
        self.locked().values().map(|(since, _)| since.elapsed()).max().unwrap_or_default()
    }
}

/// Asks the worker of a map for the acknowledgements from a frame on. Returns false if the map was deleted.
async fn ask_again(bus: &Bus, map: &str, id: &str, from: u64) -> bool {
    match registry::find(bus, map).await {
        Ok(found) if found.as_ref().is_none_or(|(entry, _)| entry.id != id) => return false,
        Ok(_) => {}
        Err(error) => tracing::warn!(%error, map, "nobody knows whether the map is there"),
    }
    let asked = bus.client.publish(bus.again_of(map), from.to_string().into());
    if let Err(error) = asked.await {
        tracing::warn!(%error, map, "cannot ask for acknowledgements");
    }
    true
}

/// Hands the acknowledgements of a map to a stream that waits, and asks for those that do not come. `entry`:
/// the map as it was when the stream was opened.
pub(super) async fn receive(
    bus: Bus,
    (map, entry): (String, MapEntry),
    stream: String,
    waiting: Waiting,
    mut acks: Subscriber,
    patience: Duration,
) {
    let MapEntry { id, token: mut newest, .. } = entry;
    let mut look = tokio::time::interval(patience);
    loop {
        let message = tokio::select! {
            message = acks.next() => message,
            _ = look.tick() => {
                if let Some(from) = waiting.overdue(&stream, patience)
                    && !ask_again(&bus, &map, &id, from).await
                {
                    // Nobody will acknowledge its frames.
                    waiting.forget(&stream);
                }
                continue;
            }
        };
        let Some(message) = message else { return };
        let token = message.headers.as_ref().and_then(|headers| headers.get(TOKEN));
        let token = token.and_then(|token| token.as_str().parse().ok()).unwrap_or(0);
        if is_fenced(newest, token) {
            tracing::info!(map, token, newest, "an acknowledgement of an owner before was dropped");
            continue;
        }
        newest = newest.max(token);
        match FrameAck::decode(message.payload) {
            Ok(ack) => {
                tracing::debug!(map, stream, token, sequence = ack.sequence, "acknowledged");
                waiting.acknowledge(&stream, ack);
            }
            Err(error) => tracing::error!(%error, map, "an acknowledgement cannot be read"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_waits_is_told_and_others_are_not() {
        let waiting = Waiting::default();
        let mut first = waiting.add("a", 3);
        let mut second = waiting.add("a", 4);
        let mut other = waiting.add("b", 3);
        let ack = |sequence| FrameAck { sequence, ..FrameAck::default() };
        waiting.acknowledge("a", ack(3));
        waiting.acknowledge("a", ack(9));
        assert_eq!(first.try_recv().unwrap().sequence, 3);
        assert!(second.try_recv().is_err() && other.try_recv().is_err());
        assert_eq!(waiting.overdue("a", Duration::ZERO), Some(4));
        assert_eq!(waiting.overdue("a", Duration::from_secs(60)), None);
        waiting.forget("a");
        assert_eq!(waiting.overdue("a", Duration::ZERO), None);
        assert_eq!(waiting.overdue("b", Duration::ZERO), Some(3));
        assert!(waiting.oldest() > Duration::ZERO);
    }
}
