//! Connecting to a gRPC server, with or without TLS, and sending the token with each call.

use super::error::ClientError;
use crate::access::{Access, AccessError, Identity, innermost, is_refused};
use lexsplat_proto::v1::mapping_client::MappingClient;
use std::time::Duration;
use tonic::body::Body;
use tonic::codegen::http;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Certificate, ClientTlsConfig, Endpoint};
use tonic::{Request, Status};
use tower::ServiceExt as _;
use tower::util::BoxCloneSyncService;

const CONNECT_WITHIN: Duration = Duration::from_secs(5);

/// Where calls go: a server, or a service in this process.
pub type Connection = BoxCloneSyncService<http::Request<Body>, http::Response<Body>, Status>;

/// Adds the token to each call.
#[derive(Clone)]
struct Bearer(Option<MetadataValue<Ascii>>);

impl Interceptor for Bearer {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(bearer) = &self.0 {
            request.metadata_mut().insert("authorization", bearer.clone());
        }
        Ok(request)
    }
}

impl Bearer {
    fn new(access: &Access) -> Result<Self, AccessError> {
        let Some(bearer) = access.bearer()? else { return Ok(Self(None)) };
        let mut value = MetadataValue::try_from(bearer).map_err(|_| AccessError::Token)?;
        value.set_sensitive(true);
        Ok(Self(Some(value)))
    }
}

/// A client of the server at `HOST:PORT`, `http://HOST:PORT` or `https://HOST:PORT`.
pub(super) async fn connect(
    address: &str,
    access: &Access,
) -> Result<MappingClient<Connection>, ClientError> {
    let bad = || ClientError::Address { found: address.into() };
    let (_, port) = address.rsplit_once(':').ok_or_else(bad)?;
    port.trim_end_matches('/').parse::<u16>().map_err(|_| bad())?;
    let url = if address.contains("://") { address.into() } else { format!("http://{address}") };
    let mut endpoint =
        Endpoint::from_shared(url).map_err(|_| bad())?.connect_timeout(CONNECT_WITHIN);
    let encrypted = match endpoint.uri().scheme_str() {
        Some("https") => true,
        Some("http") => false,
        _ => return Err(bad()),
    };
    if encrypted {
        let wrong = |error| AccessError::Certificates(innermost(&error).to_string());
        endpoint = endpoint.tls_config(tls(access)).map_err(wrong)?;
    }
    let bearer = Bearer::new(access)?;
    let channel = endpoint.connect().await.map_err(|error| {
        let (address, reason) = (address.to_owned(), innermost(&error));
        match encrypted && !is_refused(reason) {
            true => ClientError::Tls { address, reason: reason.to_string() },
            false => ClientError::NoServer { address },
        }
    })?;
    let calls = InterceptedService::new(channel, bearer);
    let calls = calls
        .map_response(|response| response.map(Body::new))
        .map_err(|error| Status::from_error(error.into()));
    Ok(MappingClient::new(BoxCloneSyncService::new(calls)))
}

fn tls(access: &Access) -> ClientTlsConfig {
    let config = match &access.authorities {
        Some(pem) => ClientTlsConfig::new().ca_certificate(Certificate::from_pem(pem)),
        None => ClientTlsConfig::new().with_native_roots(),
    };
    match &access.identity {
        Some(Identity { certificate, key }) => {
            config.identity(tonic::transport::Identity::from_pem(certificate, key))
        }
        None => config,
    }
}
