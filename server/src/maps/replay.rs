//! Mapping the frames of a recording again, all of them or those after a checkpoint.

use super::feed::{Fed, Feed};
use super::places::Load;
use crate::check::Limits;
use crate::pipeline::engine::Engine;
use crate::pipeline::frame::FrameOutcome;
use crate::pipeline::map::Map;
use crate::store::{Damage, Entry, Records, StoreError};
use lexsplat_proto::v1::frame_message::Message;
use std::sync::Arc;
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

/// Sends the frames of a recording into a map.
pub(super) struct Replay<'a> {
    feed: Feed,
    load: &'a Load,
    /// Frames that the map has already.
    had: u64,
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
    /// `restored`: the map as a checkpoint has it, if there is one.
    pub fn new(
        engine: &Arc<Engine>,
        limits: &Limits,
        map: &str,
        load: &'a Load,
        restored: Option<&Map>,
    ) -> Self {
        let feed = Feed::new(engine.clone(), *limits, map.to_owned(), restored);
        let had = restored.map_or(0, |map| map.status().frames_received);
        Self { feed, load, had, frames: 0, newest: None, skipped: 0 }
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
                Some(Entry::Message(Message::Open(open))) => self.feed.open(&open).await?,
                Some(Entry::Message(Message::Frame(frame))) => {
                    let fed = self.feed.frame(frame).await?;
                    self.note(map, fed);
                }
                Some(Entry::Damage(Damage { path, from_byte, to_byte })) => {
                    let file = path.display();
                    tracing::error!(map, %file, from_byte, to_byte, "a recording is damaged");
                }
            }
        }
        if let Some(newest) = self.newest.take() {
            newest.await.map_err(|_| "the map ended before all frames were mapped".to_owned())?;
        }
        self.feed.close();
        let skipped = self.skipped;
        let words = (skipped > 0).then(|| {
            format!("{skipped} recorded frame(s) do not pass the checks and are not in the map: see the log")
        });
        let words = words.into_iter().collect();
        Ok(Replayed { frames: self.frames, is_saved: false, words })
    }

    fn note(&mut self, map: &str, fed: Fed) {
        match fed {
            Fed::Had => {}
            Fed::Submitted(outcome) => {
                self.newest = Some(outcome);
                self.frames += 1;
                self.load.set_done(self.had + self.frames);
            }
            Fed::Refused(refusal) => {
                tracing::warn!(map, %refusal, "skipped a recorded frame");
                self.skipped += 1;
            }
        }
    }
}
