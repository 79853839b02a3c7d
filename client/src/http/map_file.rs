//! Files of a map, and the state of the map that they are of.

use reqwest::header::HeaderMap;

/// A file of a map, and what it is of.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MapFile {
    /// The contents.
    pub bytes: Vec<u8>,
    /// What they are of.
    pub of: ReadOf,
}

/// The state of the map that an answer or a file is of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOf {
    /// Revision of the map.
    pub revision: u64,
    /// The newest frame that it had.
    pub through: Option<u64>,
    /// Whether it had done its work on all frames that it had received.
    pub settled: bool,
    /// Whether it had also been refined.
    pub converged: bool,
}

impl ReadOf {
    /// What a file is of, from the headers that came with it.
    pub(super) fn from_headers(headers: &HeaderMap) -> Self {
        let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
        let number = |name| text(name).and_then(|text| text.parse::<u64>().ok());
        Self {
            revision: number("lexsplat-revision").unwrap_or_default(),
            through: number("lexsplat-through"),
            settled: text("lexsplat-settled") == Some("true"),
            converged: text("lexsplat-converged") == Some("true"),
        }
    }
}
