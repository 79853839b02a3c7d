//! A map that this worker has: its newest checkpoint, then the log; acknowledgements and new checkpoints out.

use super::acks::AckLog;
use super::bus::Failed;
use super::checkpoints;
use super::log::{Entry, ReadError, Reader, Record};
use super::registry::{self, ChangeError, MapEntry};
use super::saver::{Position, Positions, Saver, Terms};
use crate::ingest::{outcome_ack, refused_ack};
use crate::maps::{Fed, Feed};
use crate::pipeline::frame::FrameOutcome;
use crate::pipeline::map::Map;
use crate::telemetry::FLEET_LOG_LAG;
use lexsplat_proto::v1::{self, FrameAck};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;
use tokio_util::task::AbortOnDropHandle;

/// Between two looks whether a checkpoint is due.
const LOOK: Duration = Duration::from_millis(500);
/// Frames whose acknowledgements wait.
const BACKLOG: usize = 64;

/// How a map is doing, for the worker.
#[derive(Default)]
pub(super) struct Progress {
    /// Whether the map has all that the log had when it was taken.
    pub is_ready: AtomicBool,
    /// Unique name of the map, once it is known.
    pub id: OnceLock<String>,
    /// Ends the pump after a last checkpoint.
    pub stop: CancellationToken,
    /// Ends the pump at once: another worker has the map.
    pub lost: CancellationToken,
}

/// Why a map is given up.
#[derive(Debug, thiserror::Error)]
pub(super) enum PumpError {
    #[error(transparent)]
    Change(#[from] ChangeError),
    #[error(transparent)]
    Failed(#[from] Failed),
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error("{0}")]
    Map(String),
}

impl PumpError {
    /// Whether the next try may succeed: NATS did not answer, or the log is that of another map of this name.
    pub(super) fn is_passing(&self) -> bool {
        matches!(self, Self::Failed(_) | Self::Change(_) | Self::Read(ReadError::Gap { .. }))
    }
}

/// A frame whose acknowledgement is due.
enum Due {
    Mapped(oneshot::Receiver<FrameOutcome>),
    Refused(Box<FrameAck>),
}

/// A map with its log.
struct Pump {
    terms: Terms,
    map: String,
    id: String,
    token: u64,
    feed: Feed,
    reader: Reader,
    acks: Arc<AckLog>,
    due: mpsc::Sender<Due>,
    open: Option<Arc<v1::OpenMap>>,
    positions: Positions,
    saved_at: Instant,
    saving: Option<JoinHandle<Result<(), ChangeError>>>,
}

/// Has a map until it is given up. Then it is not in memory any more.
pub(super) async fn run(
    terms: Terms,
    map: String,
    token: u64,
    progress: Arc<Progress>,
) -> Result<(), PumpError> {
    // Loading a copy takes time, which the worker's other maps have to be spared.
    terms.copies.make_room(&map).await;
    // A part of it may be there from before. An error means that there is none.
    let _ = terms.engine.delete(&map).await;
    let ended = serve(&terms, &map, token, &progress).await;
    metrics::gauge!(FLEET_LOG_LAG, "map" => map.clone()).set(0.0);
    let _ = terms.engine.delete(&map).await;
    terms.copies.release(&map);
    ended
}

async fn serve(terms: &Terms, map: &str, token: u64, progress: &Progress) -> Result<(), PumpError> {
    let (entry, revision) = registry::claim(&terms.bus, map, token).await?;
    tracing::info!(map, token, revision, "took a map");
    // Nobody else sets it.
    let _ = progress.id.set(entry.id.clone());
    let (due, waiting) = mpsc::channel(BACKLOG);
    // To its end: what is made on a blocking thread must be known to be there.
    let mut pump = Pump::load(terms, map, token, entry, due).await?;
    let of_engine = terms.engine.map(map).map_err(|error| PumpError::Map(error.to_string()))?;
    let acks = pump.acks.clone();
    let acknowledging = acknowledge(waiting, acks.clone(), of_engine.clone());
    let _tasks =
        [tokio::spawn(acknowledging), tokio::spawn(answer(acks))].map(AbortOnDropHandle::new);
    tokio::select! {
        ended = pump.follow(&of_engine, progress) => ended,
        () = progress.lost.cancelled() => Ok(()),
    }
}

impl Pump {
    async fn load(
        terms: &Terms,
        map: &str,
        token: u64,
        entry: MapEntry,
        due: mpsc::Sender<Due>,
    ) -> Result<Self, PumpError> {
        let (bus, engine) = (&terms.bus, &terms.engine);
        let restored = match &entry.checkpoint {
            Some(saved) => checkpoints::read(bus, saved, engine.fingerprint()).await?,
            None => None,
        };
        let mut before = Vec::new();
        let (mut open, mut after, mut has) = (None, 0, None);
        if let (Some((beginning, state)), Some(saved)) = (restored, &entry.checkpoint) {
            let (frames, of_map) = (state.frames(), map.to_owned());
            let engine = engine.clone();
            has = Some(in_thread(move || engine.restore(&of_map, state)).await?);
            tracing::info!(map, frames, through = saved.through, "a map goes on from a checkpoint");
            (open, before, after) = (beginning.open, beginning.acks, saved.position);
        } else {
            let (engine, of_map) = (engine.clone(), map.to_owned());
            in_thread(move || engine.open(&of_map)).await?;
        }
        let mut feed = Feed::new(engine.clone(), terms.limits, map.to_owned(), has.as_deref());
        if let Some(open) = &open {
            feed.resume(open).map_err(PumpError::Map)?;
        }
        Ok(Self {
            terms: terms.clone(),
            map: map.to_owned(),
            id: entry.id,
            token,
            feed,
            reader: Reader::new(bus, map, after),
            acks: AckLog::new(bus, map, token, before),
            due,
            open: open.map(Arc::new),
            positions: Positions::default(),
            saved_at: Instant::now(),
            saving: None,
        })
    }

    /// Follows the log until the map is given up.
    async fn follow(&mut self, map: &Arc<Map>, progress: &Progress) -> Result<(), PumpError> {
        let goal = self.terms.bus.newest_position(&self.map).await?;
        progress.is_ready.store(self.reader.position() >= goal, Ordering::Relaxed);
        let mut look = tokio::time::interval(LOOK);
        look.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                () = progress.stop.cancelled() => break,
                _ = look.tick() => {
                    self.look_after(map).await?;
                    // The last message may be a part without the rest.
                    if self.reader.position() >= goal {
                        progress.is_ready.store(true, Ordering::Relaxed);
                    }
                }
                entry = self.reader.next() => {
                    let entry = entry?;
                    // To its end: the acknowledgement of a frame that the map has must not be lost.
                    self.take(entry).await?;
                }
            }
        }
        if let Some(saving) = self.saving.take() {
            // One that failed was told; the last one is tried in any case.
            let _ = saving.await;
        }
        self.saver().save(map).await?;
        Ok(())
    }

    async fn take(&mut self, entry: Entry) -> Result<(), PumpError> {
        metrics::gauge!(FLEET_LOG_LAG, "map" => self.map.clone()).set(self.reader.pending() as f64);
        let Entry { record, first, last } = entry;
        match record {
            Record::Open(open) => {
                self.feed.open(&open).await.map_err(PumpError::Map)?;
                self.open = Some(Arc::new(open));
            }
            Record::Close => self.feed.close(),
            Record::Frame(frame) => {
                let sequence = frame.sequence;
                if let Some(open) = self.open.clone() {
                    let position = Position { sequence, first, last, open };
                    self.positions
                        .lock()
                        .unwrap_or_else(PoisonError::into_inner)
                        .push_back(position);
                }
                let due = match self.feed.frame(frame).await.map_err(PumpError::Map)? {
                    Fed::Had => return Ok(()),
                    Fed::Submitted(outcome) => Due::Mapped(outcome),
                    Fed::Refused(refusal) => Due::Refused(refused_ack(sequence, refusal).into()),
                };
                self.due.send(due).await.map_err(|_| PumpError::Map("the map has ended".into()))?;
            }
        }
        Ok(())
    }

    /// Begins a checkpoint if one is due.
    async fn look_after(&mut self, map: &Arc<Map>) -> Result<(), PumpError> {
        if let Some(reason) = map.failure() {
            return Err(PumpError::Map(reason));
        }
        if let Some(saving) = self.saving.take_if(|saving| saving.is_finished()) {
            match saving.await {
                Ok(Err(error @ (ChangeError::Fenced | ChangeError::Deleted))) => {
                    return Err(error.into());
                }
                Ok(Ok(())) => {}
                // It was told, and is tried again.
                Ok(Err(ChangeError::Failed(_))) | Err(_) => {}
            }
        }
        let every = self.terms.checkpoint_every;
        let is_due = !every.is_zero() && self.saved_at.elapsed() > every;
        if is_due && self.saving.is_none() {
            let (saver, map) = (self.saver(), map.clone());
            self.saved_at = Instant::now();
            self.saving = Some(tokio::spawn(async move { saver.save(&map).await }));
        }
        Ok(())
    }

    fn saver(&self) -> Saver {
        Saver {
            terms: self.terms.clone(),
            map: self.map.clone(),
            id: self.id.clone(),
            token: self.token,
            acks: self.acks.clone(),
            positions: self.positions.clone(),
        }
    }
}

/// Acknowledges frames in their order.
async fn acknowledge(mut waiting: mpsc::Receiver<Due>, acks: Arc<AckLog>, map: Arc<Map>) {
    while let Some(due) = waiting.recv().await {
        let mut ack = match due {
            Due::Refused(ack) => *ack,
            Due::Mapped(outcome) => match outcome.await {
                Ok(outcome) => outcome_ack(outcome),
                // The map has ended.
                Err(_) => return,
            },
        };
        let (depth, capacity) = map.queue();
        ack.queue_depth = u32::try_from(depth).unwrap_or(u32::MAX);
        ack.queue_capacity = u32::try_from(capacity).unwrap_or(u32::MAX);
        acks.publish(ack).await;
    }
}

/// Answers gateways that missed acknowledgements.
async fn answer(acks: Arc<AckLog>) {
    while let Err(error) = acks.clone().answer().await {
        tracing::warn!(%error, "cannot answer gateways: trying again");
        tokio::time::sleep(Duration::from_secs(1)).await;
    }
}

/// Makes a map on a blocking thread: it allocates memory of the device.
async fn in_thread<T: Send + 'static>(
    make: impl FnOnce() -> Result<T, crate::pipeline::map::MapError> + Send + 'static,
) -> Result<T, PumpError> {
    let made = tokio::task::spawn_blocking(make).await;
    let made = made.map_err(|_| PumpError::Map("making the map panicked".into()))?;
    made.map_err(|error| PumpError::Map(error.to_string()))
}
