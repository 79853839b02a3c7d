//! Rebuilding the maps from their recordings when the server starts.

use super::recorded::RecordedMaps;
use crate::check::{self, Limits, Opening};
use crate::pipeline::engine::Engine;
use crate::pipeline::map::StreamGuard;
use crate::store::{Damage, Entry, Records, StoreError};
use lexsplat_proto::v1::{self, frame_message::Message};

/// Sends the frames of every recording through the same checks and the same mapper as when they arrived.
///
/// A map that cannot be rebuilt is skipped, with an error in the server's log; its recording stays as it is,
/// and the map takes no frames. Damage is reported, and frames behind it are used.
///
/// # Errors
/// [`StoreError`] if the data directory cannot be listed.
pub(crate) async fn replay(maps: &RecordedMaps, limits: &Limits) -> Result<(), StoreError> {
    for map in maps.store().maps()? {
        let map = &*map;
        let mut replay =
            Replay { engine: maps.engine(), limits, sender: None, frames: 0, skipped: 0 };
        let replayed = match maps.store().records(map) {
            Ok(records) => replay.run(map, records).await,
            Err(error) => Err(unreadable(map, &error)),
        };
        let skipped = replay.skipped_words();
        // Frees the map for its next sender.
        drop(replay.sender.take());
        match replayed {
            Ok(()) => {
                tracing::info!(map, frames = replay.frames, "rebuilt a map from its recording");
                let words: Vec<String> = maps.damage(map).into_iter().chain(skipped).collect();
                if let Ok(map) = maps.get(map)
                    && !words.is_empty()
                {
                    map.note_damage(words.join("; "));
                }
            }
            Err(reason) => {
                tracing::error!(map, reason, "cannot rebuild a map from its recording");
                // A part of it may be there. An error means that there is none.
                let _ = maps.engine().delete(map).await;
                maps.note_not_rebuilt(map, reason);
            }
        }
    }
    Ok(())
}

struct Replay<'a> {
    engine: &'a Engine,
    limits: &'a Limits,
    /// Set by the recording's first message.
    sender: Option<(StreamGuard, Opening)>,
    /// Frames sent to the mapper.
    frames: u64,
    /// Frames that did not pass the checks.
    skipped: u64,
}

/// Logs why a recording cannot be read. Returns the reason without a path of the server.
fn unreadable(map: &str, error: &StoreError) -> String {
    tracing::error!(map, %error, "a recording cannot be read");
    error.reason()
}

impl Replay<'_> {
    fn skipped_words(&self) -> Option<String> {
        let skipped = self.skipped;
        (skipped > 0).then(|| {
            format!("{skipped} recorded frame(s) do not pass the checks and are not in the map: see the log")
        })
    }

    async fn run(&mut self, map: &str, mut records: Records) -> Result<(), String> {
        loop {
            let (message, rest) = tokio::task::spawn_blocking(move || (records.next(), records))
                .await
                .map_err(|_| "reading the recording panicked".to_owned())?;
            records = rest;
            match message.map_err(|error| unreadable(map, &error))? {
                None => return Ok(()),
                Some(Entry::Message(Message::Open(open))) => self.open(map, &open)?,
                Some(Entry::Message(Message::Frame(frame))) => self.frame(frame).await?,
                Some(Entry::Damage(Damage { path, from_byte, to_byte })) => {
                    let file = path.display();
                    tracing::error!(map, %file, from_byte, to_byte, "a recording is damaged");
                }
            }
        }
    }

    fn open(&mut self, map: &str, open: &v1::OpenMap) -> Result<(), String> {
        let opening = check::opening(open, self.limits).map_err(|error| error.to_string())?;
        // A map has one sender: drop the last one before the next claims the map.
        self.sender = None;
        let map = self.engine.open(map).map_err(|error| error.to_string())?;
        let guard = map.claim(opening.intrinsics).map_err(|error| error.to_string())?;
        self.sender = Some((guard, opening));
        Ok(())
    }

    async fn frame(&mut self, wire: v1::Frame) -> Result<(), String> {
        let (guard, opening) =
            self.sender.as_ref().ok_or("the first message is not an opening message")?;
        let (opening, limits) = (opening.clone(), *self.limits);
        let newest = guard.map().received_through();
        let checked =
            tokio::task::spawn_blocking(move || check::frame(&wire, &opening, newest, &limits))
                .await
                .map_err(|_| "decoding a frame panicked".to_owned())?;
        let frame = match checked {
            Ok(frame) => frame,
            // The frame passed when it was recorded: the configured limits are narrower now.
            Err(refusal) => {
                tracing::warn!(map = guard.map().name(), %refusal, "skipped a recorded frame");
                self.skipped += 1;
                return Ok(());
            }
        };
        guard.map().submit(frame).await.map_err(|error| error.to_string())?;
        self.frames += 1;
        Ok(())
    }
}
