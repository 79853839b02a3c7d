//! Checkpoints in the object store: the state of a map, with what it takes to go on behind it.
//!
//! ```text
//! length      4 bytes, little-endian: of the beginning
//! beginning   protobuf: the opening message of the stream, and the newest acknowledgements
//! the rest    a checkpoint file, as in a data directory
//! ```

use super::bus::{Bus, Failed, key};
use super::registry::Saved;
use crate::maps::{Unusable, read_checkpoint};
use crate::pipeline::checkpoint::Checkpoint;
use crate::store::{Label, encode_checkpoint};
use async_nats::jetstream::object_store::{GetErrorKind, ObjectMetadata};
use lexsplat_proto::v1;
use prost::Message as _;
use std::io::{Cursor, Seek as _, Write as _};
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

/// Size of a part of an object, bytes: less than the longest message that NATS takes by default.
const PART: usize = 512 << 10;
/// The longest beginning, bytes.
const LONGEST_BEGINNING: u32 = 16 << 20;

/// How long reading one may take.
const READ_WITHIN: Duration = Duration::from_secs(120);

/// What is needed beside the state.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Beginning {
    /// Opening message of the stream of the newest frame.
    #[prost(message, optional, tag = "1")]
    pub open: Option<v1::OpenMap>,
    /// The newest acknowledgements, oldest first.
    #[prost(message, repeated, tag = "2")]
    pub acks: Vec<v1::FrameAck>,
}

/// Writes the object that `saved` names. Returns its bytes.
///
/// # Errors
/// [`Failed`]; then nothing refers to what may have been written.
pub(super) async fn write(
    bus: &Bus,
    map: &str,
    saved: &Saved,
    beginning: Beginning,
    state: Checkpoint,
) -> Result<u64, Failed> {
    let failed = |error: &dyn std::fmt::Display| Failed::new("writing a checkpoint", error);
    let label = Label {
        map: map.to_owned(),
        fingerprint: saved.fingerprint.clone(),
        through: saved.through,
        frames: state.frames(),
    };
    let encoded = tokio::task::spawn_blocking(move || {
        let write =
            |mut out: &mut dyn std::io::Write| state.write(&mut out).map_err(std::io::Error::other);
        let (mut file, bytes) = encode_checkpoint(tempfile::tempfile()?, &label, write)?;
        file.rewind()?;
        Ok::<_, std::io::Error>((file, bytes))
    });
    let encoded = encoded.await.map_err(|error| failed(&error))?;
    let (file, bytes) = encoded.map_err(|error| failed(&error))?;
    let beginning = beginning.encode_to_vec();
    let length = u32::try_from(beginning.len()).map_err(|error| failed(&error))?;
    let start = [length.to_le_bytes().to_vec(), beginning].concat();
    let whole = bytes + start.len() as u64;
    let mut object = Cursor::new(start).chain(tokio::fs::File::from_std(file));
    let meta = ObjectMetadata {
        name: saved.object.clone(),
        chunk_size: Some(PART),
        ..ObjectMetadata::default()
    };
    bus.checkpoints.put(meta, &mut object).await.map_err(|error| failed(&error))?;
    Ok(whole)
}

/// A name for the object of a checkpoint that no other one has.
pub(super) fn object_of(bus: &Bus, map: &str, token: u64, through: u64) -> String {
    format!("{}/{token}/{through}/{}", key(map), bus.unique())
}

/// Reads a checkpoint; `None` if a server with other settings or networks made it, or if it is gone.
///
/// # Errors
/// [`Failed`], also if it takes too long: an object whose parts are gone is never read to its end.
pub(super) async fn read(
    bus: &Bus,
    saved: &Saved,
    fingerprint: &str,
) -> Result<Option<(Beginning, Checkpoint)>, Failed> {
    if saved.fingerprint != fingerprint {
        return Ok(None);
    }
    let late = |_| Failed::new("reading a checkpoint", format!("not within {READ_WITHIN:?}"));
    tokio::time::timeout(READ_WITHIN, read_in_time(bus, saved, fingerprint)).await.map_err(late)?
}

async fn read_in_time(
    bus: &Bus,
    saved: &Saved,
    fingerprint: &str,
) -> Result<Option<(Beginning, Checkpoint)>, Failed> {
    let failed = |error: &dyn std::fmt::Display| Failed::new("reading a checkpoint", error);
    let mut object = match bus.checkpoints.get(&saved.object).await {
        Ok(object) => object,
        Err(error) if error.kind() == GetErrorKind::NotFound => {
            tracing::error!(object = saved.object, "a checkpoint is gone: the log has to do");
            return Ok(None);
        }
        Err(error) => return Err(failed(&error)),
    };
    let length = object.read_u32_le().await.map_err(|error| failed(&error))?;
    if length > LONGEST_BEGINNING {
        return Err(failed(&"it does not begin like a checkpoint"));
    }
    let mut beginning = vec![0; length as usize];
    object.read_exact(&mut beginning).await.map_err(|error| failed(&error))?;
    let beginning = Beginning::decode(&*beginning).map_err(|error| failed(&error))?;
    let file = tempfile::NamedTempFile::new().map_err(|error| failed(&error))?;
    let copy = file.reopen().map_err(|error| failed(&error))?;
    let mut copy = tokio::fs::File::from_std(copy);
    tokio::io::copy(&mut object, &mut copy).await.map_err(|error| failed(&error))?;
    copy.flush().await.map_err(|error| failed(&error))?;
    let fingerprint = fingerprint.to_owned();
    let state = tokio::task::spawn_blocking(move || {
        file.as_file().flush().map_err(|error| Unusable::Other(error.to_string()))?;
        read_checkpoint(file.path(), &fingerprint)
    });
    let state = state.await.map_err(|error| failed(&error))?;
    let state = state.map_err(|error| failed(&error))?;
    Ok(state.map(|state| (beginning, state)))
}
