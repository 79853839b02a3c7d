//! `GET /v1/maps/{name}/events`: the events of a map, as server-sent events.
//!
//! A client that reconnects with `Last-Event-ID` continues after that event. If it was away, or
//! slow, for so long that events were dropped, it gets the event "missed".

use super::error::Problem;
use super::event_log::EventLog;
use super::extract::NamedMap;
use super::state::State;
use super::to_json::{rows, status};
use crate::access::Caller;
use crate::pipeline::frame::FrameOutcome;
use crate::pipeline::map::{MapEvent, NumberedEvent};
use axum::Extension;
use axum::http::HeaderMap;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures::Stream;
use lexsplat_proto::json::{
    self, FrameEvent, InputWarningEvent, MissedEvent, RefinementEvent, RevisionEvent,
};
use serde::Serialize;
use std::convert::Infallible;
use std::sync::Arc;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

/// The position of one client in the event log.
struct Reader {
    log: Arc<EventLog>,
    newest: watch::Receiver<u64>,
    /// Id of the last event that was sent.
    seen: u64,
    stopping: CancellationToken,
    caller: Caller,
    /// Sent before all other events.
    first: Option<Event>,
}

impl Reader {
    async fn next(&mut self) -> Option<Event> {
        if let Some(first) = self.first.take() {
            return Some(first);
        }
        loop {
            self.newest.borrow_and_update();
            if let Some(event) = self.log.after(self.seen) {
                return Some(self.advance(event));
            }
            tokio::select! {
                changed = self.newest.changed() => changed.ok()?,
                () = self.stopping.cancelled() => return None,
                () = self.caller.withdrawn() => return None,
            }
        }
    }

    /// The event; or, if events before it are no longer kept, first the event "missed".
    fn advance(&mut self, event: NumberedEvent) -> Event {
        if event.id > self.seen + 1 {
            let missed = MissedEvent { first: self.seen + 1, last: event.id - 1 };
            self.seen = missed.last;
            return server_sent("missed", Some(missed.last), &missed);
        }
        self.seen = event.id;
        match &event.event {
            MapEvent::Frame(outcome) => server_sent("frame", Some(event.id), &frame_event(outcome)),
            MapEvent::InputWarning { sequence, warning } => {
                let sequence = *sequence;
                let (problem, message) = (warning.problem.as_str().into(), warning.message.clone());
                let warning = InputWarningEvent { sequence, problem, message };
                server_sent("input_warning", Some(event.id), &warning)
            }
            MapEvent::Refinement(refinement) => {
                let refinement = refinement.as_str().into();
                server_sent("refinement", Some(event.id), &RefinementEvent { refinement })
            }
            MapEvent::Revision { revision, gaussians, keyframes } => {
                let (revision, gaussians, keyframes) = (*revision, *gaussians, *keyframes);
                server_sent(
                    "revision",
                    Some(event.id),
                    &RevisionEvent { revision, gaussians, keyframes },
                )
            }
        }
    }
}

fn frame_event(outcome: &FrameOutcome) -> FrameEvent {
    FrameEvent {
        sequence: outcome.sequence,
        tracking_state: outcome.tracking.as_str().into(),
        world_from_camera: outcome.world_from_camera.as_ref().map(rows),
        keyframe: outcome.keyframe,
        revision: outcome.revision,
    }
}

fn server_sent(name: &str, id: Option<u64>, payload: &impl Serialize) -> Event {
    let event = Event::default().event(name);
    let event = id.into_iter().fold(event, |event, id| event.id(id.to_string()));
    event.json_data(payload).expect("numbers and names are JSON")
}

/// Events of the map: "status" first, then "frame", "input_warning", "revision" and "missed" as they
/// happen.
#[utoipa::path(
    get, path = "/v1/maps/{name}/events", operation_id = "stream_events", tag = "maps",
    params(
        ("name" = String, Path),
        ("Last-Event-ID" = Option<u64>, Header, description = "continue after the event with this id"),
    ),
    responses(
        (status = 200, description = "server-sent events", content_type = "text/event-stream"),
        (status = 400, description = "Last-Event-ID is not a number", body = json::Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such map", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn stream(
    state: State,
    NamedMap(map): NamedMap,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Problem> {
    let log = state.event_logs.of(&map);
    let newest = log.newest();
    let newest_id = *newest.borrow();
    let seen = match headers.get("last-event-id") {
        None => newest_id,
        Some(value) => {
            let id = value.to_str().ok().and_then(|value| value.trim().parse::<u64>().ok());
            let expected = "Last-Event-ID: expected a number, the id of an event";
            // Ids start again when the server restarts: an older id may be larger than all new
            // ones.
            id.ok_or_else(|| Problem::bad_request(expected).at("Last-Event-ID"))?.min(newest_id)
        }
    };
    let status = server_sent("status", None, &status(map.status()));
    let stopping = state.stopping.clone();
    let reader = Reader { log, newest, seen, stopping, caller, first: Some(status) };
    let events = futures::stream::unfold(reader, |mut reader| async move {
        reader.next().await.map(|event| (Ok(event), reader))
    });
    Ok(Sse::new(events).keep_alive(KeepAlive::default()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::{AccessConfig, Credentials, Gate};
    use crate::http::event_log::samples::log;

    fn reader(ids: impl Iterator<Item = u64>, seen: u64) -> (Reader, watch::Sender<u64>) {
        let (newest_in, newest) = watch::channel(0);
        let log = log(ids, newest.clone());
        let stopping = CancellationToken::new();
        let gate = Gate::new(AccessConfig::default()).unwrap();
        let caller = gate.identify(Credentials::default()).unwrap();
        (Reader { log, newest, seen, stopping, caller, first: None }, newest_in)
    }

    #[tokio::test]
    async fn a_reader_continues_after_the_last_event_it_saw_and_is_told_of_gaps() {
        let (mut whole, newest) = reader(3..6, 3);
        for id in [4, 5] {
            assert!(whole.next().await.is_some());
            assert_eq!(whole.seen, id);
        }
        let (mut gap, _newest) = reader(8..9, 3);
        assert!(gap.next().await.is_some());
        assert_eq!(gap.seen, 7, "4 to 7 were missed");
        assert!(gap.next().await.is_some());
        assert_eq!(gap.seen, 8);
        drop(newest);
        assert!(whole.next().await.is_none(), "the map was deleted");
    }
}
