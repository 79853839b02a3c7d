//! Waiting until a map is settled: no frame waits and its optimisation is done. Or until it has also been
//! refined.

use super::client::HttpClient;
use super::error::HttpError;
use lexsplat_proto::json::Status;
use std::time::{Duration, Instant};

/// A map without a new revision for so long has stalled.
const STALLED: Duration = Duration::from_secs(180);
const POLL: Duration = Duration::from_millis(250);
/// One request for a map that has converged waits so long.
const CONVERGING_SECONDS: u64 = 10;

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

    /// Waits until the map has been refined; calls `on_status` with a status now and then before that. A
    /// map that is never refined is only waited for until it is settled.
    ///
    /// # Errors
    /// As [`Self::settled`].
    pub async fn converged(
        &self,
        map: &str,
        mut on_status: impl FnMut(&Status),
    ) -> Result<Status, HttpError> {
        let client = self.clone().waiting(CONVERGING_SECONDS).until_converged();
        loop {
            let of = client.trajectory(map).await?.of;
            let status = self.status(map).await?;
            if let Some(reason) = status.failure {
                return Err(HttpError::MapFailed { reason });
            }
            if of.converged {
                return Ok(status);
            }
            on_status(&status);
        }
    }
}
