//! Who is at the other end of a connection.

use rustls::pki_types::CertificateDer;
use std::net::IpAddr;
use std::sync::Arc;
use webpki::EndEntityCert;

/// The other end of a connection. It is in the extensions of each request.
#[derive(Clone, Debug, Default)]
pub(crate) struct Peer {
    /// Where the connection comes from; `None` inside of tests.
    pub(crate) address: Option<IpAddr>,
    /// Whether the connection is encrypted.
    pub(crate) is_encrypted: bool,
    /// The DNS names in the client certificate, if the client showed one that is believed.
    pub(crate) names: Arc<[String]>,
}

impl Peer {
    /// The peer of a connection that is not encrypted.
    pub(super) fn at(address: IpAddr) -> Self {
        Self { address: Some(address), ..Self::default() }
    }

    /// The peer of an encrypted connection, with the certificates that it showed.
    pub(super) fn with_certificates(
        address: IpAddr,
        certificates: Option<&[CertificateDer<'_>]>,
    ) -> Self {
        let own = certificates.and_then(|chain| EndEntityCert::try_from(chain.first()?).ok());
        let names = own.iter().flat_map(|own| own.valid_dns_names()).map(str::to_owned);
        Self { address: Some(address), is_encrypted: true, names: names.collect() }
    }
}
