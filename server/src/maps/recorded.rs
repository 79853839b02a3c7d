//! Creating, opening and deleting maps with their recordings.

use super::error::MapsError;
use super::places::{Place, Places, Reserved, not_rebuilt};
use super::progress::LoadProgress;
use super::recording::Recording;
use crate::pipeline::engine::Engine;
use crate::pipeline::map::{Map, MapError, MapStatus};
use crate::store::{Store, StoreError, Usage};
use futures::future::BoxFuture;
use lexsplat_proto::v1;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Semaphore;

/// Backups that are read at a time: each has a thread that waits for the caller.
const BACKUPS: usize = 4;
/// Backups that are put in place at a time, likewise.
const RESTORES: usize = 2;
/// Between two looks at a map that is being loaded.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

/// The maps of an engine and the store that records them. Cheap to clone.
#[derive(Clone)]
pub(crate) struct RecordedMaps {
    engine: Arc<Engine>,
    store: Store,
    places: Arc<Places>,
    /// The state of each map that its newest checkpoint has.
    saved: Arc<Mutex<BTreeMap<String, State>>>,
    /// How long callers wait for a map that is being loaded.
    patience: Duration,
    /// Places for backups that are read.
    backups: Arc<Semaphore>,
    /// Places for backups that are put in place.
    restores: Arc<Semaphore>,
    /// In a fleet, which alone makes, fills and deletes maps: where maps come from that are not here.
    fleet: Option<Arc<dyn Elsewhere>>,
}

/// Where maps come from that a server does not have.
pub(crate) trait Elsewhere: Send + Sync {
    /// Makes sure that a map can be read here.
    fn ensure<'a>(&'a self, map: &'a str) -> BoxFuture<'a, Result<(), MapsError>>;
}

/// Newest frame and revision of a map: it changes when the map does.
pub(super) type State = (Option<u64>, u64);

/// A map in the list of maps.
pub(crate) struct Listed {
    pub status: MapStatus,
    /// Set while it is loaded or waits for it.
    pub loading: Option<LoadProgress>,
}

impl Listed {
    pub(crate) fn name(&self) -> &str {
        &self.status.name
    }
}

impl RecordedMaps {
    pub(crate) fn new(engine: Arc<Engine>, store: Store) -> Self {
        let patience = Duration::ZERO;
        let [backups, restores] =
            [BACKUPS, RESTORES].map(|places| Arc::new(Semaphore::new(places)));
        let (places, saved) = (Arc::default(), Arc::default());
        Self { engine, store, places, saved, patience, backups, restores, fleet: None }
    }

    /// The same, where only the fleet makes, fills and deletes maps.
    pub(crate) fn of_fleet(self, fleet: Arc<dyn Elsewhere>) -> Self {
        Self { fleet: Some(fleet), ..self }
    }

    /// Checks that maps are this server's own.
    ///
    /// # Errors
    /// [`MapsError::OfFleet`].
    pub(super) fn expect_own(&self) -> Result<(), MapsError> {
        if self.fleet.is_some() { Err(MapsError::OfFleet) } else { Ok(()) }
    }

    /// The same, where callers wait so long for a map that is being loaded.
    pub(crate) fn waiting(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }

    /// Places for backups that are read.
    pub(super) fn backups(&self) -> Arc<Semaphore> {
        self.backups.clone()
    }

    /// Places for backups that are put in place.
    pub(super) fn restores(&self) -> Arc<Semaphore> {
        self.restores.clone()
    }

    pub(crate) fn engine(&self) -> &Arc<Engine> {
        &self.engine
    }

    pub(crate) fn store(&self) -> &Store {
        &self.store
    }

    pub(super) fn places(&self) -> &Arc<Places> {
        &self.places
    }

    /// Finds the maps in the data directory. They wait to be loaded.
    ///
    /// # Errors
    /// [`StoreError`] if the directory cannot be listed.
    pub(crate) fn find_recordings(&self) -> Result<(), StoreError> {
        self.places.add(self.store.maps()?);
        Ok(())
    }

    /// Takes a name that no map has, for one that will be put there.
    ///
    /// # Errors
    /// [`MapError::AlreadyExists`], [`MapError::TooMany`].
    pub(super) fn reserve(&self, name: &str) -> Result<Reserved, MapsError> {
        let reserved = self.reserve_renamed(name)?;
        self.expect_place(name)?;
        Ok(reserved)
    }

    /// The same for a map that is there already, under another name.
    ///
    /// # Errors
    /// [`MapError::AlreadyExists`].
    pub(super) fn reserve_renamed(&self, name: &str) -> Result<Reserved, MapsError> {
        self.expect_own()?;
        let reserved = self.places.reserve(name)?;
        if self.engine.map(name).is_ok() || self.store.has(name) {
            return Err(MapError::AlreadyExists { name: name.to_owned() }.into());
        }
        Ok(reserved)
    }

    /// The same, unless the map is there: maps that are not loaded yet keep their places.
    fn expect_place_for_new(&self, name: &str) -> Result<(), MapError> {
        self.engine.map(name).map(drop).or_else(|_| self.expect_place(name))
    }

    /// Checks that frames could be sent to a map, which may be new. Returns its newest frame.
    ///
    /// # Errors
    /// [`MapError::Busy`] if somebody sends frames, [`MapError::TooMany`], [`MapsError::Loading`].
    pub(crate) fn expect_free(&self, name: &str) -> Result<Option<u64>, MapsError> {
        self.expect_own()?;
        match self.get(name) {
            Ok(map) => {
                drop(map.claim()?);
                Ok(map.received_through())
            }
            Err(MapsError::Map(MapError::NotFound { .. })) => {
                self.expect_place(name)?;
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    /// Checks that a map may be there beside all others, loaded or not.
    ///
    /// # Errors
    /// [`MapError::TooMany`].
    fn expect_place(&self, name: &str) -> Result<(), MapError> {
        let limit = self.engine.max_maps();
        let live = self.engine.maps().into_iter().map(|map| map.name().to_owned());
        let coming = self.places.all().into_iter();
        let coming = coming.filter_map(|(name, place)| place.progress().map(|_| name));
        let names: BTreeSet<String> = live.chain(coming).chain([name.to_owned()]).collect();
        if names.len() > limit { Err(MapError::TooMany { limit }) } else { Ok(()) }
    }

    /// The map called `name`. One that waits is loaded before those that nobody asked for.
    ///
    /// # Errors
    /// [`MapsError::Loading`]; [`MapError::NotFound`]; [`MapError::Failed`] if it could not be rebuilt.
    pub(crate) fn get(&self, name: &str) -> Result<Arc<Map>, MapsError> {
        self.places.expect_loaded(name)?;
        Ok(self.engine.map(name)?)
    }

    /// The map called `name`, once it is loaded. Waits for that, but not for long.
    ///
    /// # Errors
    /// As [`Self::get`].
    pub(crate) async fn loaded(&self, name: &str) -> Result<Arc<Map>, MapsError> {
        if let Some(fleet) = &self.fleet {
            fleet.ensure(name).await?;
        }
        self.expect_loaded(name).await?;
        Ok(self.engine.map(name)?)
    }

    async fn expect_loaded(&self, name: &str) -> Result<(), MapsError> {
        let began = Instant::now();
        loop {
            match self.places.expect_loaded(name) {
                Err(MapsError::Loading { .. }) if began.elapsed() < self.patience => {
                    tokio::time::sleep(LOOK_AGAIN).await;
                }
                loaded => return loaded,
            }
        }
    }

    fn saved(&self) -> MutexGuard<'_, BTreeMap<String, State>> {
        self.saved.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether a map has changed since its newest checkpoint.
    pub(super) fn is_unsaved(&self, name: &str, state: State) -> bool {
        self.saved().get(name) != Some(&state)
    }

    pub(super) fn note_saved(&self, name: &str, state: State) {
        self.saved().insert(name.to_owned(), state);
    }

    /// Forgets what was saved of a map.
    pub(super) fn note_gone(&self, name: &str) {
        self.saved().remove(name);
    }

    /// Whether the data directory has the map's frames.
    pub(super) fn is_recorded(&self, name: &str) -> bool {
        self.store.has(name)
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

    /// All that is wrong with recordings, in words: damage, maps that could not be rebuilt, frames that
    /// cannot be recorded, and little room.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let names = self.store.maps().unwrap_or_default();
        let damaged =
            names.iter().filter_map(|name| Some(format!("{name}: {}", self.damage(name)?)));
        let missing = self.places.all().into_iter().filter_map(|(name, place)| match place {
            Place::NotRebuilt(reason) => Some(format!("{name}: not rebuilt: {reason}")),
            Place::Waiting | Place::Loading(_) => None,
        });
        damaged.chain(missing).chain(self.store.warnings()).collect()
    }

    /// What recordings use of the disk, and what is free; `None` if nothing is recorded.
    ///
    /// # Errors
    /// [`StoreError::Io`].
    pub(crate) fn usage(&self) -> Result<Option<Usage>, StoreError> {
        self.store.usage()
    }

    /// Maps that are loaded or wait for it, with their progress.
    pub(crate) fn loading(&self) -> Vec<(String, LoadProgress)> {
        let places = self.places.all().into_iter();
        places.filter_map(|(name, place)| Some((name, place.progress()?))).collect()
    }

    /// All maps, by name.
    pub(crate) fn list(&self) -> Vec<Listed> {
        let places = self.places.all();
        let is_live = |map: &Arc<Map>| places.iter().all(|(name, _)| name != map.name());
        let live = self
            .engine
            .maps()
            .into_iter()
            .filter(is_live)
            .map(|map| Listed { status: map.status(), loading: None });
        let absent = places.iter().map(|(name, place)| {
            let failure = match place {
                Place::NotRebuilt(reason) => Some(not_rebuilt(reason)),
                Place::Waiting | Place::Loading(_) => None,
            };
            let status = MapStatus { failure, ..MapStatus::absent(name) };
            Listed { status, loading: place.progress() }
        });
        let mut all: Vec<Listed> = live.chain(absent).collect();
        all.sort_by(|a, b| a.status.name.cmp(&b.status.name));
        all
    }

    /// Creates an empty map.
    ///
    /// # Errors
    /// [`MapsError::Map`] if the name is invalid or taken, or there are too many maps; [`MapsError::Store`] if
    /// the data directory cannot keep it.
    pub(crate) async fn create(&self, name: &str) -> Result<Arc<Map>, MapsError> {
        self.expect_own()?;
        self.places.expect_loaded(name)?;
        self.expect_place_for_new(name)?;
        let new = name.to_owned();
        let map = self.blocking(move |engine| engine.create(&new)).await?;
        if let Err(error) = self.store.keep(name).await {
            self.engine.delete(name).await?;
            return Err(error.into());
        }
        Ok(map)
    }

    /// Deletes a map and its recording, to the end even if the caller is gone.
    ///
    /// # Errors
    /// [`MapsError`] if there is no such map or its recording cannot be removed.
    pub(crate) async fn delete(&self, name: &str) -> Result<(), MapsError> {
        self.expect_own()?;
        let (this, name) = (self.clone(), name.to_owned());
        let deleted = tokio::spawn(async move { this.delete_now(&name).await }).await;
        deleted.map_err(|_| MapsError::Panicked)?
    }

    async fn delete_now(&self, name: &str) -> Result<(), MapsError> {
        match self.places.find(name) {
            None => self.engine.delete(name).await?,
            Some(Place::Waiting | Place::NotRebuilt(_)) => {}
            Some(Place::Loading(load)) => {
                load.cancelled.cancel();
                // Until it is not loaded any more.
                let _ended = load.gate.lock().await;
                // A part of it may be there. An error means that there is none.
                let _ = self.engine.delete(name).await;
            }
        }
        self.places.remove(name);
        self.note_gone(name);
        Ok(self.store.forget(name).await?)
    }

    /// Opens a map for a sender; creates it if it does not exist.
    ///
    /// `open` has passed the checks.
    ///
    /// # Errors
    /// [`MapsError`] if the map has a sender, or its recording cannot be written.
    pub(crate) async fn open(&self, open: &v1::OpenMap) -> Result<Recording, MapsError> {
        self.expect_own()?;
        self.expect_loaded(&open.map).await?;
        self.expect_place_for_new(&open.map)?;
        let name = open.map.clone();
        let map = self.blocking(move |engine| engine.open(&name)).await?;
        let sender = map.claim()?;
        let recorder = self.store.record(open).await?;
        Ok(Recording::new(sender, recorder))
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
