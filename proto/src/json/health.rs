//! The server's health.

use super::map::LoadProgress;
use serde::{Deserialize, Serialize};

/// State and versions of the server.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Health {
    /// "alive" or "ready".
    pub status: String,
    /// The GPU adapter that renders.
    pub adapter: String,
    /// Name of the model bundle.
    pub bundle: String,
    /// Version of the server.
    pub version: String,
    /// What is wrong with recordings of maps; left out if nothing is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Maps that are loaded after the start, or wait for it; left out if there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub loading: Vec<MapLoading>,
}

/// A map that is being loaded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct MapLoading {
    /// Its name.
    pub map: String,
    /// How far it is loaded.
    #[serde(flatten)]
    pub progress: LoadProgress,
}
