//! State that all handlers share.

use super::answer_cache::AnswerCache;
use super::config::HttpConfig;
use super::error::Problem;
use super::event_log::EventLogs;
use super::file_cache::FileCache;
use crate::import::Imports;
use crate::maps::RecordedMaps;
use crate::pipeline::engine::Engine;
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

pub(super) struct Shared {
    pub(super) maps: RecordedMaps,
    pub(super) imports: Imports,
    pub(super) config: HttpConfig,
    /// How long a request's body may take.
    pub(super) body_limit: Duration,
    /// Cancelled when the server stops.
    pub(super) stopping: CancellationToken,
    pub(super) answers: AnswerCache,
    pub(super) event_logs: EventLogs,
    pub(super) last_file: FileCache,
}

pub(super) type State = axum::extract::State<Arc<Shared>>;

impl Shared {
    pub(super) fn engine(&self) -> &Engine {
        self.maps.engine()
    }

    /// Waits for `work`, at most as long as configured.
    ///
    /// # Errors
    /// A problem with status 503 when the time is over.
    pub(super) async fn in_time<T>(&self, work: impl Future<Output = T>) -> Result<T, Problem> {
        let limit = Duration::from_secs(self.config.request_seconds);
        tokio::time::timeout(limit, work)
            .await
            .map_err(|_| Problem::unavailable(format!("no answer within {limit:?}: try again")))
    }
}
