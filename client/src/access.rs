//! How a client says who it is, and which servers it trusts.

use std::error::Error;
use std::{fmt, io};

/// A client's secrets and trust. The default: no token, and the system's certificate authorities.
#[derive(Clone, Default)]
pub struct Access {
    /// The token that `lexsplat-server token` printed.
    pub token: Option<String>,
    /// Certificates of authorities (PEM) that are trusted in place of the system's.
    pub authorities: Option<Vec<u8>>,
    /// A certificate and its key (PEM), for servers that ask for client certificates.
    pub identity: Option<Identity>,
}

/// A client certificate with its key, both PEM.
#[derive(Clone)]
pub struct Identity {
    /// The certificate, followed by the intermediate ones.
    pub certificate: Vec<u8>,
    /// The private key.
    pub key: Vec<u8>,
}

impl Access {
    /// Who has this token.
    pub fn with_token(token: impl Into<String>) -> Self {
        Self { token: Some(token.into()), ..Self::default() }
    }

    /// The value of the header `authorization`; `None` without a token.
    ///
    /// # Errors
    /// If the token has characters that no token has.
    pub(crate) fn bearer(&self) -> Result<Option<String>, AccessError> {
        match &self.token {
            None => Ok(None),
            Some(token)
                if token.is_empty() || !token.bytes().all(|byte| byte.is_ascii_graphic()) =>
            {
                Err(AccessError::Token)
            }
            Some(token) => Ok(Some(format!("Bearer {token}"))),
        }
    }
}

/// Shows what there is, and no secret.
impl fmt::Debug for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Access")
            .field("token", &self.token.as_ref().map(|_| "…"))
            .field("authorities", &self.authorities.as_ref().map(Vec::len))
            .field("identity", &self.identity.as_ref().map(|_| "…"))
            .finish()
    }
}

/// A secret or certificate that cannot be used. No message repeats it.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// The token is malformed.
    #[error("the token is empty, or has spaces or characters that no token has")]
    Token,
    /// The authorities or the client certificate are malformed.
    #[error("cannot use the certificates: {0}")]
    Certificates(String),
}

/// The error at the end of a chain of causes.
pub(crate) fn innermost<'a>(error: &'a (dyn Error + 'static)) -> &'a (dyn Error + 'static) {
    let mut cause = error;
    while let Some(deeper) = cause.source() {
        cause = deeper;
    }
    cause
}

/// Whether it says that nothing listens at an address.
pub(crate) fn is_refused(error: &(dyn Error + 'static)) -> bool {
    let kind = error.downcast_ref::<io::Error>().map(io::Error::kind);
    kind == Some(io::ErrorKind::ConnectionRefused)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_are_not_shown() {
        let identity = Identity { certificate: b"public".into(), key: b"private".into() };
        let access = Access { identity: Some(identity), ..Access::with_token("secret") };
        let shown = format!("{access:?}");
        assert!(!shown.contains("secret") && !shown.contains("private"), "{shown}");
        assert_eq!(access.bearer().unwrap().as_deref(), Some("Bearer secret"));
        for wrong in ["", "two words", "line\n", "é"] {
            let error = Access::with_token(wrong).bearer().unwrap_err().to_string();
            assert!(wrong.is_empty() || !error.contains(wrong), "{error}");
        }
        assert!(Access::default().bearer().unwrap().is_none());
    }
}
