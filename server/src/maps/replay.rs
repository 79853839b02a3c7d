//! Mapping the frames of a recording again, all of them or those after a checkpoint.

use super::places::Load;
use crate::check::{self, Limits, Opening};
use crate::pipeline::engine::Engine;
use crate::pipeline::frame::FrameOutcome;
use crate::pipeline::map::{Map, StreamGuard};
use crate::store::{Damage, Entry, Records, StoreError};
use lexsplat_proto::v1::{self, frame_message::Message};
use tokio::sync::oneshot;

/// What became of a recording.
pub(super) struct Replayed {
    /// Frames sent to the mapper.
    pub frames: u64,
    /// Whether a checkpoint has all of them.
    pub is_saved: bool,
    /// What is wrong with it, beside damage that was set aside.
    pub words: Vec<String>,
}

/// Sends frames of a recording through the same checks and the same mapper as when they arrived.
pub(super) struct Replay<'a> {
    engine: &'a Engine,
    limits: &'a Limits,
    load: &'a Load,
    /// The newest frame that the map has already.
    after: Option<u64>,
    /// Frames that the map has already.
    had: u64,
    /// The opening message of the current stream, and whether the map has frames of it.
    opened: Option<(Opening, bool)>,
    /// The right to send frames, once there is one to send.
    sender: Option<StreamGuard>,
    frames: u64,
    /// Resolves when the newest frame is mapped.
    newest: Option<oneshot::Receiver<FrameOutcome>>,
    /// Frames that did not pass the checks.
    skipped: u64,
}

/// Logs why a recording cannot be read. Returns the reason without a path of the server.
fn unreadable(map: &str, error: &StoreError) -> String {
    tracing::error!(map, %error, "a recording cannot be read");
    error.reason()
}

impl<'a> Replay<'a> {
    /// `map`: the map as a checkpoint has it, if there is one.
    pub fn new(engine: &'a Engine, limits: &'a Limits, load: &'a Load, map: Option<&Map>) -> Self {
        Self {
            engine,
            limits,
            load,
            after: map.and_then(Map::received_through),
            had: map.map_or(0, |map| map.status().frames_received),
            opened: None,
            sender: None,
            frames: 0,
            newest: None,
            skipped: 0,
        }
    }

    /// Ends when all frames are mapped; the optimiser may still have steps to take. Damage is reported, and
    /// frames behind it are used.
    ///
    /// # Errors
    /// The reason why the map cannot be rebuilt.
    pub async fn run(&mut self, map: &str, mut records: Records) -> Result<Replayed, String> {
        loop {
            let (message, rest) = tokio::task::spawn_blocking(move || (records.next(), records))
                .await
                .map_err(|_| "reading the recording panicked".to_owned())?;
            records = rest;
            match message.map_err(|error| unreadable(map, &error))? {
                None => break,
                Some(Entry::Message(Message::Open(open))) => {
                    let opening =
                        check::opening(&open, self.limits).map_err(|error| error.to_string())?;
                    (self.opened, self.sender) = (Some((opening, false)), None);
                    if self.after.is_none() {
                        // A recording may have a stream without a frame that can be mapped.
                        self.engine.open(map).map_err(|error| error.to_string())?;
                    }
                }
                Some(Entry::Message(Message::Frame(frame))) => self.frame(map, frame).await?,
                Some(Entry::Damage(Damage { path, from_byte, to_byte })) => {
                    let file = path.display();
                    tracing::error!(map, %file, from_byte, to_byte, "a recording is damaged");
                }
            }
        }
        if let Some(newest) = self.newest.take() {
            newest.await.map_err(|_| "the map ended before all frames were mapped".to_owned())?;
        }
        // Frees the map for its next sender.
        self.sender = None;
        let skipped = self.skipped;
        let words = (skipped > 0).then(|| {
            format!("{skipped} recorded frame(s) do not pass the checks and are not in the map: see the log")
        });
        let words = words.into_iter().collect();
        Ok(Replayed { frames: self.frames, is_saved: false, words })
    }

    async fn frame(&mut self, map: &str, wire: v1::Frame) -> Result<(), String> {
        let Some((opening, has_frames)) = &mut self.opened else {
            return Err("the first message is not an opening message".into());
        };
        if self.after.is_some_and(|after| wire.sequence <= after) {
            *has_frames = true;
            return Ok(());
        }
        if self.sender.is_none() {
            let map = self.engine.map(map).map_err(|error| error.to_string())?;
            // A stream that the map has frames of goes on.
            let claimed = match has_frames {
                true => map.reclaim(),
                false => map.claim(),
            };
            self.sender = Some(claimed.map_err(|error| error.to_string())?);
        }
        let sender = self.sender.as_ref().expect("claimed above");
        let (opening, limits) = (opening.clone(), *self.limits);
        let newest = sender.map().received_through();
        let checked = tokio::task::spawn_blocking(move || {
            let raw = check::frame(&wire, &opening, newest, &limits)?;
            check::registered(raw, &opening)
        })
        .await
        .map_err(|_| "decoding a frame panicked".to_owned())?;
        let frame = match checked {
            Ok(frame) => frame,
            // The frame passed when it was recorded: the configured limits are narrower now.
            Err(refusal) => {
                tracing::warn!(map, %refusal, "skipped a recorded frame");
                self.skipped += 1;
                return Ok(());
            }
        };
        let outcome = sender.map().submit(frame).await.map_err(|error| error.to_string())?;
        self.newest = Some(outcome);
        self.frames += 1;
        self.load.set_done(self.had + self.frames);
        Ok(())
    }
}
