//! Addresses, tokens and certificates of HTTP requests.

use super::error::HttpError;
use crate::access::{Access, AccessError, Identity, innermost};
use reqwest::header::{HeaderMap, HeaderValue};
use reqwest::{Url, header};

/// The address of the server at `HOST:PORT`, `http://HOST:PORT` or `https://HOST:PORT`; a path behind it is
/// where a proxy shows the server.
pub(super) fn base(address: &str) -> Result<Url, HttpError> {
    let wrong = || HttpError::Address { found: address.into() };
    let url = if address.contains("://") { address.into() } else { format!("http://{address}") };
    let mut base = Url::parse(&url).map_err(|_| wrong())?;
    if !["http", "https"].contains(&base.scheme()) || !base.has_host() {
        return Err(wrong());
    }
    base.set_query(None);
    base.set_fragment(None);
    // Paths are put behind it, with or without a slash at its end.
    base.path_segments_mut().expect("an http address has a path").pop_if_empty();
    Ok(base)
}

/// A client that sends the token with each request. It follows no redirection, so that the token goes
/// nowhere else, and takes no proxy: the server is in the local network.
pub(super) fn client(access: &Access) -> Result<reqwest::Client, HttpError> {
    let mut builder =
        reqwest::Client::builder().no_proxy().redirect(reqwest::redirect::Policy::none());
    if let Some(bearer) = access.bearer()? {
        let mut value = HeaderValue::try_from(bearer).map_err(|_| AccessError::Token)?;
        value.set_sensitive(true);
        builder = builder.default_headers(HeaderMap::from_iter([(header::AUTHORIZATION, value)]));
    }
    let wrong = |error: reqwest::Error| AccessError::Certificates(innermost(&error).to_string());
    if let Some(authorities) = &access.authorities {
        builder = builder.tls_built_in_root_certs(false);
        let certificates = reqwest::Certificate::from_pem_bundle(authorities).map_err(wrong)?;
        if certificates.is_empty() {
            return Err(AccessError::Certificates("there is no PEM certificate".into()).into());
        }
        for certificate in certificates {
            builder = builder.add_root_certificate(certificate);
        }
    }
    if let Some(Identity { certificate, key }) = &access.identity {
        let both = [key.as_slice(), b"\n", certificate].concat();
        builder = builder.identity(reqwest::Identity::from_pem(&both).map_err(wrong)?);
    }
    Ok(builder.build().map_err(wrong)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn certificates_that_cannot_be_used_are_refused() {
        for wrong in ["", "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"] {
            let access = Access { authorities: Some(wrong.into()), ..Access::default() };
            let error = client(&access).unwrap_err();
            assert!(matches!(error, HttpError::Access(AccessError::Certificates(_))), "{error}");
        }
        let error = client(&Access::with_token("a b"));
        assert!(matches!(error, Err(HttpError::Access(AccessError::Token))));
    }
}
