//! Who is at the other end of a connection.

use rustls::pki_types::CertificateDer;
use std::sync::Arc;
use webpki::EndEntityCert;

/// The other end of a connection. It is in the extensions of each request.
#[derive(Clone, Debug, Default)]
pub(crate) struct Peer {
    /// Whether the connection is encrypted.
    pub(crate) is_encrypted: bool,
    /// The DNS names in the client certificate, if the client showed one that is believed.
    pub(crate) names: Arc<[String]>,
}

impl Peer {
    /// The peer of an encrypted connection, with the certificates that it showed.
    pub(super) fn with_certificates(certificates: Option<&[CertificateDer<'_>]>) -> Self {
        let own = certificates.and_then(|chain| EndEntityCert::try_from(chain.first()?).ok());
        let names = own.iter().flat_map(|own| own.valid_dns_names()).map(str::to_owned);
        Self { is_encrypted: true, names: names.collect() }
    }
}
