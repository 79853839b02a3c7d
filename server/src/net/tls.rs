//! TLS 1.2 and 1.3 by rustls, with certificates that can be replaced while the server runs.

use super::config::TlsConfig;
use crate::file_watch::FileWatch;
use rustls::crypto::ring;
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::WebPkiClientVerifier;
use rustls::server::danger::ClientCertVerifier;
use rustls::{RootCertStore, ServerConfig};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use tokio_util::sync::CancellationToken;

/// HTTP/2, as TLS names it.
const HTTP2: &[u8] = b"h2";
/// HTTP/1.1.
const HTTP1: &[u8] = b"http/1.1";

/// Why certificates cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A file cannot be read or has no PEM of the right kind.
    #[error("{key}: cannot use {}: {reason}", path.display())]
    File {
        /// Key of the settings.
        key: &'static str,
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// Certificate and key do not fit.
    #[error("server.tls: certificate and key cannot be used together: {0}")]
    Pair(#[from] rustls::Error),
}

/// The server's certificate and keys, as they are now. Cheap to clone.
#[derive(Clone)]
pub(crate) struct Tls(Arc<Shared>);

struct Shared {
    config: TlsConfig,
    current: RwLock<Arc<ServerConfig>>,
    /// Until somebody follows the files.
    watch: Mutex<Option<FileWatch>>,
}

impl Tls {
    /// Reads the files.
    ///
    /// # Errors
    /// [`TlsError`].
    pub(crate) fn new(config: TlsConfig) -> Result<Self, TlsError> {
        let paths = [Some(&config.certificate), Some(&config.key), config.client_ca.as_ref()];
        let watch = FileWatch::new(paths.into_iter().flatten().cloned().collect());
        let current = RwLock::new(Arc::new(load(&config)?));
        Ok(Self(Arc::new(Shared { config, current, watch: Mutex::new(Some(watch)) })))
    }

    /// What the next connection uses: HTTP/2, and HTTP/1 too unless it is for gRPC.
    pub(super) fn current(&self, is_grpc: bool) -> Arc<ServerConfig> {
        let current = self.0.current.read().unwrap_or_else(PoisonError::into_inner).clone();
        let mut config = ServerConfig::clone(&current);
        config.alpn_protocols = vec![HTTP2.into()];
        if !is_grpc {
            config.alpn_protocols.push(HTTP1.into());
        }
        Arc::new(config)
    }

    /// Reads the files again whenever one changes, until `stopping` is cancelled. Files that cannot
    /// be used change nothing. Open connections keep what they began with.
    pub(crate) async fn follow_files(self, stopping: CancellationToken) {
        let watch = self.0.watch.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(watch) = watch else { return };
        let reload = move || match load(&self.0.config) {
            Ok(config) => {
                tracing::info!("the certificates were read again");
                *self.0.current.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(config);
            }
            Err(error) => {
                tracing::error!(%error, "the certificates changed and are not used: the old ones stay");
            }
        };
        watch.follow(reload, stopping).await;
    }
}

fn load(config: &TlsConfig) -> Result<ServerConfig, TlsError> {
    let TlsConfig { certificate, key, client_ca } = config;
    let chain = certificates("server.tls.certificate", certificate)?;
    let key = PrivateKeyDer::from_pem_file(key).map_err(|error| TlsError::File {
        key: "server.tls.key",
        path: key.clone(),
        reason: error.to_string(),
    })?;
    let provider = Arc::new(ring::default_provider());
    let builder =
        ServerConfig::builder_with_provider(provider).with_safe_default_protocol_versions()?;
    let builder = match client_ca {
        None => builder.with_no_client_auth(),
        Some(path) => builder.with_client_cert_verifier(verifier(path)?),
    };
    Ok(builder.with_single_cert(chain, key)?)
}

/// Believes client certificates of these authorities. Clients without one may have a token.
fn verifier(path: &Path) -> Result<Arc<dyn ClientCertVerifier>, TlsError> {
    const KEY: &str = "server.tls.client_ca";
    let wrong = |reason: String| TlsError::File { key: KEY, path: path.into(), reason };
    let mut roots = RootCertStore::empty();
    for certificate in certificates(KEY, path)? {
        roots.add(certificate).map_err(|error| wrong(error.to_string()))?;
    }
    let provider = Arc::new(ring::default_provider());
    let builder = WebPkiClientVerifier::builder_with_provider(Arc::new(roots), provider);
    builder.allow_unauthenticated().build().map_err(|error| wrong(error.to_string()))
}

fn certificates(key: &'static str, path: &Path) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    let wrong = |reason: String| TlsError::File { key, path: path.into(), reason };
    let read = CertificateDer::pem_file_iter(path).map_err(|error| wrong(error.to_string()))?;
    let read: Result<Vec<_>, _> = read.collect();
    let read = read.map_err(|error| wrong(error.to_string()))?;
    match read.is_empty() {
        true => Err(wrong("it has no PEM certificate".into())),
        false => Ok(read),
    }
}
