//! Frames that were kept, on their way into a map again: from a recording, or from the log of a fleet.

use crate::check::{self, Limits, Opening, Refusal};
use crate::pipeline::engine::Engine;
use crate::pipeline::frame::FrameOutcome;
use crate::pipeline::map::{Map, StreamGuard};
use lexsplat_proto::v1;
use std::sync::Arc;
use tokio::sync::oneshot;

/// Sends kept frames through the same checks and the same mapper as when they arrived.
pub(crate) struct Feed {
    engine: Arc<Engine>,
    limits: Limits,
    map: String,
    /// The newest frame that the map had already.
    after: Option<u64>,
    /// The opening message of the current stream, and whether the map has frames of it.
    opened: Option<(Opening, bool)>,
    /// The right to send frames, once there is one to send.
    sender: Option<StreamGuard>,
}

/// What became of a frame.
pub(crate) enum Fed {
    /// The map had it already.
    Had,
    /// The mapper has it.
    Submitted(oneshot::Receiver<FrameOutcome>),
    /// It passed the checks when it was kept: the limits are narrower now.
    Refused(Refusal),
}

impl Feed {
    /// `restored`: the map as a checkpoint has it, if there is one.
    pub(crate) fn new(
        engine: Arc<Engine>,
        limits: Limits,
        map: String,
        restored: Option<&Map>,
    ) -> Self {
        let after = restored.and_then(Map::received_through);
        Self { engine, limits, map, after, opened: None, sender: None }
    }

    /// A stream begins.
    ///
    /// # Errors
    /// The reason why the map cannot be rebuilt.
    pub(crate) async fn open(&mut self, open: &v1::OpenMap) -> Result<(), String> {
        let opening = check::opening(open, &self.limits).map_err(|error| error.to_string())?;
        (self.opened, self.sender) = (Some((opening, false)), None);
        if self.after.is_none() {
            // There may be a stream without a frame that can be mapped.
            let (engine, map) = (self.engine.clone(), self.map.clone());
            let opened = tokio::task::spawn_blocking(move || engine.open(&map).map(drop)).await;
            let opened = opened.map_err(|_| "making the map panicked".to_owned())?;
            opened.map_err(|error| error.to_string())?;
        }
        Ok(())
    }

    /// A stream that the map has frames of goes on.
    ///
    /// # Errors
    /// The reason why the map cannot be rebuilt.
    pub(crate) fn resume(&mut self, open: &v1::OpenMap) -> Result<(), String> {
        let opening = check::opening(open, &self.limits).map_err(|error| error.to_string())?;
        self.opened = Some((opening, true));
        Ok(())
    }

    /// The stream has ended: the map is free for the next one.
    pub(crate) fn close(&mut self) {
        self.sender = None;
    }

    /// A frame of the current stream.
    ///
    /// # Errors
    /// The reason why the map cannot be rebuilt.
    pub(crate) async fn frame(&mut self, wire: v1::Frame) -> Result<Fed, String> {
        let Some((opening, has_frames)) = &mut self.opened else {
            return Err("the first message is not an opening message".into());
        };
        if self.after.is_some_and(|after| wire.sequence <= after) {
            *has_frames = true;
            return Ok(Fed::Had);
        }
        if self.sender.is_none() {
            let map = self.engine.map(&self.map).map_err(|error| error.to_string())?;
            // A stream that the map has frames of goes on.
            let claimed = match has_frames {
                true => map.reclaim(),
                false => map.claim(),
            };
            self.sender = Some(claimed.map_err(|error| error.to_string())?);
        }
        let sender = self.sender.as_ref().expect("claimed above");
        let (opening, limits) = (opening.clone(), self.limits);
        let newest = sender.map().received_through();
        let checked = tokio::task::spawn_blocking(move || {
            let raw = check::frame(&wire, &opening, newest, &limits)?;
            check::registered(raw, &opening)
        });
        let checked = checked.await.map_err(|_| "decoding a frame panicked".to_owned())?;
        match checked {
            Ok(frame) => {
                let submitted = sender.map().submit(frame).await;
                submitted.map(Fed::Submitted).map_err(|error| error.to_string())
            }
            Err(refusal) => Ok(Fed::Refused(refusal)),
        }
    }
}
