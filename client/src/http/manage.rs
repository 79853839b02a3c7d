//! Maps as a whole: listing, renaming, deleting, saving and restoring them, and waiting until one is settled
//! (no frame waits and its optimisation is done) or has been refined.

use super::client::HttpClient;
use super::error::HttpError;
use lexsplat_proto::json::{Maps, NewMap, Restored, Status};
use reqwest::header;
use std::time::{Duration, Instant};

/// A map without a new revision for so long has stalled.
const STALLED: Duration = Duration::from_secs(180);
const POLL: Duration = Duration::from_millis(250);
/// One request for a map that has converged waits so long.
const CONVERGING_SECONDS: u64 = 10;

impl HttpClient {
    /// All maps, also those that are being loaded.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn maps(&self) -> Result<Vec<Status>, HttpError> {
        let maps: Maps = self.json(self.client.get(self.path(&["v1", "maps"]))).await?;
        Ok(maps.maps)
    }

    /// Gives a map another name; its status while it is loaded again.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn rename(&self, map: &str, to: &str) -> Result<Status, HttpError> {
        let name = NewMap { name: to.to_owned() };
        self.json(self.client.patch(self.url(map, &[])).json(&name)).await
    }

    /// Deletes a map.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn delete(&self, map: &str) -> Result<(), HttpError> {
        self.send(self.client.delete(self.url(map, &[]))).await.map(drop)
    }

    /// The recording and the newest checkpoint of a map as one file, part by part.
    ///
    /// # Errors
    /// See [`Self::status`]; and what `write` returns.
    pub async fn backup<E: From<HttpError>>(
        &self,
        map: &str,
        mut write: impl FnMut(&[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut response = self.send(self.client.get(self.url(map, &["backup"]))).await?;
        while let Some(part) = response.chunk().await.map_err(|error| self.lost(&error))? {
            write(&part)?;
        }
        Ok(())
    }

    /// Puts a backup in place as a map whose name is free.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn restore(&self, map: &str, backup: tokio::fs::File) -> Result<Restored, HttpError> {
        let put = self.client.put(self.url(map, &["backup"]));
        self.json(put.header(header::CONTENT_TYPE, "application/x-tar").body(backup)).await
    }

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
