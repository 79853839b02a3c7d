//! Rebuilding the maps from their logs when the server starts.

use super::log::{Records, cut_torn_tail};
use super::{Store, StoreError, log_path};
use crate::ingest::convert::{self, Limits, Opening};
use crate::pipeline::engine::Engine;
use crate::pipeline::map::SenderGuard;
use lexsplat_proto::v1::{self, frame_message::Message};

/// Sends every map's log through the same checks and the same mapper as when it came; a map that
/// cannot be rebuilt is logged and left out, and its log stays as it is.
///
/// # Errors
/// [`StoreError`] if the data directory cannot be listed.
pub async fn replay(store: &Store, engine: &Engine, limits: &Limits) -> Result<(), StoreError> {
    let Some(root) = &store.root else { return Ok(()) };
    for map in store.maps()? {
        let path = log_path(root, &map);
        let mut replaying = Replaying { engine, limits, sender: None, frames: 0 };
        let replayed = match cut_torn_tail(&path).and_then(|_| Records::open(&path)) {
            Ok(records) => replaying.run(&map, records).await,
            Err(error) => Err(error.to_string()),
        };
        match replayed {
            Ok(()) => tracing::info!(map, frames = replaying.frames, "a map was rebuilt"),
            Err(reason) => tracing::error!(map, reason, "a map was not rebuilt from its log"),
        }
    }
    Ok(())
}

struct Replaying<'a> {
    engine: &'a Engine,
    limits: &'a Limits,
    sender: Option<(SenderGuard, Opening)>,
    frames: u64,
}

impl Replaying<'_> {
    async fn run(&mut self, map: &str, mut records: Records) -> Result<(), String> {
        loop {
            let (message, rest) = tokio::task::spawn_blocking(move || (records.next(), records))
                .await
                .map_err(|_| "reading panicked".to_owned())?;
            records = rest;
            match message.map_err(|error| error.to_string())? {
                None => return Ok(()),
                Some(Message::Open(open)) => self.open(map, &open)?,
                Some(Message::Frame(frame)) => self.frame(frame).await?,
            }
        }
    }

    fn open(&mut self, map: &str, open: &v1::OpenMap) -> Result<(), String> {
        let opening = convert::opening(open, self.limits).map_err(|error| error.to_string())?;
        // The place must be free before it is claimed again.
        self.sender = None;
        let map = self.engine.open(map).map_err(|error| error.to_string())?;
        let guard = map.claim(opening.intrinsics).map_err(|error| error.to_string())?;
        self.sender = Some((guard, opening));
        Ok(())
    }

    async fn frame(&mut self, wire: v1::Frame) -> Result<(), String> {
        let (guard, opening) = self.sender.as_ref().ok_or("its first record opens no map")?;
        let (opening, limits) = (opening.clone(), *self.limits);
        let newest = guard.map().received_through();
        let checked =
            tokio::task::spawn_blocking(move || convert::frame(&wire, &opening, newest, &limits))
                .await
                .map_err(|_| "decoding panicked".to_owned())?;
        let frame = match checked {
            Ok(frame) => frame,
            // It passed once: the limits have become narrower since.
            Err(refusal) => {
                tracing::warn!(map = guard.map().name(), %refusal, "a kept frame was left out");
                return Ok(());
            }
        };
        guard.map().submit(frame).await.map_err(|error| error.to_string())?;
        self.frames += 1;
        Ok(())
    }
}
