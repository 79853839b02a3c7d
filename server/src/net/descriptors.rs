//! The limit on open files, of which each connection is one.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Files that the server has open besides connections: recordings, libraries, devices.
const BESIDES_CONNECTIONS: u64 = 256;

/// Raises the limit so that both ports can have `connections` each, as far as the system permits.
pub(crate) fn raise_limit(connections: usize) {
    let wanted = BESIDES_CONNECTIONS.saturating_add((connections as u64).saturating_mul(2));
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    if current.is_none_or(|current| current >= wanted) {
        return;
    }
    let possible = maximum.map_or(wanted, |maximum| maximum.min(wanted));
    let raised = setrlimit(Resource::Nofile, Rlimit { current: Some(possible), maximum });
    if raised.is_err() || possible < wanted {
        tracing::warn!(
            limit = getrlimit(Resource::Nofile).current,
            wanted,
            "few files can be open at a time, so that fewer connections than connections.max are possible: \
             raise the limit (ulimit -n, or LimitNOFILE= of systemd)"
        );
    }
}
