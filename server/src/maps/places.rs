//! Maps that are in the data directory and not in the engine: not loaded yet, being loaded, or impossible to
//! rebuild.
//!
//! Maps are loaded in the order in which they are asked for; those that nobody asked for come last.

use super::error::MapsError;
use super::progress::LoadProgress;
use crate::pipeline::map::MapError;
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;

/// A map that is being loaded.
#[derive(Default)]
pub(super) struct Load {
    done: AtomicU64,
    total: AtomicU64,
    /// Ends the loading.
    pub cancelled: CancellationToken,
    /// Held while the map is being loaded or restored.
    pub gate: Arc<tokio::sync::Mutex<()>>,
}

impl Load {
    pub fn set_total(&self, frames: u64) {
        self.total.store(frames, Ordering::Relaxed);
    }

    pub fn set_done(&self, frames: u64) {
        self.done.store(frames, Ordering::Relaxed);
    }

    fn progress(&self) -> LoadProgress {
        let frames_done = self.done.load(Ordering::Relaxed);
        LoadProgress { frames_done, frames_total: self.total.load(Ordering::Relaxed) }
    }
}

/// What keeps a map out of the engine.
#[derive(Clone)]
pub(super) enum Place {
    Waiting,
    Loading(Arc<Load>),
    /// Why it could not be rebuilt. Its recording stays as it is.
    NotRebuilt(String),
}

impl Place {
    /// How far it is loaded; `None` if it could not be rebuilt.
    pub fn progress(&self) -> Option<LoadProgress> {
        match self {
            Self::Waiting => Some(LoadProgress::default()),
            Self::Loading(load) => Some(load.progress()),
            Self::NotRebuilt(_) => None,
        }
    }
}

#[derive(Default)]
struct Inner {
    places: BTreeMap<String, Place>,
    /// Names of maps that were asked for and wait, the first one first.
    asked: VecDeque<String>,
    /// Names of the others that wait.
    others: VecDeque<String>,
}

/// All maps that are not in the engine.
#[derive(Default)]
pub(super) struct Places {
    inner: Mutex<Inner>,
    changed: Notify,
}

/// A name that is taken for a map that is not there yet.
pub(super) struct Reserved {
    places: Arc<Places>,
    name: String,
    load: Arc<Load>,
    /// A deletion waits for it.
    _gate: tokio::sync::OwnedMutexGuard<()>,
}

impl Reserved {
    /// The map's files are there now: it waits to be loaded.
    pub fn fill(self) {
        self.places.add([self.name.clone()]);
    }
}

impl Drop for Reserved {
    fn drop(&mut self) {
        // Does nothing if the map is there.
        self.places.ended(&self.name, &self.load, Ok(()));
    }
}

impl Places {
    fn locked(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds maps that wait to be loaded.
    pub fn add(&self, names: impl IntoIterator<Item = String>) {
        let mut inner = self.locked();
        for name in names {
            inner.others.push_back(name.clone());
            inner.places.insert(name, Place::Waiting);
        }
        drop(inner);
        self.changed.notify_one();
    }

    /// Whether a map may be used. One that waits is loaded before those that nobody asked for.
    ///
    /// # Errors
    /// [`MapsError::Loading`]; [`MapError::Failed`] if it could not be rebuilt.
    pub fn expect_loaded(&self, name: &str) -> Result<(), MapsError> {
        let mut inner = self.locked();
        let Some(place) = inner.places.get(name) else { return Ok(()) };
        if let Place::NotRebuilt(reason) = place {
            let reason = not_rebuilt(reason);
            return Err(MapError::Failed { name: name.to_owned(), reason }.into());
        }
        let progress = place.progress().unwrap_or_default();
        if let Some(at) = inner.others.iter().position(|waiting| waiting == name) {
            let asked = inner.others.remove(at);
            inner.asked.extend(asked);
        }
        Err(MapsError::Loading { name: name.to_owned(), progress })
    }

    /// Takes a name that is free for a map that will be put there, until the guard is dropped.
    ///
    /// # Errors
    /// [`MapError::AlreadyExists`].
    pub fn reserve(self: &Arc<Self>, name: &str) -> Result<Reserved, MapError> {
        let mut inner = self.locked();
        if inner.places.contains_key(name) {
            return Err(MapError::AlreadyExists { name: name.to_owned() });
        }
        let load = Arc::new(Load::default());
        inner.places.insert(name.to_owned(), Place::Loading(load.clone()));
        let gate = load.gate.clone().try_lock_owned().expect("nobody else knows it");
        Ok(Reserved { places: self.clone(), name: name.to_owned(), load, _gate: gate })
    }

    /// Resolves when there may be a map to load.
    pub async fn changed(&self) {
        self.changed.notified().await;
    }

    /// The next map to be loaded.
    pub fn next(&self) -> Option<(String, Arc<Load>)> {
        let mut inner = self.locked();
        let name = inner.asked.pop_front().or_else(|| inner.others.pop_front())?;
        let load = Arc::new(Load::default());
        inner.places.insert(name.clone(), Place::Loading(load.clone()));
        Some((name, load))
    }

    /// A load has ended well, or with a reason why the map cannot be rebuilt. Does nothing if the map was
    /// deleted meanwhile.
    pub fn ended(&self, name: &str, load: &Arc<Load>, ended: Result<(), String>) {
        let mut inner = self.locked();
        let is_same =
            matches!(inner.places.get(name), Some(Place::Loading(l)) if Arc::ptr_eq(l, load));
        match ended {
            Ok(()) if is_same => inner.places.remove(name),
            Err(reason) if is_same => {
                inner.places.insert(name.to_owned(), Place::NotRebuilt(reason))
            }
            _ => None,
        };
    }

    /// Where a map is, if it is not in the engine.
    pub fn find(&self, name: &str) -> Option<Place> {
        self.locked().places.get(name).cloned()
    }

    /// Forgets a map.
    pub fn remove(&self, name: &str) {
        let mut inner = self.locked();
        inner.places.remove(name);
        inner.asked.retain(|waiting| waiting != name);
        inner.others.retain(|waiting| waiting != name);
    }

    /// All of them, by name.
    pub fn all(&self) -> Vec<(String, Place)> {
        self.locked().places.iter().map(|(name, place)| (name.clone(), place.clone())).collect()
    }
}

/// Why a map that could not be rebuilt takes no frames, and what to do.
pub(super) fn not_rebuilt(reason: &str) -> String {
    format!(
        "it could not be rebuilt from its recording, which is kept: {reason}. Correct the cause and start \
         the server again, or delete the map"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(places: &Places) -> Vec<String> {
        std::iter::from_fn(|| places.next()).map(|(name, _)| name).collect()
    }

    #[test]
    fn maps_are_loaded_in_the_order_in_which_they_are_asked_for() {
        let places = Places::default();
        places.add(["a", "b", "c", "d"].map(String::from));
        places.expect_loaded("unknown").unwrap();
        for asked in ["d", "c", "d"] {
            let told = places.expect_loaded(asked).unwrap_err().to_string();
            assert!(told.contains("waits for its turn"), "{told}");
        }
        places.remove("a");
        assert_eq!(order(&places), ["d", "c", "b"]);
    }

    #[test]
    fn progress_and_failures_are_told() {
        let places = Places::default();
        places.add(["a", "b"].map(String::from));
        let (_, load) = places.next().unwrap();
        load.set_total(60);
        load.set_done(12);
        let told = places.expect_loaded("a").unwrap_err().to_string();
        assert!(told.contains("12 of 60 frames"), "{told}");
        places.ended("a", &load, Err("no room".into()));
        let told = places.expect_loaded("a").unwrap_err().to_string();
        assert!(told.contains("could not be rebuilt") && told.contains("no room"), "{told}");
        let (_, load) = places.next().unwrap();
        places.remove("b");
        places.add(["b".to_owned()]);
        places.ended("b", &load, Ok(()));
        assert!(places.expect_loaded("b").is_err(), "that was another map of this name");
    }
}
