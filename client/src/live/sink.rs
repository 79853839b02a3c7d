//! The side of the server: numbers frames, sends them, and sends those again that were not acknowledged.

use super::board::Board;
use super::options::{BridgeError, BridgeOptions, Waits};
use super::robot::Passed;
use crate::dataset::RgbdFrame;
use crate::stream::{ClientError, FrameAck, FrameStatus, FrameStream, MapSpec, find};
use std::collections::VecDeque;
use tokio::sync::mpsc;
use tonic::Code;

/// Frames that may be on their way, without an acknowledgement.
const MOST_PENDING: usize = 16;
/// Refusals that are told one by one.
const MOST_TOLD: u64 = 5;
/// Frames between this side and the wire.
const READ_AHEAD: usize = 2;

/// Frames that are not acknowledged yet, and the number of the next one.
#[derive(Default)]
struct Pending {
    frames: VecDeque<RgbdFrame>,
    /// Of these, the first ones were sent through the open stream.
    sent: usize,
    next: u64,
}

impl Pending {
    fn push(&mut self, frame: RgbdFrame) {
        self.frames.push_back(RgbdFrame { sequence: self.next, ..frame });
        self.next += 1;
    }

    /// What the map has through a number need not be sent.
    fn acknowledged_through(&mut self, sequence: u64) {
        while self.frames.front().is_some_and(|frame| frame.sequence <= sequence) {
            self.frames.pop_front();
            self.sent = self.sent.saturating_sub(1);
        }
    }

    /// A stream was opened to a map that has frames through a number. Returns how many of these are ours.
    fn opened(&mut self, seen: Option<u64>) -> u64 {
        self.sent = 0;
        let before = self.frames.len();
        if let Some(seen) = seen {
            self.acknowledged_through(seen);
            if self.next <= seen {
                self.next = seen + 1;
            }
        }
        (before - self.frames.len()) as u64
    }
}

/// Sends frames until nobody passes any more, or enough are acknowledged.
pub(super) async fn send(
    options: &BridgeOptions,
    mut passed: mpsc::Receiver<Passed>,
    board: &Board<'_>,
) -> Result<(), BridgeError> {
    // What is wrong with the server is told before the robot sends anything.
    match find(&options.grpc, &options.access, &options.map).await {
        Err(error) if is_passing(&error) => board.tell(format!("{error}; frames will wait for it")),
        found => found?,
    }
    let Some(Passed::Map(spec)) = passed.recv().await else { return Ok(()) };
    let mut pending = Pending::default();
    let mut waits = Waits::new();
    loop {
        let error = match open(options, &spec, &mut pending, board).await {
            Ok(stream) => match converse(stream, &mut passed, &mut pending, options, board).await {
                Ok(()) => return Ok(()),
                Err((error, has_acks)) => {
                    if has_acks {
                        waits = Waits::new();
                    }
                    error
                }
            },
            Err(error) => error,
        };
        if !is_passing(&error) {
            return Err(error.into());
        }
        let wait = waits.next();
        board.tell(format!("{error}; trying again in {:.1} s", wait.as_secs_f64()));
        tokio::time::sleep(wait).await;
        if passed.is_closed() && passed.is_empty() && pending.frames.is_empty() {
            return Ok(());
        }
    }
}

async fn open(
    options: &BridgeOptions,
    spec: &MapSpec,
    pending: &mut Pending,
    board: &Board<'_>,
) -> Result<FrameStream, ClientError> {
    let stream =
        FrameStream::open(&options.grpc, &options.access, spec.clone(), READ_AHEAD).await?;
    let seen = stream.opened.received_through.max(stream.opened.durable_through);
    let there = pending.opened(seen);
    board.count(|counts| {
        counts.server_connections += 1;
        counts.acknowledged += there;
    });
    board.tell(match seen {
        Some(seen) => format!("map {} goes on after frame {seen}", options.map),
        None => format!("map {} begins", options.map),
    });
    Ok(stream)
}

/// Whether the same call may succeed later.
fn is_passing(error: &ClientError) -> bool {
    match error {
        ClientError::NoServer { .. } | ClientError::Broken { .. } => true,
        ClientError::Refused { code, .. } => {
            matches!(code, Code::Unavailable | Code::Cancelled | Code::Unknown)
        }
        _ => false,
    }
}

/// Sends and counts until the stream ends. An error comes with whether anything was acknowledged.
async fn converse(
    stream: FrameStream,
    passed: &mut mpsc::Receiver<Passed>,
    pending: &mut Pending,
    options: &BridgeOptions,
    board: &Board<'_>,
) -> Result<(), (ClientError, bool)> {
    let FrameStream { frames, mut acks, .. } = stream;
    let mut frames = Some(frames);
    let (mut has_acks, mut has_more) = (false, true);
    loop {
        if !has_more && pending.frames.is_empty() {
            // The stream ends when its sender is gone.
            frames = None;
        }
        let unsent = pending.frames.get(pending.sent).filter(|_| frames.is_some()).cloned();
        let may_send = unsent.is_some();
        let sending = async {
            match (&frames, unsent) {
                (Some(frames), Some(frame)) => frames.send(frame).await,
                _ => false,
            }
        };
        tokio::select! {
            was_sent = sending, if may_send => match was_sent {
                true => pending.sent += 1,
                // The reason comes with the acknowledgements.
                false => frames = None,
            },
            next = passed.recv(), if has_more && pending.frames.len() < MOST_PENDING => match next {
                Some(Passed::Frame(frame)) => pending.push(*frame),
                Some(Passed::Map(_)) => {}
                None => has_more = false,
            },
            ack = acks.next() => match ack {
                Ok(Some(ack)) => {
                    has_acks = true;
                    pending.acknowledged_through(ack.sequence);
                    count(&ack, board);
                    if options.frames.is_some_and(|most| board.progress().acknowledged >= most) {
                        return Ok(());
                    }
                }
                Ok(None) if !has_more && pending.frames.is_empty() => return Ok(()),
                Ok(None) => return Err((ClientError::unanswered(&options.grpc), has_acks)),
                Err(error) => return Err((error, has_acks)),
            },
        }
    }
}

fn count(ack: &FrameAck, board: &Board<'_>) {
    for warning in &ack.input_warnings {
        board.tell(format!("warning: {}", warning.message));
    }
    if ack.status() == FrameStatus::Refused && board.progress().refused < MOST_TOLD {
        let (field, reason) = (&ack.refused_field, &ack.refused_reason);
        board.tell(format!("frame {} is refused: {field}: {reason}", ack.sequence));
    }
    board.count(|counts| {
        counts.acknowledged += 1;
        counts.durable_through = ack.durable_through.or(counts.durable_through);
        match ack.status() {
            FrameStatus::Lost => counts.lost += 1,
            FrameStatus::Refused => counts.refused += 1,
            _ => counts.tracked += 1,
        }
    });
}
