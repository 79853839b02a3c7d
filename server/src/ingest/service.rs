//! The `lexsplat.v1.Mapping` service and its gRPC server.

use super::config::IngestConfig;
use super::context::Context;
use super::{maps, query, status, stream};
use crate::maps::RecordedMaps;
use lexsplat_proto::v1::mapping_server::{Mapping, MappingServer};
use lexsplat_proto::{DESCRIPTORS, v1};
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;
use tonic::codec::CompressionEncoding;
use tonic::transport::server::TcpIncoming;
use tonic::{Request, Response, Status, Streaming};

/// Open calls allowed on one connection.
const MAX_CALLS_PER_CONNECTION: u32 = 64;
/// HTTP/2 flow-control window of a stream, bytes: about one uncompressed frame.
const STREAM_WINDOW_BYTES: u32 = 4 << 20;

/// Why the gRPC server stopped.
#[derive(Debug, thiserror::Error)]
pub enum IngestError {
    /// The reflection service does not start.
    #[error("cannot load the descriptors of the gRPC messages")]
    Reflection(#[from] tonic_reflection::server::Error),
    /// The transport failed.
    #[error("the gRPC listener failed")]
    Transport(#[from] tonic::transport::Error),
}

/// The `lexsplat.v1.Mapping` service.
#[derive(Clone)]
pub(crate) struct MappingService(Context);

impl MappingService {
    /// Serves `maps`; streams end when `stopping` is cancelled.
    pub(crate) fn new(
        maps: RecordedMaps,
        config: &IngestConfig,
        stopping: CancellationToken,
    ) -> Self {
        let (limits, config) = (config.limits(), Arc::new(config.clone()));
        Self(Context { maps, config, limits, stopping })
    }

    /// Serves until the token is cancelled and every call has ended.
    ///
    /// # Errors
    /// [`IngestError`].
    pub(crate) async fn serve(self, listener: TcpListener) -> Result<(), IngestError> {
        let (health, health_service) = tonic_health::server::health_reporter();
        health.set_serving::<MappingServer<Self>>().await;
        // Most clients still use v1alpha of the reflection service.
        let reflection = || {
            tonic_reflection::server::Builder::configure()
                .register_encoded_file_descriptor_set(DESCRIPTORS)
                .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
        };
        let (reflection, v1alpha) = (reflection().build_v1()?, reflection().build_v1alpha()?);
        let config = self.0.config.clone();
        let stopping = self.0.stopping.clone();
        let mapping = MappingServer::new(self)
            .max_decoding_message_size(config.max_message_bytes)
            .accept_compressed(CompressionEncoding::Gzip)
            .accept_compressed(CompressionEncoding::Zstd);
        tonic::transport::Server::builder()
            .http2_keepalive_interval(Some(Duration::from_secs(config.keepalive_seconds)))
            .http2_keepalive_timeout(Some(Duration::from_secs(config.keepalive_timeout_seconds)))
            .max_concurrent_streams(MAX_CALLS_PER_CONNECTION)
            .initial_stream_window_size(STREAM_WINDOW_BYTES)
            .add_service(health_service)
            .add_service(reflection)
            .add_service(v1alpha)
            .add_service(mapping)
            .serve_with_incoming_shutdown(
                TcpIncoming::from(listener).with_nodelay(Some(true)),
                async move {
                    stopping.cancelled().await;
                    health.set_not_serving::<MappingServer<Self>>().await;
                },
            )
            .await?;
        Ok(())
    }
}

#[tonic::async_trait]
impl Mapping for MappingService {
    type StreamFramesStream = ReceiverStream<Result<v1::FrameAck, Status>>;
    type ExportMapStream = ReceiverStream<Result<v1::Chunk, Status>>;

    async fn stream_frames(
        &self,
        request: Request<Streaming<v1::FrameMessage>>,
    ) -> Result<Response<Self::StreamFramesStream>, Status> {
        Ok(Response::new(stream::start(self.0.clone(), request.into_inner())))
    }

    async fn query(
        &self,
        request: Request<v1::QueryRequest>,
    ) -> Result<Response<v1::QueryResponse>, Status> {
        query::answer(&self.0, request.into_inner()).await.map(Response::new)
    }

    async fn create_map(
        &self,
        request: Request<v1::CreateMapRequest>,
    ) -> Result<Response<v1::MapStatus>, Status> {
        maps::create(&self.0, &request.into_inner().name).await.map(Response::new)
    }

    async fn get_map(
        &self,
        request: Request<v1::GetMapRequest>,
    ) -> Result<Response<v1::MapStatus>, Status> {
        let name = request.into_inner().name;
        let map = self.0.maps.get(&name).map_err(|error| status::of_maps(&error, "name"))?;
        Ok(Response::new(maps::wire_status(map.status())))
    }

    async fn list_maps(
        &self,
        _request: Request<v1::ListMapsRequest>,
    ) -> Result<Response<v1::ListMapsResponse>, Status> {
        let maps = self.0.maps.list().into_iter().map(maps::wire_listed).collect();
        Ok(Response::new(v1::ListMapsResponse { maps }))
    }

    async fn delete_map(
        &self,
        request: Request<v1::DeleteMapRequest>,
    ) -> Result<Response<v1::DeleteMapResponse>, Status> {
        let name = request.into_inner().name;
        maps::delete(&self.0, &name).await?;
        Ok(Response::new(v1::DeleteMapResponse {}))
    }

    async fn export_map(
        &self,
        request: Request<v1::ExportRequest>,
    ) -> Result<Response<Self::ExportMapStream>, Status> {
        maps::export(&self.0, request.into_inner()).await
    }
}
