//! Files of messages, whatever they are written in.

use crate::dataset::DatasetError;

/// A topic of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Channel {
    pub topic: String,
    /// How messages are written: `cdr`, `protobuf` or `json`.
    pub encoding: String,
    /// The name of their schema.
    pub schema: String,
}

/// Where a message lies in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// First byte of the chunk or record, or number of the row.
    pub at: u64,
    /// The place among the messages of a chunk, from 0.
    pub nth: u32,
}

/// A message as it is met in a file.
pub(super) struct Message<'a> {
    pub channel: &'a Channel,
    /// When it was recorded, nanoseconds.
    pub nanos: u64,
    pub place: Place,
    pub data: &'a [u8],
}

/// A file of messages.
pub(super) trait Store: Send + Sync {
    /// Shows every message, in the order of the file. Returns what is wrong with the file, in words; what
    /// lies behind damage is shown too, if it can be found.
    ///
    /// # Errors
    /// [`DatasetError`] if nothing of the file can be read.
    fn scan(&self, take: &mut dyn FnMut(Message<'_>)) -> Result<Vec<String>, DatasetError>;

    /// The bytes of a message.
    ///
    /// # Errors
    /// [`DatasetError`] if the file has changed or is damaged there.
    fn read(&self, place: Place) -> Result<Vec<u8>, DatasetError>;
}
