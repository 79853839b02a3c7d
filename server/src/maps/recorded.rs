//! Creating, opening and deleting maps with their logs.

use super::error::MapsError;
use crate::check::Opening;
use crate::pipeline::engine::Engine;
use crate::pipeline::map::{Map, MapError, StreamGuard};
use crate::store::{Log, Store};
use lexsplat_proto::v1;
use std::sync::Arc;

/// The maps of an engine and the store that records them. Cheap to clone.
#[derive(Clone)]
pub(crate) struct RecordedMaps {
    engine: Arc<Engine>,
    store: Store,
}

/// The right to send frames to a map; a map has at most one. Dropping it frees the map for the next
/// sender.
pub(crate) struct Recording {
    sender: StreamGuard,
    /// `None` if the server has no data directory.
    log: Option<Arc<Log>>,
}

impl RecordedMaps {
    pub(crate) fn new(engine: Arc<Engine>, store: Store) -> Self {
        Self { engine, store }
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
    /// [`MapError::NotFound`].
    pub(crate) fn get(&self, name: &str) -> Result<Arc<Map>, MapError> {
        self.engine.map(name)
    }

    /// Creates an empty map.
    ///
    /// # Errors
    /// [`MapsError::Map`] if the name is invalid or taken, or there are too many maps.
    pub(crate) async fn create(&self, name: &str) -> Result<Arc<Map>, MapsError> {
        let name = name.to_owned();
        self.blocking(move |engine| engine.create(&name)).await
    }

    /// Deletes a map and its log.
    ///
    /// # Errors
    /// [`MapsError`] if there is no such map or its log cannot be removed.
    pub(crate) async fn delete(&self, name: &str) -> Result<(), MapsError> {
        self.engine.delete(name).await?;
        Ok(self.store.forget(name).await?)
    }

    /// Opens a map for a sender; creates it if it does not exist.
    ///
    /// `opening` is the checked form of `open`.
    ///
    /// # Errors
    /// [`MapsError`] if the map has a sender or another camera, or its log cannot be written.
    pub(crate) async fn open(
        &self,
        open: &v1::OpenMap,
        opening: &Opening,
    ) -> Result<Recording, MapsError> {
        let name = open.map.clone();
        let map = self.blocking(move |engine| engine.open(&name)).await?;
        let sender = map.claim(opening.intrinsics)?;
        let log = self.store.log(open).await?;
        Ok(Recording { sender, log })
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

    pub(crate) fn log(&self) -> Option<&Arc<Log>> {
        self.log.as_ref()
    }
}
