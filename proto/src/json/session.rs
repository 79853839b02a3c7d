//! Logging a browser in.

use serde::{Deserialize, Serialize};

/// The token of a caller, which becomes a cookie. It has no `Debug`, so that no log shows it.
#[derive(Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Login {
    /// The token that `lexsplat-server token` printed.
    pub token: String,
}
