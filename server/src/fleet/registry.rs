//! The maps of the fleet, each with its newest checkpoint.

use super::bus::{Bus, Failed, key};
use super::follow::Table;
use crate::pipeline::engine::check_name;
use async_nats::jetstream::kv::{CreateErrorKind, UpdateErrorKind};
use async_nats::jetstream::stream::LastRawMessageErrorKind;
use serde::{Deserialize, Serialize};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio_util::sync::CancellationToken;

/// A map.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct MapEntry {
    /// Unique name: a map that is deleted and made again has another one.
    pub id: String,
    /// The greatest fencing token of an owner. What comes with a smaller one is refused.
    pub token: u64,
    pub checkpoint: Option<Saved>,
    /// Whether it is being deleted: then it is not there any more for anybody.
    #[serde(default)]
    pub is_deleted: bool,
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

/// Follows the maps that there are.
pub(super) async fn follow(bus: &Bus, stopping: CancellationToken) -> Table<MapEntry> {
    Table::follow_those(bus.maps.clone(), |entry: &MapEntry| !entry.is_deleted, stopping).await
}

/// Makes a map if there is none of this name. Returns whether it was made.
///
/// # Errors
/// [`Failed`].
pub(super) async fn ensure(bus: &Bus, map: &str) -> Result<bool, Failed> {
    let entry = MapEntry { id: bus.unique(), token: 0, checkpoint: None, is_deleted: false };
    loop {
        match bus.maps.create(key(map), json(&entry)).await {
            Ok(_) => return Ok(true),
            Err(error) if error.kind() == CreateErrorKind::AlreadyExists => {}
            Err(error) => return Err(Failed::new("making a map", error)),
        }
        match find_any(bus, map).await? {
            Some((entry, revision)) if entry.is_deleted => {
                finish_deletion(bus, map, &entry, revision).await?;
            }
            Some(_) => return Ok(false),
            // It was deleted just now.
            None => {}
        }
    }
}

/// A map with the revision of its entry.
///
/// # Errors
/// [`Failed`].
pub(super) async fn find(bus: &Bus, map: &str) -> Result<Option<(MapEntry, u64)>, Failed> {
    Ok(find_any(bus, map).await?.filter(|(entry, _)| !entry.is_deleted))
}

/// The same, also for one that is being deleted. Asks the bucket's leader: others may not know the newest
/// entry.
async fn find_any(bus: &Bus, map: &str) -> Result<Option<(MapEntry, u64)>, Failed> {
    let failed = |error: &dyn std::fmt::Display| Failed::new("looking for a map", error);
    let subject = format!("{}{}", bus.maps.prefix, key(map));
    let message = match bus.maps.stream.get_last_raw_message_by_subject(&subject).await {
        Ok(message) => message,
        Err(error) if error.kind() == LastRawMessageErrorKind::NoMessageFound => return Ok(None),
        Err(error) => return Err(failed(&error)),
    };
    // A marker of a deletion has no value.
    if message.payload.is_empty() {
        return Ok(None);
    }
    let entry = serde_json::from_slice(&message.payload).map_err(|error| failed(&error))?;
    Ok(Some((entry, message.sequence)))
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

/// Makes a checkpoint the newest of the map called `id`. Returns the one before, and the revision of the
/// entry.
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
/// [`Failed`]. Then the map is not there any more, or as it was; the next deletion or creation of the name finishes it.
pub(super) async fn delete(bus: &Bus, map: &str) -> Result<bool, Failed> {
    if check_name(map).is_err() {
        return Ok(false);
    }
    let Some((mut entry, mut revision)) = find_any(bus, map).await? else { return Ok(false) };
    let was_there = !entry.is_deleted;
    while !entry.is_deleted {
        entry.is_deleted = true;
        match bus.maps.update(key(map), json(&entry), revision).await {
            Ok(marked) => revision = marked,
            Err(error) if error.kind() == UpdateErrorKind::WrongLastRevision => {
                let Some(newer) = find_any(bus, map).await? else { return Ok(true) };
                (entry, revision) = newer;
            }
            Err(error) => return Err(Failed::new("deleting a map", error)),
        }
    }
    finish_deletion(bus, map, &entry, revision).await?;
    Ok(was_there)
}

/// Removes what is left of a map that is marked as deleted, and then its entry.
async fn finish_deletion(
    bus: &Bus,
    map: &str,
    entry: &MapEntry,
    revision: u64,
) -> Result<(), Failed> {
    bus.clear(map).await?;
    if let Some(saved) = &entry.checkpoint {
        forget(bus, &saved.object).await;
    }
    match bus.maps.delete_expect_revision(key(map), Some(revision)).await {
        Ok(()) => Ok(()),
        // Somebody else finished it.
        Err(_) if find_any(bus, map).await?.is_none_or(|(_, now)| now != revision) => Ok(()),
        Err(error) => Err(Failed::new("deleting a map", error)),
    }
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
