//! The `lexsplat.v1.Mapping` service of a server with maps.

use super::chunks::{Chunks, chunks, fitting};
use super::config::IngestConfig;
use super::context::Context;
use super::guard::{caller, permit};
use super::router::{IngestError, mapping, router};
use super::{maps, query, status, stream};
use crate::access::{Caller, Gate, client_name};
use crate::check::Page;
use crate::maps::RecordedMaps;
use crate::pipeline::query::Client;
use axum::Router;
use axum::http;
use lexsplat_proto::v1;
use lexsplat_proto::v1::mapping_server::Mapping;
use prost::Message as _;
use std::sync::Arc;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;
use tonic::body::Body;
use tonic::{Request, Response, Status, Streaming};
use tower::ServiceExt as _;
use tower::util::BoxCloneSyncService;

/// Calls from inside this process.
pub(crate) type Calls = BoxCloneSyncService<http::Request<Body>, http::Response<Body>, Status>;

/// The `lexsplat.v1.Mapping` service.
#[derive(Clone)]
pub(crate) struct MappingService(Context, Gate);

impl MappingService {
    /// Serves `maps` to those whom `gate` lets in; streams end when `stopping` is cancelled.
    pub(crate) fn new(
        maps: RecordedMaps,
        gate: Gate,
        config: &IngestConfig,
        stopping: CancellationToken,
    ) -> Self {
        let (limits, config) = (config.limits(), Arc::new(config.clone()));
        Self(Context { maps, config, limits, stopping }, gate)
    }

    /// Calls of a caller who was let in already, from inside this process.
    pub(crate) fn called_by(&self, caller: Caller) -> Calls {
        let service = mapping(self.clone(), &self.0.config).map_request(
            move |mut request: http::Request<Body>| {
                request.extensions_mut().insert(caller.clone());
                request
            },
        );
        BoxCloneSyncService::new(service.map_err(|never| match never {}))
    }

    /// The calls, with health and reflection.
    ///
    /// # Errors
    /// [`IngestError`].
    pub(crate) async fn router(self) -> Result<Router, IngestError> {
        let (gate, config, stopping) =
            (self.1.clone(), self.0.config.clone(), self.0.stopping.clone());
        router(self, gate, &config, stopping).await
    }
}

fn client<T>(request: &Request<T>) -> Client {
    Client::new(&client_name(request.extensions()))
}

#[tonic::async_trait]
impl Mapping for MappingService {
    type StreamFramesStream = ReceiverStream<Result<v1::FrameAck, Status>>;
    type QueryChunksStream = Chunks;
    type ExportMapStream = Chunks;

    async fn stream_frames(
        &self,
        request: Request<Streaming<v1::FrameMessage>>,
    ) -> Result<Response<Self::StreamFramesStream>, Status> {
        let caller = caller(&request)?;
        Ok(Response::new(stream::start(
            self.0.terms(),
            self.0.maps.clone(),
            caller,
            request.into_inner(),
        )))
    }

    async fn query(
        &self,
        request: Request<v1::QueryRequest>,
    ) -> Result<Response<v1::QueryResponse>, Status> {
        permit(&caller(&request)?, &request.get_ref().map, "map")?;
        let answer = query::answer(&self.0, &client(&request), request.into_inner()).await?;
        Ok(Response::new(fitting(answer)))
    }

    async fn query_chunks(
        &self,
        request: Request<v1::QueryRequest>,
    ) -> Result<Response<Self::QueryChunksStream>, Status> {
        permit(&caller(&request)?, &request.get_ref().map, "map")?;
        let answer = query::answer(&self.0, &client(&request), request.into_inner()).await?;
        Ok(Response::new(chunks(answer.encode_to_vec())))
    }

    async fn create_map(
        &self,
        request: Request<v1::CreateMapRequest>,
    ) -> Result<Response<v1::MapStatus>, Status> {
        permit(&caller(&request)?, &request.get_ref().name, "name")?;
        maps::create(&self.0, &request.into_inner().name).await.map(Response::new)
    }

    async fn get_map(
        &self,
        request: Request<v1::GetMapRequest>,
    ) -> Result<Response<v1::MapStatus>, Status> {
        permit(&caller(&request)?, &request.get_ref().name, "name")?;
        let name = request.into_inner().name;
        let map = self.0.maps.loaded(&name).await;
        let map = map.map_err(|error| status::of_maps(&error, "name"))?;
        Ok(Response::new(maps::wire_status(map.status())))
    }

    async fn list_maps(
        &self,
        request: Request<v1::ListMapsRequest>,
    ) -> Result<Response<v1::ListMapsResponse>, Status> {
        let caller = caller(&request)?;
        let v1::ListMapsRequest { limit, after } = request.into_inner();
        let page = Page::new(limit, after).map_err(|refusal| status::refused(&refusal))?;
        let seen = self.0.maps.list().into_iter().filter(|map| caller.sees(map.name()));
        let (maps, next) = page.of(seen, |map| map.name().to_owned());
        let maps = maps.into_iter().map(maps::wire_listed).collect();
        Ok(Response::new(v1::ListMapsResponse { maps, next }))
    }

    async fn rename_map(
        &self,
        request: Request<v1::RenameMapRequest>,
    ) -> Result<Response<v1::RenameMapResponse>, Status> {
        let caller = caller(&request)?;
        permit(&caller, &request.get_ref().name, "name")?;
        permit(&caller, &request.get_ref().new_name, "new_name")?;
        let v1::RenameMapRequest { name, new_name } = request.into_inner();
        maps::rename(&self.0, &name, &new_name).await?;
        Ok(Response::new(v1::RenameMapResponse {}))
    }

    async fn delete_map(
        &self,
        request: Request<v1::DeleteMapRequest>,
    ) -> Result<Response<v1::DeleteMapResponse>, Status> {
        let caller = caller(&request)?;
        permit(&caller, &request.get_ref().name, "name")?;
        let name = request.into_inner().name;
        maps::delete(&self.0, &name).await?;
        tracing::info!(map = name, caller = caller.name(), "a map was deleted");
        Ok(Response::new(v1::DeleteMapResponse {}))
    }

    async fn export_map(
        &self,
        request: Request<v1::ExportRequest>,
    ) -> Result<Response<Self::ExportMapStream>, Status> {
        permit(&caller(&request)?, &request.get_ref().map, "map")?;
        maps::export(&self.0, &client(&request), request.into_inner()).await
    }
}
