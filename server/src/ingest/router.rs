//! The calls of the gRPC port: a mapping service, health and reflection, behind the guard.

use super::config::IngestConfig;
use super::guard::guard;
use super::unfinished::Unfinished;
use crate::access::Gate;
use axum::Router;
use axum::middleware::from_fn_with_state;
use lexsplat_proto::DESCRIPTORS;
use lexsplat_proto::v1::mapping_server::{Mapping, MappingServer};
use std::time::Duration;
use tokio_util::sync::CancellationToken;
use tonic::codec::CompressionEncoding;
use tonic::service::Routes;
use tower::util::MapRequestLayer;

/// Why the gRPC interface does not start.
#[derive(Debug, thiserror::Error)]
pub enum IngestError {
    /// The reflection service does not start.
    #[error("cannot load the descriptors of the gRPC messages")]
    Reflection(#[from] tonic_reflection::server::Error),
}

/// The service with the limits on its messages.
pub(super) fn mapping<S: Mapping>(service: S, config: &IngestConfig) -> MappingServer<S> {
    MappingServer::new(service)
        .max_decoding_message_size(config.max_message_bytes)
        .accept_compressed(CompressionEncoding::Gzip)
        .accept_compressed(CompressionEncoding::Zstd)
}

/// The calls of `service`, with health and reflection, for those whom `gate` lets in.
///
/// # Errors
/// [`IngestError`].
pub(crate) async fn router<S: Mapping>(
    service: S,
    gate: Gate,
    config: &IngestConfig,
    stopping: CancellationToken,
) -> Result<Router, IngestError> {
    let (health, health_service) = tonic_health::server::health_reporter();
    health.set_serving::<MappingServer<S>>().await;
    tokio::spawn(async move {
        stopping.cancelled().await;
        health.set_not_serving::<MappingServer<S>>().await;
    });
    // Most clients still use v1alpha of the reflection service.
    let reflection = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(DESCRIPTORS)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
    };
    let (reflection, v1alpha) = (reflection().build_v1()?, reflection().build_v1alpha()?);
    let timeout = Duration::from_secs(config.message_seconds);
    let unfinished = Unfinished::new(config.max_unfinished_bytes, timeout);
    let watch = move |request: axum::extract::Request| request.map(|body| unfinished.watch(body));
    let routes = Routes::new(health_service)
        .add_service(reflection)
        .add_service(v1alpha)
        .add_service(mapping(service, config));
    let router = routes.into_axum_router().layer(MapRequestLayer::new(watch));
    Ok(router.layer(from_fn_with_state(gate, guard)))
}
