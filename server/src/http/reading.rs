//! Reading a map over HTTP: what a request waits for, and headers that say what a file is of.

use super::error::Problem;
use crate::check;
use crate::pipeline::map::{Map, Reading};
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use serde::Deserialize;
use utoipa::IntoParams;

/// The options of a request that may wait.
#[derive(Clone, Debug, Default, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(default, deny_unknown_fields)]
pub(super) struct WaitOptions {
    /// "settled": wait until the map has done its work on all frames that were acknowledged. "converged":
    /// wait until it has also been refined.
    pub(super) wait: Option<String>,
    /// Wait until the map has this frame.
    pub(super) min_sequence: Option<u64>,
    /// Wait at most so long, 0 to 600 seconds; 30 if absent. Then the request gets what there is, which
    /// the answer says.
    pub(super) wait_seconds: Option<f64>,
}

impl WaitOptions {
    /// Reads a map as the options say.
    ///
    /// # Errors
    /// Status 400 for a wrong option.
    pub(super) async fn read(&self, map: &Map) -> Result<Reading, Problem> {
        let wait = check::wait(self.wait.as_deref(), self.min_sequence, self.wait_seconds)?;
        Ok(map.read(&wait).await)
    }
}

/// Headers that say what a file is of: `lexsplat-revision`, `lexsplat-through` (the newest frame, if there is
/// one), `lexsplat-settled` and `lexsplat-converged` (true or false).
pub(super) fn headers(reading: &Reading) -> HeaderMap {
    let Reading { snapshot, settled, converged } = reading;
    let through = snapshot.through.map(|through| ("lexsplat-through", through.to_string()));
    let always = [
        ("lexsplat-revision", snapshot.revision.to_string()),
        ("lexsplat-settled", settled.to_string()),
        ("lexsplat-converged", converged.to_string()),
    ];
    let header = |(name, value): (&'static str, String)| {
        let value = HeaderValue::from_str(&value).expect("numbers and words");
        (HeaderName::from_static(name), value)
    };
    always.into_iter().chain(through).map(header).collect()
}
