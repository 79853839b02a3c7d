//! What a recording may take of the disk.

use super::config::ImportsConfig;
use super::error::ImportError;
use std::fs::File;
use std::io::{Read, Write as _};
use std::path::Path;
use tokio_util::sync::CancellationToken;

/// Bytes that are copied at once, and between two looks at the free space.
const BLOCK: usize = 1 << 20;
const LOOK_EVERY: u64 = 64 << 20;

/// The limits of a recording's files.
pub(super) struct Room {
    pub limits: ImportsConfig,
    /// Bytes that must stay free on the disk.
    pub kept_free: u64,
    /// Cancelled when somebody stops the import.
    pub stop: CancellationToken,
}

impl Room {
    /// Writes a new file of at most so many bytes; returns how many it has. `failed` turns errors of reading.
    ///
    /// # Errors
    /// [`ImportError`].
    pub(super) fn copy(
        &self,
        from: &mut impl Read,
        to: &Path,
        most: u64,
        failed: impl Fn(&std::io::Error) -> ImportError,
    ) -> Result<u64, ImportError> {
        let mut file = File::create_new(to).map_err(ImportError::Io)?;
        let (mut block, mut bytes, mut looked) = (vec![0; BLOCK], 0, None);
        loop {
            let read = from.read(&mut block).map_err(|error| failed(&error))?;
            if read == 0 {
                return Ok(bytes);
            }
            if self.stop.is_cancelled() {
                return Err(ImportError::Stopped);
            }
            bytes += read as u64;
            if bytes > most {
                return Err(ImportError::TooLarge { most: self.limits.max_bytes });
            }
            if looked.is_none_or(|at| bytes - at > LOOK_EVERY) {
                self.expect_room(to)?;
                looked = Some(bytes);
            }
            file.write_all(&block[..read]).map_err(ImportError::Io)?;
        }
    }

    fn expect_room(&self, file: &Path) -> Result<(), ImportError> {
        let disk = rustix::fs::statvfs(file).map_err(|error| ImportError::Io(error.into()))?;
        let (free, kept) = (disk.f_bavail.saturating_mul(disk.f_frsize), self.kept_free);
        if free < kept.saturating_add(LOOK_EVERY) {
            return Err(ImportError::NoRoom { free, kept });
        }
        Ok(())
    }
}
