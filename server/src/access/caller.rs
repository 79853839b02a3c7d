//! Who made a call, and whether they may.

use super::entry::{Entry, Maps};
use super::scope::Scope;
use crate::net::Peer;
use axum::http::Extensions;
use tokio_util::sync::CancellationToken;

/// Why a call is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum AccessError {
    /// Nobody said who they are.
    #[error("this server asks who is calling: send `authorization: Bearer TOKEN`")]
    NoToken,
    /// The token is not in the tokens file.
    #[error("the token is not known to this server: it is wrong, or was withdrawn")]
    UnknownToken,
    /// The caller is known, and lacks a scope.
    #[error("{caller:?} lacks the scope {scope}")]
    Scope {
        /// Name of the caller.
        caller: String,
        /// What the call needs.
        scope: Scope,
    },
    /// The caller may not use this map, whether or not it exists.
    #[error("{caller:?} may not use the map {map:?}")]
    Map {
        /// Name of the caller.
        caller: String,
        /// The map that they named.
        map: String,
    },
    /// The call is about all maps.
    #[error("this is about all maps, and {caller:?} may use some only")]
    SomeMaps {
        /// Name of the caller.
        caller: String,
    },
}

impl AccessError {
    /// Whether the caller is not known at all.
    pub(crate) fn is_unknown(&self) -> bool {
        matches!(self, Self::NoToken | Self::UnknownToken)
    }
}

/// Who made a call. It is in the extensions of each request that was let in.
#[derive(Clone, Debug)]
pub(crate) struct Caller {
    name: String,
    scopes: Vec<Scope>,
    maps: Maps,
    withdrawn: CancellationToken,
    /// False where nobody is asked.
    is_known: bool,
}

/// A name for whoever makes a request: the caller's, or the address where nobody is asked.
pub(crate) fn client_name(extensions: &Extensions) -> String {
    let caller = extensions.get::<Caller>().filter(|caller| caller.is_known);
    let address = || extensions.get::<Peer>()?.address;
    match caller {
        Some(caller) => caller.name.clone(),
        None => address().map_or_else(String::new, |address| address.to_string()),
    }
}

impl Caller {
    /// Whoever it is, where nobody is asked: may do everything.
    pub(super) fn anybody() -> Self {
        Self {
            name: "anybody".into(),
            scopes: Scope::ALL.into(),
            maps: Maps::every(),
            withdrawn: CancellationToken::new(),
            is_known: false,
        }
    }

    pub(super) fn of(entry: &Entry) -> Self {
        let Entry { name, scopes, maps, withdrawn, .. } = entry.clone();
        Self { name, scopes, maps, withdrawn, is_known: true }
    }

    /// The name in the tokens file.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Waits until the caller's line in the tokens file is removed or changed. Calls that go on for
    /// long end then.
    pub(crate) async fn withdrawn(&self) {
        self.withdrawn.cancelled().await;
    }

    /// Whether the map may be seen in lists.
    pub(crate) fn sees(&self, map: &str) -> bool {
        self.maps.contain(map)
    }

    /// # Errors
    /// [`AccessError::Scope`].
    pub(crate) fn needs(&self, scope: Scope) -> Result<(), AccessError> {
        match self.scopes.contains(&scope) {
            true => Ok(()),
            false => Err(AccessError::Scope { caller: self.name.clone(), scope }),
        }
    }

    /// # Errors
    /// [`AccessError::Map`].
    pub(crate) fn may_use(&self, map: &str) -> Result<(), AccessError> {
        match self.maps.contain(map) {
            true => Ok(()),
            false => Err(AccessError::Map { caller: self.name.clone(), map: map.into() }),
        }
    }

    /// # Errors
    /// [`AccessError::SomeMaps`].
    pub(crate) fn may_use_all(&self) -> Result<(), AccessError> {
        match self.maps.are_all() {
            true => Ok(()),
            false => Err(AccessError::SomeMaps { caller: self.name.clone() }),
        }
    }
}
