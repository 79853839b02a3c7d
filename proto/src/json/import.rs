//! Recordings that are uploaded and mapped.

use serde::{Deserialize, Serialize};

/// Where the poses of an uploaded recording come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum ImportPoses {
    /// From the recording. Frames without a pose are left out.
    Given,
    /// The server tracks the camera.
    Estimated,
}

/// What is done with an uploaded recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum ImportState {
    /// It is being received and opened.
    #[default]
    Receiving,
    /// Its frames are being mapped.
    Mapping,
    /// All frames were mapped that can be.
    Done,
    /// It ended before; `error` says why. The frames so far are in the map.
    Failed,
    /// Somebody stopped it. The frames so far are in the map.
    Stopped,
}

/// An uploaded recording, and how far it is mapped.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct Import {
    pub state: ImportState,
    /// Its layout: "mcap", "tum", "folder" and so on. Absent until it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layout: Option<String>,
    /// Where poses come from. Absent until it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poses: Option<ImportPoses>,
    /// Frames that are to be mapped.
    pub frames_total: u64,
    /// Of these, frames that the map has by now, or that were refused or lost.
    pub frames_done: u64,
    /// Frames that the map had before.
    pub frames_resumed_past: u64,
    /// Frames that did not pass the server's checks.
    pub frames_refused: u64,
    /// Frames that cannot be read, or lack a part.
    pub frames_left_out: u64,
    /// What was assumed because no file says it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Why frames were refused or left out; the first few.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub problems: Vec<String>,
    /// Why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}
