//! The maps of the fleet, each with its newest checkpoint.

use super::bus::{Bus, Failed, key};
use async_nats::jetstream::kv::{CreateErrorKind, Operation, UpdateErrorKind};
use serde::{Deserialize, Serialize};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// A map.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct MapEntry {
    /// Unique name: a map that is deleted and made again has another one.
    pub id: String,
    /// The greatest fencing token of an owner. What comes with a smaller one is refused.
    pub token: u64,
    pub checkpoint: Option<Saved>,
}

/// A checkpoint in the object store.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Saved {
    /// Name of the object.
    pub object: String,
    /// Of what made it; only the same can go on with it.
    pub fingerprint: String,
    /// Sequence of the newest frame in it.
    pub through: u64,
    /// Position of that frame's last part in the log.
    pub position: u64,
    /// Fencing token of the owner who wrote it.
    pub token: u64,
    /// When the map was copied for it, by the owner's clock: seconds since 1970.
    pub taken_at: u64,
}

impl Saved {
    /// How old it is, by the clocks of its owner and of this machine.
    pub(super) fn age(&self) -> Duration {
        now().saturating_sub(Duration::from_secs(self.taken_at))
    }
}

/// Time since 1970.
pub(super) fn now() -> Duration {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default()
}

/// Why an owner's change is refused.
#[derive(Debug, thiserror::Error)]
pub(super) enum ChangeError {
    #[error("another worker has the map by now")]
    Fenced,
    #[error("the map was deleted")]
    Deleted,
    #[error(transparent)]
    Failed(#[from] Failed),
}

/// Makes a map if there is none of this name. Returns whether it was made.
///
/// # Errors
/// [`Failed`].
pub(super) async fn ensure(bus: &Bus, map: &str) -> Result<bool, Failed> {
    let id = bus.client.new_inbox().replace("_INBOX.", "");
    let entry = MapEntry { id, token: 0, checkpoint: None };
    match bus.maps.create(key(map), json(&entry)).await {
        Ok(_) => {
            // A deletion may have been cut off before its end.
            bus.clear(map).await.map(|()| true)
        }
        Err(error) if error.kind() == CreateErrorKind::AlreadyExists => Ok(false),
        Err(error) => Err(Failed::new("making a map", error)),
    }
}

/// A map with the revision of its entry.
///
/// # Errors
/// [`Failed`].
pub(super) async fn find(bus: &Bus, map: &str) -> Result<Option<(MapEntry, u64)>, Failed> {
    let failed = |error: &dyn std::fmt::Display| Failed::new("looking for a map", error);
    let entry = bus.maps.entry(key(map)).await.map_err(|error| failed(&error))?;
    let Some(entry) = entry.filter(|entry| entry.operation == Operation::Put) else {
        return Ok(None);
    };
    let map = serde_json::from_slice(&entry.value).map_err(|error| failed(&error))?;
    Ok(Some((map, entry.revision)))
}

/// Makes the owner with this token the newest one. Returns the map, and the revision of its entry.
///
/// # Errors
/// [`ChangeError`].
pub(super) async fn claim(
    bus: &Bus,
    map: &str,
    token: u64,
) -> Result<(MapEntry, u64), ChangeError> {
    change(bus, map, token, None, |entry| entry.token = token).await
}

/// Makes a checkpoint the newest of the map called `id`. Returns the one before, and the revision of the entry.
///
/// # Errors
/// [`ChangeError`].
pub(super) async fn set_checkpoint(
    bus: &Bus,
    map: &str,
    id: &str,
    saved: Saved,
) -> Result<(Option<Saved>, u64), ChangeError> {
    let (token, mut before) = (saved.token, None);
    let changed = change(bus, map, token, Some(id), |entry| {
        before = entry.checkpoint.replace(saved.clone());
    });
    let (_, revision) = changed.await?;
    Ok((before, revision))
}

async fn change(
    bus: &Bus,
    map: &str,
    token: u64,
    id: Option<&str>,
    mut make: impl FnMut(&mut MapEntry),
) -> Result<(MapEntry, u64), ChangeError> {
    loop {
        let Some((mut entry, revision)) = find(bus, map).await? else {
            return Err(ChangeError::Deleted);
        };
        if id.is_some_and(|id| id != entry.id) {
            return Err(ChangeError::Deleted);
        }
        if is_fenced(entry.token, token) {
            return Err(ChangeError::Fenced);
        }
        make(&mut entry);
        match bus.maps.update(key(map), json(&entry), revision).await {
            Ok(revision) => return Ok((entry, revision)),
            // Somebody else was faster: look again.
            Err(error) if error.kind() == UpdateErrorKind::WrongLastRevision => {}
            Err(error) => return Err(Failed::new("changing a map", error).into()),
        }
    }
}

/// Whether an owner with the token `mine` is not the newest one any more, where `newest` is known.
pub(super) fn is_fenced(newest: u64, mine: u64) -> bool {
    // `--features unfenced` is the negative control of the fleet's soak test.
    cfg!(not(feature = "unfenced")) && mine < newest
}

/// Deletes a map with its checkpoints and frames. Returns whether there was one.
///
/// # Errors
/// [`Failed`].
pub(super) async fn delete(bus: &Bus, map: &str) -> Result<bool, Failed> {
    let Some((entry, revision)) = find(bus, map).await? else { return Ok(false) };
    let failed = |error: &dyn std::fmt::Display| Failed::new("deleting a map", error);
    let deleted = bus.maps.delete_expect_revision(key(map), Some(revision)).await;
    deleted.map_err(|error| failed(&error))?;
    bus.clear(map).await?;
    if let Some(saved) = entry.checkpoint {
        forget(bus, &saved.object).await;
    }
    Ok(true)
}

/// Removes a checkpoint that nobody needs. If this fails, it takes room and does no harm.
pub(super) async fn forget(bus: &Bus, object: &str) {
    if let Err(error) = bus.checkpoints.delete(object).await {
        tracing::warn!(%error, object, "a checkpoint that is not needed was not removed");
    }
}

fn json(entry: &MapEntry) -> prost::bytes::Bytes {
    serde_json::to_vec(entry).expect("texts and numbers are JSON").into()
}
