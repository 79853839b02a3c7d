//! The connection to NATS, and the names of all that the fleet keeps there.

use super::config::FleetConfig;
use crate::telemetry::FLEET_BUS_CONNECTED;
use async_nats::jetstream::context::ContextBuilder;
use async_nats::jetstream::object_store::ObjectStore;
use async_nats::jetstream::stream::{DiscardPolicy, LastRawMessageErrorKind, Stream};
use async_nats::jetstream::{Context, kv, object_store, stream};
use async_nats::{Client, ConnectOptions, Event};
use std::fmt::Display;
use std::time::{Duration, Instant};

/// How long NATS may take to be there when a server starts.
const START: Duration = Duration::from_secs(30);
/// How long a request to JetStream may take.
const REQUEST: Duration = Duration::from_secs(5);
/// How often the log of a map is cleared while a gateway does not know yet that the map is deleted.
const CLEARINGS: usize = 20;
/// Between two tries.
const AGAIN: Duration = Duration::from_millis(300);

/// Why NATS cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// The credentials cannot be read.
    #[error("fleet.credentials: cannot read {path}: {reason}")]
    Credentials {
        /// The file.
        path: String,
        /// Error of the system.
        reason: std::io::Error,
    },
    /// No server answers, or it has no JetStream.
    #[error(
        "fleet.nats: {servers} cannot be used: {reason}. Expected a NATS server with JetStream (nats-server -js)"
    )]
    Unusable {
        /// Its addresses.
        servers: String,
        /// What went wrong.
        reason: String,
    },
}

/// A request to NATS that failed.
#[derive(Debug, thiserror::Error)]
#[error("{doing}: {reason}")]
pub(crate) struct Failed {
    doing: &'static str,
    reason: String,
}

impl Failed {
    pub(super) fn new(doing: &'static str, reason: impl Display) -> Self {
        Self { doing, reason: reason.to_string() }
    }
}

/// What the fleet keeps in NATS. Cheap to clone.
#[derive(Clone)]
pub(crate) struct Bus {
    prefix: String,
    pub(super) client: Client,
    pub(super) jetstream: Context,
    /// The log of all accepted frames.
    pub(super) frames: Stream,
    /// The maps that there are, with their newest checkpoints.
    pub(super) maps: kv::Store,
    /// Which worker has which map.
    pub(super) leases: kv::Store,
    /// The workers that there are.
    pub(super) workers: kv::Store,
    pub(super) checkpoints: ObjectStore,
}

impl Bus {
    /// Connects, and makes what is missing.
    ///
    /// # Errors
    /// [`BusError`] if NATS is not there within half a minute.
    pub(crate) async fn connect(config: &FleetConfig) -> Result<Self, BusError> {
        let began = Instant::now();
        loop {
            let reason = match Self::try_connect(config).await? {
                Ok(bus) => return Ok(bus),
                Err(reason) => reason,
            };
            if began.elapsed() > START {
                let servers = config.nats.join(", ");
                return Err(BusError::Unusable { servers, reason: reason.to_string() });
            }
            tracing::info!(%reason, "waiting for NATS");
            tokio::time::sleep(AGAIN).await;
        }
    }

    async fn try_connect(config: &FleetConfig) -> Result<Result<Self, Failed>, BusError> {
        let mut options = ConnectOptions::new()
            .name("lexsplat")
            .ping_interval(Duration::from_secs(5))
            .event_callback(|event| async move {
                match event {
                    Event::Connected => metrics::gauge!(FLEET_BUS_CONNECTED).set(1.0),
                    Event::Disconnected => metrics::gauge!(FLEET_BUS_CONNECTED).set(0.0),
                    _ => {}
                }
                tracing::info!(%event, "NATS");
            });
        if let Some(path) = &config.credentials {
            options = options.credentials_file(path).await.map_err(|reason| {
                BusError::Credentials { path: path.display().to_string(), reason }
            })?;
        }
        let connected = options.connect(config.nats.as_slice()).await;
        let client = match connected {
            Ok(client) => client,
            Err(error) => return Ok(Err(Failed::new("connecting", error))),
        };
        metrics::gauge!(FLEET_BUS_CONNECTED).set(1.0);
        Ok(Self::with(client, config).await)
    }

    async fn with(client: Client, config: &FleetConfig) -> Result<Self, Failed> {
        let jetstream =
            ContextBuilder::new().timeout(REQUEST).ack_timeout(REQUEST).build(client.clone());
        let (prefix, replicas) = (config.prefix.clone(), config.replicas);
        let limit = i64::try_from(config.max_log_bytes).unwrap_or(i64::MAX);
        let frames = jetstream.get_or_create_stream(stream::Config {
            name: format!("{prefix}-frames"),
            subjects: vec![format!("{prefix}.frames.*")],
            // A full log refuses frames; it does not forget those that were acknowledged.
            discard: DiscardPolicy::New,
            max_bytes: if limit == 0 { -1 } else { limit },
            num_replicas: replicas,
            allow_direct: false,
            ..stream::Config::default()
        });
        let frames = frames.await.map_err(|error| Failed::new("making the frame log", error))?;
        let maps = bucket(&jetstream, format!("{prefix}-maps"), replicas).await?;
        let leases = bucket(&jetstream, format!("{prefix}-leases"), replicas).await?;
        let workers = bucket(&jetstream, format!("{prefix}-workers"), replicas).await?;
        let name = format!("{prefix}-checkpoints");
        let checkpoints = match jetstream.get_object_store(&name).await {
            Ok(store) => store,
            Err(_) => jetstream
                .create_object_store(object_store::Config {
                    bucket: name,
                    num_replicas: replicas,
                    ..object_store::Config::default()
                })
                .await
                .map_err(|error| Failed::new("making the store of checkpoints", error))?,
        };
        Ok(Self { prefix, client, jetstream, frames, maps, leases, workers, checkpoints })
    }

    /// Subject of the map's frames in the log.
    pub(super) fn frames_of(&self, map: &str) -> String {
        format!("{}.frames.{}", self.prefix, key(map))
    }

    /// Subject on which the map's worker acknowledges frames.
    pub(super) fn acks_of(&self, map: &str) -> String {
        format!("{}.acks.{}", self.prefix, key(map))
    }

    /// Subject on which the map's worker is asked for acknowledgements again.
    pub(super) fn again_of(&self, map: &str) -> String {
        format!("{}.again.{}", self.prefix, key(map))
    }

    /// Subject on which a gateway answers that it has a stream of the map.
    pub(super) fn writing_of(&self, map: &str) -> String {
        format!("{}.writing.{}", self.prefix, key(map))
    }

    /// Position of the newest message of a map in the log; 0 if there is none.
    ///
    /// # Errors
    /// [`Failed`].
    pub(super) async fn newest_position(&self, map: &str) -> Result<u64, Failed> {
        match self.frames.get_last_raw_message_by_subject(&self.frames_of(map)).await {
            Ok(message) => Ok(message.sequence),
            Err(error) if error.kind() == LastRawMessageErrorKind::NoMessageFound => Ok(0),
            Err(error) => Err(Failed::new("reading the log", error)),
        }
    }

    /// Removes what the log has of a map before a position.
    ///
    /// # Errors
    /// [`Failed`].
    pub(super) async fn trim(&self, map: &str, position: u64) -> Result<(), Failed> {
        let purged = self.frames.purge().filter(self.frames_of(map)).sequence(position).await;
        purged.map(drop).map_err(|error| Failed::new("trimming the log", error))
    }

    /// Removes all that the log has of a map now. What comes later stays, also if this is carried out late.
    ///
    /// # Errors
    /// [`Failed`].
    pub(super) async fn clear(&self, map: &str) -> Result<(), Failed> {
        for _ in 0..CLEARINGS {
            match self.newest_position(map).await? {
                0 => return Ok(()),
                newest => self.trim(map, newest + 1).await?,
            }
        }
        Err(Failed::new("clearing the log", "somebody still sends frames"))
    }

    /// A name that nothing else has.
    pub(super) fn unique(&self) -> String {
        self.client.new_inbox().replace("_INBOX.", "")
    }

    /// Whether the log can be written to: its leader answers.
    pub(super) async fn is_working(&self) -> bool {
        matches!(tokio::time::timeout(REQUEST, self.frames.get_info()).await, Ok(Ok(_)))
    }
}

async fn bucket(jetstream: &Context, bucket: String, replicas: usize) -> Result<kv::Store, Failed> {
    if let Ok(store) = jetstream.get_key_value(&bucket).await {
        return Ok(store);
    }
    let config = kv::Config { bucket, num_replicas: replicas, history: 1, ..kv::Config::default() };
    let made = jetstream.create_key_value(config).await;
    made.map_err(|error| Failed::new("making a bucket", error))
}

/// The name of a map in subjects and keys, where a dot separates parts.
pub(super) fn key(map: &str) -> String {
    map.replace('.', "=")
}

/// The map of a key.
pub(super) fn map_of(key: &str) -> String {
    key.replace('=', ".")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_maps_are_one_part_of_a_subject() {
        assert_eq!(key("house.2_a-b"), "house=2_a-b");
        assert_eq!(map_of(&key("house.2_a-b")), "house.2_a-b");
    }
}
