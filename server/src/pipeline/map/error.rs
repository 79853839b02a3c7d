//! Why a map refuses a request.

/// Why a map refuses a request.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// There is no map of this name.
    #[error("no map is called {name:?}; GET /v1/maps lists the existing ones")]
    NotFound {
        /// The requested name.
        name: String,
    },
    /// The name is taken.
    #[error("a map called {name:?} is there already")]
    AlreadyExists {
        /// The name.
        name: String,
    },
    /// The name has characters or a length that names cannot have.
    #[error(
        "{name:?} cannot be a map's name: expected 1 to 64 of A-Z a-z 0-9 . _ - and not a dot first"
    )]
    InvalidName {
        /// The given name, cut to the longest permitted length.
        name: String,
    },
    /// `mapper.max_maps` is reached.
    #[error("{limit} maps are there already, as many as mapper.max_maps allows: delete one first")]
    TooMany {
        /// The configured limit.
        limit: usize,
    },
    /// Another stream writes to the map.
    #[error("map {name:?} has another sender: one stream writes a map at a time")]
    Busy {
        /// The map.
        name: String,
    },
    /// The map's thread has stopped.
    #[error("map {name:?} takes no more frames: {reason}")]
    Failed {
        /// The map.
        name: String,
        /// Why.
        reason: String,
    },
}
