//! State that all gRPC calls share.

use super::config::IngestConfig;
use super::stream::Terms;
use crate::check::Limits;
use crate::maps::RecordedMaps;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;

#[derive(Clone)]
pub(super) struct Context {
    pub(super) maps: RecordedMaps,
    pub(super) config: Arc<IngestConfig>,
    pub(super) limits: Limits,
    /// Cancelled when the server stops.
    pub(super) stopping: CancellationToken,
}

impl Context {
    pub(super) fn terms(&self) -> Terms {
        let Self { config, limits, stopping, .. } = self.clone();
        Terms { config, limits, stopping }
    }
}
