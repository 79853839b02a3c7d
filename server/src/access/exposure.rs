//! A server that asks nobody who they are listens for its own machine only.

use super::config::AccessConfig;
use std::net::SocketAddr;

/// The server would be open to other machines.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "other machines can reach {address}, and nobody would be asked who they are: make a token with \
     `lexsplat-server token --name NAME --scope read,write,admin --tokens FILE` and start with --tokens \
     FILE; or say --insecure-no-auth to let everybody in who can connect"
)]
pub struct Exposed {
    /// Where the server would listen.
    pub address: SocketAddr,
}

/// Checks the addresses that the server listens on. Returns the one that is open to everybody who can
/// connect, because the settings say so.
///
/// # Errors
/// [`Exposed`] if one is not of this machine only, nobody is asked who they are, and
/// `access.insecure_no_auth` is not set.
pub fn exposed(
    config: &AccessConfig,
    addresses: &[SocketAddr],
) -> Result<Option<SocketAddr>, Exposed> {
    let outside = addresses.iter().find(|address| !is_own_machine(address));
    match outside {
        Some(&address) if !config.asks() => match config.insecure_no_auth {
            true => Ok(Some(address)),
            false => Err(Exposed { address }),
        },
        _ => Ok(None),
    }
}

/// Whether only programs of this machine can connect.
pub(crate) fn is_own_machine(address: &SocketAddr) -> bool {
    address.ip().to_canonical().is_loopback()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_is_open_without_tokens() {
        let open = AccessConfig::default();
        let asks = AccessConfig { tokens: Some("tokens".into()), ..AccessConfig::default() };
        let insecure = AccessConfig { insecure_no_auth: true, ..AccessConfig::default() };
        let at = |address: &str| -> SocketAddr { address.parse().unwrap() };
        for inside in ["127.0.0.1:1", "127.9.9.9:1", "[::1]:1", "[::ffff:127.0.0.1]:1"] {
            assert_eq!(exposed(&open, &[at(inside)]), Ok(None), "{inside}");
        }
        for outside in ["0.0.0.0:1", "192.168.0.7:1", "[::]:1", "[::ffff:10.0.0.1]:1"] {
            let address = at(outside);
            let both = [at("127.0.0.1:1"), address];
            assert_eq!(exposed(&open, &both), Err(Exposed { address }), "{outside}");
            assert_eq!(exposed(&asks, &both), Ok(None), "{outside}");
            assert_eq!(exposed(&insecure, &both), Ok(Some(address)), "{outside}");
        }
    }
}
