//! Maps of other workers, as their newest checkpoints have them: for questions that need not be answered by
//! the owner.
//!
//! A copy is loaded when somebody asks for it, and again when there is a newer checkpoint. It takes no
//! frames.

use super::bus::Bus;
use super::checkpoints;
use super::follow::Table;
use super::registry::{MapEntry, Saved};
use crate::maps::{Elsewhere, LoadProgress, MapsError};
use crate::pipeline::engine::Engine;
use crate::pipeline::map::MapError;
use futures::future::BoxFuture;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Mutex;

/// A copy that nobody asked for in so long is removed.
const KEPT: Duration = Duration::from_secs(300);

/// A copy that is in the engine.
struct Copy {
    of: Saved,
    used: Instant,
}

#[derive(Default)]
struct Inner {
    copies: BTreeMap<String, Copy>,
}

/// The copies of a worker. Cheap to clone.
#[derive(Clone)]
pub(crate) struct Copies {
    bus: Bus,
    engine: Arc<Engine>,
    maps: Table<MapEntry>,
    inner: Arc<Mutex<Inner>>,
    /// Maps that this worker has itself.
    owned: Arc<std::sync::Mutex<BTreeSet<String>>>,
}

impl Copies {
    pub(super) fn new(bus: Bus, engine: Arc<Engine>, maps: Table<MapEntry>) -> Self {
        Self { bus, engine, maps, inner: Arc::default(), owned: Arc::default() }
    }

    /// This worker takes a map: its copy makes room, and others do if there are as many maps as there may be.
    pub(super) async fn make_room(&self, map: &str) {
        self.owned().insert(map.to_owned());
        let mut inner = self.inner.lock().await;
        self.remove(&mut inner, map).await;
        if self.engine.maps().len() >= self.engine.max_maps() {
            self.remove_oldest(&mut inner).await;
        }
    }

    /// This worker has given a map up.
    pub(super) fn release(&self, map: &str) {
        self.owned().remove(map);
    }

    fn owned(&self) -> MutexGuard<'_, BTreeSet<String>> {
        self.owned.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Removes copies that nobody asks for, and those of maps that were deleted.
    pub(super) async fn tidy(&self) {
        // While one is loaded, the worker does not wait for it.
        let Ok(mut inner) = self.inner.try_lock() else { return };
        let is_old = |(map, copy): &(&String, &Copy)| {
            copy.used.elapsed() > KEPT || self.maps.get(map).is_none()
        };
        let old: Vec<String> =
            inner.copies.iter().filter(is_old).map(|(map, _)| map.clone()).collect();
        for map in old {
            self.remove(&mut inner, &map).await;
        }
    }

    async fn remove_oldest(&self, inner: &mut Inner) -> bool {
        let oldest = inner.copies.iter().min_by_key(|(_, copy)| copy.used);
        let Some(oldest) = oldest.map(|(map, _)| map.clone()) else { return false };
        self.remove(inner, &oldest).await;
        true
    }

    async fn remove(&self, inner: &mut Inner, map: &str) {
        if inner.copies.remove(map).is_some() {
            // An error means that there is none.
            let _ = self.engine.delete(map).await;
        }
    }

    /// Loads the newest checkpoint of a map that another worker has, unless it is here.
    async fn ensure(&self, map: &str) -> Result<(), MapsError> {
        let mut inner = self.inner.lock().await;
        if self.owned().contains(map) {
            return Ok(());
        }
        let not_found = || MapError::NotFound { name: map.to_owned() };
        let entry = self.maps.get(map).ok_or_else(not_found)?.value;
        let progress = LoadProgress { frames_done: 0, frames_total: 0 };
        let loading = || MapsError::Loading { name: map.to_owned(), progress };
        let newest = entry.checkpoint.ok_or_else(loading)?;
        if let Some(copy) = inner.copies.get_mut(map)
            && copy.of == newest
        {
            copy.used = Instant::now();
            return Ok(());
        }
        let read = checkpoints::read(&self.bus, &newest, self.engine.fingerprint()).await;
        let state = match read {
            Ok(Some((_, state))) => state,
            // A worker of another version made it.
            Ok(None) => return Err(loading()),
            Err(error) => {
                tracing::warn!(%error, map, "a checkpoint cannot be read");
                return Err(loading());
            }
        };
        self.remove(&mut inner, map).await;
        if self.engine.maps().len() >= self.engine.max_maps()
            && !self.remove_oldest(&mut inner).await
        {
            return Err(MapError::TooMany { limit: self.engine.max_maps() }.into());
        }
        let (engine, name) = (self.engine.clone(), map.to_owned());
        let made = tokio::task::spawn_blocking(move || engine.restore(&name, state)).await;
        made.map_err(|_| MapsError::Panicked)??;
        tracing::info!(map, through = newest.through, "a copy of another worker's map");
        inner.copies.insert(map.to_owned(), Copy { of: newest, used: Instant::now() });
        Ok(())
    }
}

impl Elsewhere for Copies {
    fn ensure<'a>(&'a self, map: &'a str) -> BoxFuture<'a, Result<(), MapsError>> {
        let (this, name) = (self.clone(), map.to_owned());
        Box::pin(async move {
            if this.owned().contains(&name) {
                return Ok(());
            }
            // To its end even if the caller is gone.
            let ensured = tokio::spawn(async move { this.ensure(&name).await }).await;
            ensured.map_err(|_| MapsError::Panicked)?
        })
    }
}
