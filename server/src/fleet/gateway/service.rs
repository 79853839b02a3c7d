//! The gRPC calls of a gateway.

use super::super::registry;
use super::directory::NoWorker;
use super::state::{AGE, Gateway, MAX_STALENESS, max_staleness, unloaded};
use crate::check::Page;
use crate::ingest::{self, Terms, caller, of_map, permit, refused, wire_listed};
use crate::pipeline::engine::check_name;
use crate::pipeline::map::MapError;
use lexsplat_proto::v1;
use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_proto::v1::mapping_server::Mapping;
use std::collections::BTreeMap;
use std::time::Duration;
use tokio_stream::wrappers::ReceiverStream;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::transport::Channel;
use tonic::{Request, Response, Status, Streaming};

/// How long a worker may take to list its maps.
const LIST: Duration = Duration::from_secs(2);

/// The `lexsplat.v1.Mapping` service of a gateway.
#[derive(Clone)]
pub(crate) struct GatewayService {
    gateway: Gateway,
    terms: Terms,
}

impl GatewayService {
    pub(crate) fn new(gateway: Gateway, terms: Terms) -> Self {
        Self { gateway, terms }
    }

    /// A client of the worker to ask about a map, and how old is what it answers from.
    async fn client<T>(
        &self,
        map: &str,
        field: &str,
        request: &Request<T>,
    ) -> Result<(MappingClient<Channel>, Option<Duration>), Status> {
        let staleness = request.metadata().get(MAX_STALENESS);
        let staleness = staleness.map(|value| value.to_str().unwrap_or_default());
        let staleness = max_staleness(staleness).map_err(Status::invalid_argument)?;
        let worker = self.gateway.directory.asked(map, staleness).await;
        let worker = worker.map_err(|error| no_worker(&error, field))?;
        let channel = self.gateway.directory.channel(&worker.grpc);
        let channel = channel.map_err(|error| Status::internal(error.to_string()))?;
        let client = MappingClient::new(channel)
            .max_decoding_message_size(usize::MAX)
            .max_encoding_message_size(usize::MAX);
        Ok((client, worker.age))
    }

    /// Statuses of the maps of all workers, by name, as the caller with this token may see them.
    async fn statuses(
        &self,
        token: Option<&MetadataValue<Ascii>>,
    ) -> BTreeMap<String, v1::MapStatus> {
        let directory = &self.gateway.directory;
        let asked = directory.workers().into_iter().map(|(grpc, http)| async move {
            let mut client = MappingClient::new(directory.channel(&grpc).ok()?);
            let mut request = Request::new(v1::ListMapsRequest::default());
            if let Some(token) = token {
                request.metadata_mut().insert("authorization", token.clone());
            }
            let listed = tokio::time::timeout(LIST, client.list_maps(request)).await.ok()?;
            let mut listed = listed.ok()?.into_inner().maps;
            // It may have copies of others' maps.
            listed.retain(|map| directory.is_owner(&http, &map.name));
            Some(listed)
        });
        let listed = futures::future::join_all(asked).await.into_iter().flatten().flatten();
        listed.map(|status| (status.name.clone(), status)).collect()
    }
}

fn no_worker(error: &NoWorker, field: &str) -> Status {
    match error {
        NoWorker::NoMap { map } => of_map(&MapError::NotFound { name: map.clone() }, field),
        NoWorker::Loading { .. } | NoWorker::Nobody { .. } => {
            Status::unavailable(error.to_string())
        }
    }
}

/// The same request for a worker, in the name of the caller.
fn onward<T>(request: Request<T>) -> Request<T> {
    let (metadata, _, message) = request.into_parts();
    let mut onward = Request::new(message);
    for name in ["authorization", "grpc-timeout"] {
        if let Some(value) = metadata.get(name) {
            onward.metadata_mut().insert(name, value.clone());
        }
    }
    onward
}

/// The answer with the age of the checkpoint that it is from.
fn aged<T>(mut answer: Response<T>, age: Option<Duration>) -> Response<T> {
    if let Some(age) = age {
        answer.metadata_mut().insert(AGE, age.as_secs().into());
    }
    answer
}

#[tonic::async_trait]
impl Mapping for GatewayService {
    type StreamFramesStream = ReceiverStream<Result<v1::FrameAck, Status>>;
    type QueryChunksStream = Streaming<v1::Chunk>;
    type ExportMapStream = Streaming<v1::Chunk>;

    async fn stream_frames(
        &self,
        request: Request<Streaming<v1::FrameMessage>>,
    ) -> Result<Response<Self::StreamFramesStream>, Status> {
        let caller = caller(&request)?;
        let (terms, gateway) = (self.terms.clone(), self.gateway.clone());
        Ok(Response::new(ingest::start(terms, gateway, caller, request.into_inner())))
    }

    async fn query(
        &self,
        request: Request<v1::QueryRequest>,
    ) -> Result<Response<v1::QueryResponse>, Status> {
        permit(&caller(&request)?, &request.get_ref().map, "map")?;
        let (mut client, age) = self.client(&request.get_ref().map, "map", &request).await?;
        client.query(onward(request)).await.map(|answer| aged(answer, age))
    }

    async fn query_chunks(
        &self,
        request: Request<v1::QueryRequest>,
    ) -> Result<Response<Self::QueryChunksStream>, Status> {
        permit(&caller(&request)?, &request.get_ref().map, "map")?;
        let (mut client, age) = self.client(&request.get_ref().map, "map", &request).await?;
        client.query_chunks(onward(request)).await.map(|answer| aged(answer, age))
    }

    async fn create_map(
        &self,
        request: Request<v1::CreateMapRequest>,
    ) -> Result<Response<v1::MapStatus>, Status> {
        permit(&caller(&request)?, &request.get_ref().name, "name")?;
        let name = &request.get_ref().name;
        check_name(name).map_err(|error| of_map(&error, "name"))?;
        let made = registry::ensure(&self.gateway.bus, name).await;
        if !made.map_err(|error| Status::unavailable(error.to_string()))? {
            return Err(of_map(&MapError::AlreadyExists { name: name.clone() }, "name"));
        }
        // A worker takes it soon.
        Ok(Response::new(wire_listed(unloaded(name))))
    }

    async fn get_map(
        &self,
        request: Request<v1::GetMapRequest>,
    ) -> Result<Response<v1::MapStatus>, Status> {
        permit(&caller(&request)?, &request.get_ref().name, "name")?;
        let (mut client, age) = self.client(&request.get_ref().name, "name", &request).await?;
        client.get_map(onward(request)).await.map(|answer| aged(answer, age))
    }

    async fn list_maps(
        &self,
        request: Request<v1::ListMapsRequest>,
    ) -> Result<Response<v1::ListMapsResponse>, Status> {
        let caller = caller(&request)?;
        let token = request.metadata().get("authorization").cloned();
        let v1::ListMapsRequest { limit, after } = request.into_inner();
        let page = Page::new(limit, after).map_err(|refusal| refused(&refusal))?;
        let seen = self.gateway.directory.maps().into_iter().filter(|map| caller.sees(map));
        let (names, next) = page.of(seen, Clone::clone);
        let mut statuses = self.statuses(token.as_ref()).await;
        let status =
            |name: String| statuses.remove(&name).unwrap_or_else(|| wire_listed(unloaded(&name)));
        let maps = names.into_iter().map(status).collect();
        Ok(Response::new(v1::ListMapsResponse { maps, next }))
    }

    async fn rename_map(
        &self,
        request: Request<v1::RenameMapRequest>,
    ) -> Result<Response<v1::RenameMapResponse>, Status> {
        permit(&caller(&request)?, &request.get_ref().name, "name")?;
        Err(Status::failed_precondition("maps of a fleet keep their names"))
    }

    async fn delete_map(
        &self,
        request: Request<v1::DeleteMapRequest>,
    ) -> Result<Response<v1::DeleteMapResponse>, Status> {
        let caller = caller(&request)?;
        permit(&caller, &request.get_ref().name, "name")?;
        let name = request.into_inner().name;
        let deleted = registry::delete(&self.gateway.bus, &name).await;
        if !deleted.map_err(|error| Status::unavailable(error.to_string()))? {
            return Err(of_map(&MapError::NotFound { name }, "name"));
        }
        tracing::info!(map = name, caller = caller.name(), "a map was deleted");
        Ok(Response::new(v1::DeleteMapResponse {}))
    }

    async fn export_map(
        &self,
        request: Request<v1::ExportRequest>,
    ) -> Result<Response<Self::ExportMapStream>, Status> {
        permit(&caller(&request)?, &request.get_ref().map, "map")?;
        let (mut client, age) = self.client(&request.get_ref().map, "map", &request).await?;
        client.export_map(onward(request)).await.map(|answer| aged(answer, age))
    }
}
