//! Waiting until a map is settled: no frame waits and its optimisation is done.

use super::client::HttpClient;
use super::error::HttpError;
use lexsplat_proto::json::Status;
use std::time::{Duration, Instant};

/// A map without a new revision for so long has stalled.
const STALLED: Duration = Duration::from_secs(180);
const POLL: Duration = Duration::from_millis(250);

impl HttpClient {
    /// Waits until the map is settled; calls `on_status` with every status before that.
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
