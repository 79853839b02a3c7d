//! Waiting for a map to do its work on what it has. In: a map's name. Out: its status once it is
//! settled, or why it will not be.

use super::{HttpClient, HttpError, Status};
use std::time::{Duration, Instant};

/// A map whose revision stays the same for so long does not go on.
const STALLED: Duration = Duration::from_secs(180);
const POLL: Duration = Duration::from_millis(250);

impl HttpClient {
    /// Waits until the map is settled; `on_status` hears how far it is.
    ///
    /// # Errors
    /// [`HttpError::MapFailed`], [`HttpError::Stalled`] and those of [`Self::status`].
    pub async fn settled(
        &self,
        map: &str,
        mut on_status: impl FnMut(&Status),
    ) -> Result<Status, HttpError> {
        let mut last = (0, Instant::now());
        loop {
            let status = self.status(map).await?;
            if let Some(reason) = status.failure {
                return Err(HttpError::MapFailed { reason });
            }
            if status.settled {
                return Ok(status);
            }
            if status.revision != last.0 {
                last = (status.revision, Instant::now());
            } else if last.1.elapsed() > STALLED {
                return Err(HttpError::Stalled { seconds: STALLED.as_secs() });
            }
            on_status(&status);
            tokio::time::sleep(POLL).await;
        }
    }
}
