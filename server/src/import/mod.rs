//! Uploaded recordings: received, opened by the readers of the client library, and streamed into a map as a
//! robot streams frames, through the same checks.
//!
//! A recording is on disk only while it is received and mapped. If the server stops meanwhile, the frames so
//! far are in the map, and the same recording, sent again, goes on behind them.

mod config;
mod error;
mod progress;
mod room;
mod run;
mod spool;
mod unpack;

#[cfg(test)]
mod tests;

pub use config::ImportsConfig;
pub(crate) use error::ImportError;

use crate::access::Caller;
use crate::ingest::MappingService;
use crate::maps::{MapsError, RecordedMaps};
use crate::pipeline::engine::check_name;
use lexsplat_proto::json::{self, ImportPoses};
use progress::Import;
use run::Run;
use spool::Spool;
use std::collections::BTreeMap;
use std::io::Read;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Semaphore, oneshot};

/// How an uploaded recording is to be mapped.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Wish {
    /// Where poses come from. `None`: they are given if most frames have one.
    pub(crate) poses: Option<ImportPoses>,
    /// Whether the frames may go on behind those that the map has.
    pub(crate) resume: bool,
}

/// Imports that have ended and are remembered.
const REMEMBERED: usize = 64;

/// The recordings that are received and mapped. Cheap to clone.
#[derive(Clone)]
pub(crate) struct Imports {
    maps: RecordedMaps,
    service: MappingService,
    limits: ImportsConfig,
    /// Bytes that must stay free on the disk.
    kept_free: u64,
    places: Arc<Semaphore>,
    of_maps: Arc<Mutex<BTreeMap<String, Arc<Import>>>>,
}

impl Imports {
    /// Imports through `service`. Temporary files are put beside the recordings of `maps`.
    pub(crate) fn new(
        maps: RecordedMaps,
        service: MappingService,
        limits: &ImportsConfig,
        kept_free: u64,
    ) -> Self {
        let (places, of_maps) = (Arc::new(Semaphore::new(limits.at_once)), Arc::default());
        Self { maps, service, limits: limits.clone(), kept_free, places, of_maps }
    }

    /// Receives a recording and begins to map it, in the name of a caller who may write to the map. A map
    /// that has frames takes more only if these go on where it is.
    ///
    /// # Errors
    /// [`ImportError`], until the map is open for the frames. What comes after is told by [`Self::of`].
    pub(crate) async fn begin(
        &self,
        map: &str,
        caller: &Caller,
        wish: Wish,
        recording: impl Read + Send + 'static,
    ) -> Result<json::Import, ImportError> {
        check_name(map).map_err(MapsError::from)?;
        let (import, before) = self.take_place(map)?;
        let begun = self.begin_as(&import, map, caller, wish, recording).await;
        if begun.is_err() {
            // The answer tells why.
            let mut of_maps = self.of_maps();
            // Somebody may have deleted the map meanwhile.
            if of_maps.get(map).is_some_and(|other| Arc::ptr_eq(other, &import)) {
                of_maps.remove(map);
                of_maps.extend(before.map(|before| (map.to_owned(), before)));
            }
        }
        begun.map(|()| import.told().clone())
    }

    async fn begin_as(
        &self,
        import: &Arc<Import>,
        map: &str,
        caller: &Caller,
        wish: Wish,
        recording: impl Read + Send + 'static,
    ) -> Result<(), ImportError> {
        if let Some(newest) = self.maps.expect_free(map)?
            && !wish.resume
        {
            return Err(ImportError::HasFrames { map: map.to_owned(), newest });
        }
        let place = self.places.clone().try_acquire_owned().map_err(|_| ImportError::Busy)?;
        let spool =
            Spool::new(self.maps.store(), &self.limits, self.kept_free, import.stop.clone());
        let (opened, is_open) = oneshot::channel();
        let run = Run {
            map: map.to_owned(),
            connection: self.service.called_by(caller.clone()),
            poses: wish.poses,
            maps: self.maps.clone(),
            import: import.clone(),
        };
        // To the end even if the sender is gone.
        tokio::spawn(async move {
            run.map(spool, recording, opened).await;
            drop(place);
        });
        is_open.await.unwrap_or(Err(ImportError::Panicked))
    }

    /// Enters a new import; returns it, and the one that had its place.
    fn take_place(&self, map: &str) -> Result<(Arc<Import>, Option<Arc<Import>>), ImportError> {
        let mut of_maps = self.of_maps();
        if of_maps.get(map).is_some_and(|import| import.is_running()) {
            return Err(ImportError::Already { map: map.to_owned() });
        }
        while of_maps.len() >= REMEMBERED {
            let ended = of_maps.iter().find(|(_, import)| !import.is_running());
            let Some(name) = ended.map(|(name, _)| name.clone()) else { break };
            of_maps.remove(&name);
        }
        let import = Arc::<Import>::default();
        let before = of_maps.insert(map.to_owned(), import.clone());
        Ok((import, before))
    }

    /// The newest import into a map since the server started.
    pub(crate) fn of(&self, map: &str) -> Option<json::Import> {
        self.of_maps().get(map).map(|import| import.told().clone())
    }

    /// Stops mapping a recording, and waits until the map is free for others. Returns false if none is being
    /// mapped.
    pub(crate) async fn stop(&self, map: &str) -> bool {
        let import = self.of_maps().get(map).filter(|import| import.is_running()).cloned();
        let Some(import) = import else { return false };
        import.stop.cancel();
        import.ended.cancelled().await;
        true
    }

    /// Forgets the import into a map that was deleted or renamed.
    pub(crate) fn forget(&self, map: &str) {
        if let Some(import) = self.of_maps().remove(map) {
            import.stop.cancel();
        }
    }

    fn of_maps(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Import>>> {
        self.of_maps.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
