//! Bytes whose number is known, compressed or not.

use flate2::read::ZlibDecoder;
use std::io::Read;

/// Reads all bytes of a source, of which there are to be `expected`; no more than that is kept in memory.
pub(super) fn exactly(source: impl Read, expected: usize) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    source
        .take(expected as u64 + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| format!("cannot be read or decompressed: {error}"))?;
    match bytes.len() == expected {
        true => Ok(bytes),
        false if bytes.len() > expected => Err(format!("expected {expected} bytes, found more")),
        false => Err(format!("expected {expected} bytes, found {}", bytes.len())),
    }
}

/// The `expected` bytes that zlib compressed.
pub(super) fn inflated(bytes: &[u8], expected: usize) -> Result<Vec<u8>, String> {
    exactly(ZlibDecoder::new(bytes), expected)
}
