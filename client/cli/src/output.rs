//! What commands say: results on standard output, notes on standard error.
//!
//! Whoever reads may stop before everything is said (`lexsplat maps ls | head -1`). Then a command ends,
//! and no panic does: servers that it started are stopped. Results are said by `say!` and `say_part!`,
//! which can fail; notes by `note!`, which does not matter if nobody reads it.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write as _};
use std::path::Path;

/// Says a line on standard output.
macro_rules! say {
    ($($part:tt)*) => { $crate::output::write(format_args!("{}\n", format_args!($($part)*))) };
}

/// Says something on standard output that has its ends of lines.
macro_rules! say_part {
    ($($part:tt)*) => { $crate::output::write(format_args!($($part)*)) };
}

/// Says a line on standard error.
macro_rules! note {
    ($($part:tt)*) => { $crate::output::note(format_args!($($part)*)) };
}

/// Why standard output takes no more.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// Its reader has gone; that is no failure.
    #[error("nobody reads standard output any more")]
    Closed,
    /// It cannot be written.
    #[error("cannot write to standard output")]
    Failed(#[source] io::Error),
}

impl From<io::Error> for OutputError {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            ErrorKind::BrokenPipe => Self::Closed,
            _ => Self::Failed(error),
        }
    }
}

/// Writes text to standard output.
///
/// # Errors
/// [`OutputError`].
pub fn write(text: Arguments<'_>) -> Result<(), OutputError> {
    let mut output = io::stdout().lock();
    output.write_fmt(text)?;
    Ok(output.flush()?)
}

/// Writes a part of a file to standard output.
///
/// # Errors
/// [`OutputError`].
pub fn bytes(part: &[u8]) -> Result<(), OutputError> {
    let mut output = io::stdout().lock();
    output.write_all(part)?;
    Ok(output.flush()?)
}

/// Whether a file that is to be written is `-`: standard output.
pub fn is_standard(file: &Path) -> bool {
    file.as_os_str() == "-"
}

/// Writes a line to standard error, if somebody reads it.
pub fn note(text: Arguments<'_>) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// Whether a command only ended because its reader had enough.
pub fn was_enough(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| matches!(cause.downcast_ref(), Some(OutputError::Closed)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_reader_that_left_is_no_failure() {
        let of = |kind: ErrorKind| anyhow::Error::from(OutputError::from(io::Error::from(kind)));
        assert!(was_enough(&of(ErrorKind::BrokenPipe).context("while listing")));
        assert!(!was_enough(&of(ErrorKind::StorageFull)));
        // A connection to a server that breaks is a failure.
        assert!(!was_enough(&anyhow::Error::from(io::Error::from(ErrorKind::BrokenPipe))));
        assert!(is_standard(Path::new("-")) && !is_standard(Path::new("./-")));
    }
}
