//! `GET /v1/maps/{name}/events`: what happens to a map, as server-sent events.
//!
//! The first client of a map starts a recorder that keeps the newest events in a bounded ring;
//! every client reads from the ring at its own pace. One that comes back with `Last-Event-ID` goes on
//! behind it; one that was away, or slow, for longer than the ring reaches is told so ("missed").

use super::extract::NamedMap;
use super::map::Status;
use super::view::rows;
use super::{Problem, State};
use crate::pipeline::frame::FrameOutcome;
use crate::pipeline::map::{Map, MapEvent, NumberedEvent};
use axum::http::HeaderMap;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures::Stream;
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};
use std::convert::Infallible;
use std::sync::{Arc, Mutex, Weak};
use tokio::sync::{broadcast, watch};
use tokio_util::sync::CancellationToken;
use utoipa::ToSchema;

/// Event "frame": a frame was handled.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct FrameEvent {
    sequence: u64,
    tracking_state: &'static str,
    /// Row-major 4x4, metres; absent when lost.
    #[serde(skip_serializing_if = "Option::is_none")]
    world_from_camera: Option<[f64; 16]>,
    keyframe: bool,
    revision: u64,
}

/// Event "revision": readers see a newer map.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct RevisionEvent {
    revision: u64,
    gaussians: usize,
    keyframes: usize,
}

/// Event "missed": these events are gone.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct MissedEvent {
    first: u64,
    last: u64,
}

/// A map's newest events.
struct Recorder {
    of: Weak<Map>,
    ring: Mutex<VecDeque<NumberedEvent>>,
    /// The newest event's id; closed when the map is gone.
    newest: watch::Receiver<u64>,
}

/// The recorders of the maps that somebody watches.
pub(super) struct Recorders {
    backlog: usize,
    of_maps: Mutex<BTreeMap<String, Arc<Recorder>>>,
}

impl Recorders {
    pub(super) fn new(backlog: usize) -> Self {
        Self { backlog, of_maps: Mutex::default() }
    }

    /// The map's recorder, started if nobody has watched the map before.
    fn of(&self, map: &Arc<Map>) -> Arc<Recorder> {
        let mut of_maps =
            self.of_maps.lock().expect("no thread panics while it holds the recorders");
        of_maps.retain(|_, recorder| recorder.of.strong_count() > 0);
        let this = Arc::downgrade(map);
        match of_maps.get(map.name()) {
            Some(recorder) if recorder.of.ptr_eq(&this) => recorder.clone(),
            _ => {
                let (newest_in, newest) = watch::channel(0);
                let recorder = Arc::new(Recorder { of: this, ring: Mutex::default(), newest });
                of_maps.insert(map.name().into(), recorder.clone());
                tokio::spawn(record(recorder.clone(), map.subscribe(), newest_in, self.backlog));
                recorder
            }
        }
    }
}

/// Runs until the map is gone.
async fn record(
    recorder: Arc<Recorder>,
    mut events: broadcast::Receiver<NumberedEvent>,
    newest: watch::Sender<u64>,
    backlog: usize,
) {
    loop {
        match events.recv().await {
            Ok(event) => {
                let id = event.id;
                let mut ring = recorder.ring();
                if ring.len() == backlog {
                    ring.pop_front();
                }
                ring.push_back(event);
                drop(ring);
                newest.send_replace(id);
            }
            // The gap in the ids tells the clients.
            Err(broadcast::error::RecvError::Lagged(_)) => {}
            Err(broadcast::error::RecvError::Closed) => return,
        }
    }
}

impl Recorder {
    fn ring(&self) -> std::sync::MutexGuard<'_, VecDeque<NumberedEvent>> {
        self.ring.lock().expect("no thread panics while it holds the events")
    }

    /// The first event behind `seen`.
    fn after(&self, seen: u64) -> Option<NumberedEvent> {
        let ring = self.ring();
        let at = ring.partition_point(|event| event.id <= seen);
        ring.get(at).cloned()
    }
}

/// One client's place in the events.
struct Reader {
    recorder: Arc<Recorder>,
    newest: watch::Receiver<u64>,
    seen: u64,
    stopping: CancellationToken,
    /// Sent before anything else.
    first: Option<Event>,
}

impl Reader {
    async fn next(&mut self) -> Option<Event> {
        if let Some(first) = self.first.take() {
            return Some(first);
        }
        loop {
            self.newest.borrow_and_update();
            if let Some(event) = self.recorder.after(self.seen) {
                return Some(self.advance(event));
            }
            tokio::select! {
                changed = self.newest.changed() => changed.ok()?,
                () = self.stopping.cancelled() => return None,
            }
        }
    }

    /// The event, or first that some before it are gone.
    fn advance(&mut self, event: NumberedEvent) -> Event {
        if event.id > self.seen + 1 {
            let missed = MissedEvent { first: self.seen + 1, last: event.id - 1 };
            self.seen = missed.last;
            return wire("missed", Some(missed.last), &missed);
        }
        self.seen = event.id;
        match &event.event {
            MapEvent::Frame(outcome) => wire("frame", Some(event.id), &frame_event(outcome)),
            MapEvent::Revision { revision, gaussians, keyframes } => {
                let (revision, gaussians, keyframes) = (*revision, *gaussians, *keyframes);
                wire("revision", Some(event.id), &RevisionEvent { revision, gaussians, keyframes })
            }
        }
    }
}

fn frame_event(outcome: &FrameOutcome) -> FrameEvent {
    FrameEvent {
        sequence: outcome.sequence,
        tracking_state: outcome.tracking.as_str(),
        world_from_camera: outcome.world_from_camera.as_ref().map(rows),
        keyframe: outcome.keyframe,
        revision: outcome.revision,
    }
}

fn wire(name: &str, id: Option<u64>, payload: &impl Serialize) -> Event {
    let event = Event::default().event(name);
    let event = id.into_iter().fold(event, |event, id| event.id(id.to_string()));
    event.json_data(payload).expect("numbers and names are JSON")
}

/// What happens to the map: "status" once, then "frame", "revision" and "missed" as they come.
#[utoipa::path(
    get, path = "/v1/maps/{name}/events", tag = "maps",
    params(
        ("name" = String, Path),
        ("Last-Event-ID" = Option<u64>, Header, description = "goes on behind this event"),
    ),
    responses(
        (status = 200, description = "server-sent events", content_type = "text/event-stream"),
        (status = 400, description = "no event's id", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such map", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn stream(
    state: State,
    NamedMap(map): NamedMap,
    headers: HeaderMap,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Problem> {
    let recorder = state.recorders.of(&map);
    let newest = recorder.newest.clone();
    let newest_id = *newest.borrow();
    let seen = match headers.get("last-event-id") {
        None => newest_id,
        Some(value) => {
            let id = value.to_str().ok().and_then(|value| value.trim().parse::<u64>().ok());
            let expected = "Last-Event-ID: expected a number that was an event's id";
            // An id from before a restart may be above all there are.
            id.ok_or_else(|| Problem::bad_request(expected).at("Last-Event-ID"))?.min(newest_id)
        }
    };
    let status = wire("status", None, &Status::from(map.status()));
    let stopping = state.stopping.clone();
    let reader = Reader { recorder, newest, seen, stopping, first: Some(status) };
    let events = futures::stream::unfold(reader, |mut reader| async move {
        reader.next().await.map(|event| (Ok(event), reader))
    });
    Ok(Sse::new(events).keep_alive(KeepAlive::default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(id: u64) -> NumberedEvent {
        let event = MapEvent::Revision { revision: id, gaussians: 0, keyframes: 0 };
        NumberedEvent { id, event }
    }

    fn reader(ids: impl Iterator<Item = u64>, seen: u64) -> (Reader, watch::Sender<u64>) {
        let (newest_in, newest) = watch::channel(0);
        let ring = Mutex::new(ids.map(numbered).collect());
        let recorder = Arc::new(Recorder { of: Weak::new(), ring, newest: newest.clone() });
        let stopping = CancellationToken::new();
        (Reader { recorder, newest, seen, stopping, first: None }, newest_in)
    }

    #[tokio::test]
    async fn a_reader_goes_on_behind_what_it_has_seen_and_hears_of_gaps() {
        let (mut whole, newest) = reader(3..6, 3);
        for id in [4, 5] {
            assert!(whole.next().await.is_some());
            assert_eq!(whole.seen, id);
        }
        let (mut gap, _newest) = reader(8..9, 3);
        assert!(gap.next().await.is_some());
        assert_eq!(gap.seen, 7, "4 to 7 are said to be missed");
        assert!(gap.next().await.is_some());
        assert_eq!(gap.seen, 8);
        drop(newest);
        assert!(whole.next().await.is_none(), "the map is gone");
    }

    #[tokio::test]
    async fn the_recorder_keeps_the_newest() {
        let (events, receiver) = broadcast::channel(16);
        let (newest_in, newest) = watch::channel(0);
        let recorder = Arc::new(Recorder { of: Weak::new(), ring: Mutex::default(), newest });
        let recording = tokio::spawn(record(recorder.clone(), receiver, newest_in, 3));
        for id in 1..=5 {
            events.send(numbered(id)).unwrap();
        }
        drop(events);
        recording.await.unwrap();
        let ids: Vec<u64> = recorder.ring().iter().map(|event| event.id).collect();
        assert_eq!(ids, [3, 4, 5]);
        assert_eq!(*recorder.newest.borrow(), 5);
    }
}
