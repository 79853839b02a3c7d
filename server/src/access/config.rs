//! Settings of access, section `access`.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Who may call.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AccessConfig {
    /// The tokens file: a line `NAME SCOPES MAPS HASH` for each caller. It is read again when it
    /// changes. Absent, and without `entries`: nobody is asked who they are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tokens: Option<PathBuf>,
    /// Further lines, for example from the environment.
    pub entries: Vec<String>,
    /// Listen on addresses that other machines can reach although nobody is asked who they are.
    pub insecure_no_auth: bool,
    /// What anybody may call who can connect.
    pub public: Vec<Public>,
}

/// Routes and calls that can be open to everybody.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Public {
    /// `GET /healthz` and the gRPC health service.
    Healthz,
    /// `GET /readyz`.
    Readyz,
    /// `GET /metrics`, which names all maps.
    Metrics,
    /// `GET /openapi.json`.
    Openapi,
    /// The gRPC reflection service.
    Reflection,
}

impl Default for AccessConfig {
    fn default() -> Self {
        use Public::{Healthz, Openapi, Readyz, Reflection};
        Self {
            tokens: None,
            entries: Vec::new(),
            insecure_no_auth: false,
            public: vec![Healthz, Readyz, Openapi, Reflection],
        }
    }
}

impl AccessConfig {
    /// Whether callers are asked who they are.
    pub fn asks(&self) -> bool {
        self.tokens.is_some() || !self.entries.is_empty()
    }
}
