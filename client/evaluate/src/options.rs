//! What is to be evaluated, and on which server.

use crate::labels::LabelSource;
use crate::lpips::Lpips;
use lexsplat_client::Access;
use lexsplat_client::stream::{Encoder, Poses};
use std::net::IpAddr;
use std::num::NonZeroUsize;

/// The server and the map to make there; a map of this name must not exist.
#[derive(Clone, Debug)]
pub struct Target {
    /// The server's gRPC address, `HOST:PORT`.
    pub grpc: String,
    /// The server's HTTP address, `HOST:PORT`.
    pub http: String,
    /// Token and certificates.
    pub access: Access,
    /// Name of the map.
    pub map: String,
    /// The server's process, if it runs on this machine and is known: its processor time is measured.
    pub process: Option<u32>,
}

impl Target {
    /// Whether the server runs on this machine, as far as its address tells: then the probe of this
    /// machine says something about the server's times.
    pub(crate) fn is_here(&self) -> bool {
        let address = self.http.rsplit_once("//").map_or(&*self.http, |(_, address)| address);
        let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
        let host = host.trim_start_matches('[').trim_end_matches(']');
        host == "localhost" || host.parse().is_ok_and(|address: IpAddr| address.is_loopback())
    }
}

/// What to measure.
#[derive(Debug)]
pub struct Options {
    /// Where the map's poses come from.
    pub poses: Poses,
    /// Where the map's language comes from.
    pub encoder: Encoder,
    /// Every N-th frame is held out: tracked, never a keyframe, and scored. `None`: every
    /// [`HELD_OUT_EVERY`](crate::HELD_OUT_EVERY)-th tracked frame that is no keyframe is scored.
    pub hold_out_every: Option<NonZeroUsize>,
    /// Whether the map is measured after it was refined, not as soon as it is settled.
    pub converged: bool,
    /// The labels that are asked for and scored; `None`: nothing is asked.
    pub labels: Option<LabelSource>,
    /// The network for LPIPS; `None`: LPIPS is not scored.
    pub lpips: Option<Lpips>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_addresses_are_of_this_machine() {
        let is_here = |http: &str| {
            let (grpc, map) = (String::new(), String::new());
            Target { grpc, http: http.into(), access: Access::default(), map, process: None }
                .is_here()
        };
        for here in ["127.0.0.1:8080", "localhost:80", "[::1]:8080", "http://127.0.0.2:1"] {
            assert!(is_here(here), "{here}");
        }
        for elsewhere in ["robots.example.org:8080", "https://10.0.0.7:443", "0.0.0.0:80", ""] {
            assert!(!is_here(elsewhere), "{elsewhere}");
        }
    }
}
