//! Messages that a recorder of ROS 2 compressed one by one with zstd.

use crate::messages::{Decoder, MessageError, Reading};
use std::io::Read as _;

const ZSTD_MAGIC: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];
/// The most bytes of a message.
const LONGEST: u64 = 1 << 29;

/// What a message says. If it is compressed, it is decompressed into `space`: no message in CDR begins as
/// zstd does.
///
/// # Errors
/// [`MessageError`] if it is damaged.
pub(super) fn read<'a>(
    decoder: Decoder,
    data: &'a [u8],
    space: &'a mut Vec<u8>,
) -> Result<Reading<'a>, MessageError> {
    if !(decoder.is_ros() && data.starts_with(ZSTD_MAGIC)) {
        return decoder.read(data);
    }
    space.clear();
    let decompressed = zstd::Decoder::with_buffer(data)
        .and_then(|compressed| compressed.take(LONGEST).read_to_end(space));
    decompressed.map_err(|error| MessageError::Content(format!("expected whole zstd: {error}")))?;
    decoder.read(space)
}
