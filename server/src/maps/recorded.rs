//! Creating, opening and deleting maps with their recordings.

use super::error::MapsError;
use crate::check::Opening;
use crate::pipeline::engine::Engine;
use crate::pipeline::map::{Map, MapError, StreamGuard};
use crate::store::{Recorder, Store, StoreError};
use lexsplat_proto::v1;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// The maps of an engine and the store that records them. Cheap to clone.
#[derive(Clone)]
pub(crate) struct RecordedMaps {
    engine: Arc<Engine>,
    store: Store,
    /// Why maps with a recording could not be rebuilt, by name.
    not_rebuilt: Arc<Mutex<BTreeMap<String, String>>>,
}

/// The right to send frames to a map; a map has at most one. Dropping it frees the map for the next
/// sender.
pub(crate) struct Recording {
    sender: StreamGuard,
    /// `None` if the server has no data directory.
    recorder: Option<Recorder>,
}

impl RecordedMaps {
    pub(crate) fn new(engine: Arc<Engine>, store: Store) -> Self {
        Self { engine, store, not_rebuilt: Arc::default() }
    }

    pub(crate) fn engine(&self) -> &Arc<Engine> {
        &self.engine
    }

    pub(super) fn store(&self) -> &Store {
        &self.store
    }

    /// The map called `name`.
    ///
    /// # Errors
    /// [`MapError::NotFound`]; [`MapError::Failed`] if it could not be rebuilt.
    pub(crate) fn get(&self, name: &str) -> Result<Arc<Map>, MapError> {
        self.expect_rebuilt(name)?;
        self.engine.map(name)
    }

    /// Notes that a map with a recording could not be rebuilt. Its recording stays as it is.
    pub(super) fn note_not_rebuilt(&self, name: &str, reason: String) {
        let mut notes = self.not_rebuilt.lock().unwrap_or_else(PoisonError::into_inner);
        notes.insert(name.to_owned(), reason);
    }

    /// Refuses a map that has a recording but could not be rebuilt from it.
    fn expect_rebuilt(&self, name: &str) -> Result<(), MapError> {
        let notes = self.not_rebuilt.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(reason) = notes.get(name) else { return Ok(()) };
        let reason = format!(
            "it could not be rebuilt from its recording, which is kept: {reason}. Correct the cause and start \
             the server again, or delete the map"
        );
        Err(MapError::Failed { name: name.to_owned(), reason })
    }

    /// What is wrong with the recording of a map, in words; `None` if nothing is.
    pub(crate) fn damage(&self, name: &str) -> Option<String> {
        let damaged = self.store.damaged(name).unwrap_or_default();
        let names = damaged.iter().filter_map(|path| path.file_name()?.to_str());
        let names = names.collect::<Vec<_>>().join(", ");
        (!names.is_empty()).then(|| {
            format!("a part of the recording was damaged and is not in the map; set aside: {names}")
        })
    }

    /// All that is wrong with recordings, in words: damage, and maps that could not be rebuilt.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let names = self.store.maps().unwrap_or_default();
        let damaged =
            names.iter().filter_map(|name| Some(format!("{name}: {}", self.damage(name)?)));
        let notes = self.not_rebuilt.lock().unwrap_or_else(PoisonError::into_inner);
        let missing = notes.iter().map(|(name, reason)| format!("{name}: not rebuilt: {reason}"));
        damaged.chain(missing).collect()
    }

    /// Creates an empty map.
    ///
    /// # Errors
    /// [`MapsError::Map`] if the name is invalid or taken, or there are too many maps.
    pub(crate) async fn create(&self, name: &str) -> Result<Arc<Map>, MapsError> {
        self.expect_rebuilt(name)?;
        let name = name.to_owned();
        self.blocking(move |engine| engine.create(&name)).await
    }

    /// Deletes a map and its recording, to the end even if the caller is gone.
    ///
    /// # Errors
    /// [`MapsError`] if there is no such map or its recording cannot be removed.
    pub(crate) async fn delete(&self, name: &str) -> Result<(), MapsError> {
        let (this, name) = (self.clone(), name.to_owned());
        let deleted = tokio::spawn(async move { this.delete_now(&name).await }).await;
        deleted.map_err(|_| MapsError::Panicked)?
    }

    async fn delete_now(&self, name: &str) -> Result<(), MapsError> {
        let is_noted = {
            let mut notes = self.not_rebuilt.lock().unwrap_or_else(PoisonError::into_inner);
            notes.remove(name).is_some()
        };
        if !is_noted {
            self.engine.delete(name).await?;
        }
        Ok(self.store.forget(name).await?)
    }

    /// Opens a map for a sender; creates it if it does not exist.
    ///
    /// `opening` is the checked form of `open`.
    ///
    /// # Errors
    /// [`MapsError`] if the map has a sender or another camera, or its recording cannot be written.
    pub(crate) async fn open(
        &self,
        open: &v1::OpenMap,
        opening: &Opening,
    ) -> Result<Recording, MapsError> {
        self.expect_rebuilt(&open.map)?;
        let name = open.map.clone();
        let map = self.blocking(move |engine| engine.open(&name)).await?;
        let sender = map.claim(opening.intrinsics)?;
        let recorder = self.store.record(open).await?;
        Ok(Recording { sender, recorder })
    }

    /// Runs on a blocking thread: creating a map allocates GPU memory and starts a thread.
    async fn blocking(
        &self,
        work: impl FnOnce(&Engine) -> Result<Arc<Map>, MapError> + Send + 'static,
    ) -> Result<Arc<Map>, MapsError> {
        let engine = self.engine.clone();
        let done = tokio::task::spawn_blocking(move || work(&engine)).await;
        Ok(done.map_err(|_| MapsError::Panicked)??)
    }
}

impl Recording {
    pub(crate) fn map(&self) -> &Arc<Map> {
        self.sender.map()
    }

    /// Records a frame; it is on disk when this returns. Does nothing without a data directory.
    ///
    /// # Errors
    /// [`StoreError`]; then the frame is not in the recording and must not be mapped.
    pub(crate) async fn record(&self, frame: v1::Frame) -> Result<(), StoreError> {
        match &self.recorder {
            Some(recorder) => recorder.append(frame).await,
            None => Ok(()),
        }
    }

    /// Whether frames are recorded.
    pub(crate) fn is_recorded(&self) -> bool {
        self.recorder.is_some()
    }

    /// Closes the recording of this stream.
    pub(crate) async fn finish(&self) {
        if let Some(recorder) = &self.recorder {
            recorder.finish().await;
        }
    }
}
