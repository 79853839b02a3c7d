//! The HTTP routes of a gateway: its own health, the list of maps, and everything else as the map's worker
//! answers.

use super::super::registry;
use super::directory::NoWorker;
use super::state::{AGE, Gateway, MAX_STALENESS, max_staleness, unloaded};
use crate::access::{Caller, rules};
use crate::check::Page;
use crate::http::{Body, BodyLimits, Options, PageOfMaps, Problem, Segments, Shell, document};
use crate::http::{listed, of_process, shell};
use crate::maps::MapsError;
use crate::pipeline::engine::check_name;
use crate::pipeline::map::MapError;
use crate::telemetry;
use axum::extract::{FromRef, Request, State};
use axum::http::uri::{PathAndQuery, Uri};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{any, get};
use axum::{Extension, Json, Router};
use hyper_util::client::legacy;
use hyper_util::client::legacy::connect::HttpConnector;
use hyper_util::rt::TokioExecutor;
use lexsplat_proto::json::{Health, Maps, NewMap, Status};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Paths that begin so are about one map.
const OF_A_MAP: &str = "/v1/maps/{name}";
/// How long a connection to a worker may take.
const CONNECT: Duration = Duration::from_secs(3);
/// A worker that takes nothing for so long is gone.
const DEAD: Duration = Duration::from_secs(10);
/// How long a worker may take to list its maps.
const LIST: Duration = Duration::from_secs(2);
/// The longest list of maps of a worker, bytes.
const LONGEST_LIST: usize = 64 << 20;
/// Headers that hold for one connection, or that the worker must not see: it takes requests for those of a
/// page.
const NOT_ONWARD: [HeaderName; 8] = [
    header::HOST,
    header::ORIGIN,
    header::CONNECTION,
    header::TRANSFER_ENCODING,
    header::TE,
    header::TRAILER,
    header::UPGRADE,
    header::PROXY_AUTHORIZATION,
];

/// Asks workers.
type Client = legacy::Client<HttpConnector, axum::body::Body>;

#[derive(Clone)]
struct Shared {
    gateway: Gateway,
    client: Client,
    limits: BodyLimits,
}

impl FromRef<Shared> for BodyLimits {
    fn from_ref(shared: &Shared) -> Self {
        shared.limits
    }
}

/// The routes of a gateway, those of the dashboard included.
pub(crate) fn router(gateway: Gateway, of_shell: Shell) -> Router {
    let mut connector = HttpConnector::new();
    connector.set_connect_timeout(Some(CONNECT));
    connector.set_nodelay(true);
    connector.set_tcp_user_timeout(Some(DEAD));
    connector.set_keepalive(Some(DEAD));
    let client = legacy::Client::builder(TokioExecutor::new()).build(connector);
    let limits = BodyLimits { bytes: of_shell.config.max_body_bytes, time: of_shell.body_limit };
    let of_a_map: BTreeSet<&str> = rules::HTTP
        .iter()
        .map(|(_, path, _)| *path)
        .filter(|path| path.starts_with(OF_A_MAP) && *path != OF_A_MAP)
        .collect();
    let routes = Router::new()
        .route("/healthz", get(healthz))
        .route("/readyz", get(readyz))
        .route("/metrics", get(metrics))
        .route("/openapi.json", get(document))
        .route("/v1/maps", get(list).post(create))
        .route(OF_A_MAP, any(onward).delete(delete));
    let routes = of_a_map.into_iter().fold(routes, |routes, path| routes.route(path, any(onward)));
    shell(routes.with_state(Shared { gateway, client, limits }), of_shell)
}

fn health(status: &str) -> Health {
    Health {
        status: status.into(),
        adapter: "none: a gateway".into(),
        bundle: "none: a gateway".into(),
        version: env!("CARGO_PKG_VERSION").into(),
        warnings: Vec::new(),
        loading: Vec::new(),
    }
}

async fn healthz() -> Json<Health> {
    Json(health("alive"))
}

async fn readyz(State(shared): State<Shared>) -> Result<Json<Health>, Problem> {
    match shared.gateway.is_ready.load(Ordering::Relaxed) {
        true => Ok(Json(health("ready"))),
        false => Err(Problem::unavailable(
            "the frame log in NATS does not answer, or the server is stopping",
        )),
    }
}

async fn metrics() -> impl IntoResponse {
    let recorder = telemetry::recorder();
    recorder.run_upkeep();
    let text = recorder.render() + &of_process();
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text)
}

async fn list(
    State(shared): State<Shared>,
    Extension(caller): Extension<Caller>,
    Options(PageOfMaps { limit, after }): Options<PageOfMaps>,
    headers: HeaderMap,
) -> Result<Json<Maps>, Problem> {
    let page = Page::new(limit, after)?;
    let seen = shared.gateway.directory.maps().into_iter().filter(|map| caller.sees(map));
    let (names, next) = page.of(seen, Clone::clone);
    let mut statuses = statuses(&shared, &headers).await;
    let status = |name: String| statuses.remove(&name).unwrap_or_else(|| listed(unloaded(&name)));
    Ok(Json(Maps { maps: names.into_iter().map(status).collect(), next }))
}

/// Statuses of the maps of all workers, by name, as the caller with these headers may see them.
async fn statuses(shared: &Shared, headers: &HeaderMap) -> BTreeMap<String, Status> {
    let asked = shared.gateway.directory.workers().into_iter().map(|(_, http)| async move {
        let answer = get_from(&shared.client, &http, "/v1/maps", headers);
        let body = tokio::time::timeout(LIST, answer).await.ok()?.ok()?;
        let mut listed = serde_json::from_slice::<Maps>(&body).ok()?.maps;
        // It may have copies of others' maps.
        listed.retain(|map| shared.gateway.directory.is_owner(&http, &map.name));
        Some(listed)
    });
    let listed = futures::future::join_all(asked).await.into_iter().flatten().flatten();
    listed.map(|status| (status.name.clone(), status)).collect()
}

async fn create(
    State(shared): State<Shared>,
    Extension(caller): Extension<Caller>,
    Body(NewMap { name }): Body<NewMap>,
) -> Result<impl IntoResponse, Problem> {
    caller.may_use(&name).map_err(|error| Problem::from(error).at("name"))?;
    check_name(&name).map_err(MapsError::from)?;
    let made = registry::ensure(&shared.gateway.bus, &name).await;
    if !made.map_err(|error| Problem::unavailable(error.to_string()))? {
        return Err(MapError::AlreadyExists { name }.into());
    }
    let location = format!("maps/{name}");
    let status = Json(listed(unloaded(&name)));
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], status))
}

async fn delete(
    State(shared): State<Shared>,
    Extension(caller): Extension<Caller>,
    segments: Segments,
) -> Result<StatusCode, Problem> {
    let map = segments.get("name");
    let deleted = registry::delete(&shared.gateway.bus, map).await;
    if !deleted.map_err(|error| Problem::unavailable(error.to_string()))? {
        return Err(MapError::NotFound { name: map.to_owned() }.into());
    }
    tracing::info!(map, caller = caller.name(), "a map was deleted");
    Ok(StatusCode::NO_CONTENT)
}

/// Passes a request on to the worker that has the map, and its answer back.
async fn onward(
    State(shared): State<Shared>,
    segments: Segments,
    mut request: Request,
) -> Result<Response, Problem> {
    let staleness = request.headers().get(MAX_STALENESS).map(|v| v.to_str().unwrap_or_default());
    let staleness = max_staleness(staleness).map_err(Problem::bad_request)?;
    // What changes a map is for its owner.
    let staleness = staleness.filter(|_| is_question(&request));
    let worker = shared.gateway.directory.asked(segments.get("name"), staleness).await?;
    let path = request.uri().path_and_query().cloned();
    *request.uri_mut() = uri(&worker.http, path)?;
    *request.version_mut() = axum::http::Version::HTTP_11;
    NOT_ONWARD.iter().for_each(|name| {
        request.headers_mut().remove(name);
    });
    request.extensions_mut().clear();
    let answer = shared.client.request(request).await.map_err(|error| {
        tracing::warn!(%error, worker = worker.http, "a worker does not answer");
        Problem::unavailable("the map's worker does not answer: try again")
    })?;
    let mut answer = answer.map(axum::body::Body::new);
    NOT_ONWARD.iter().for_each(|name| {
        answer.headers_mut().remove(name);
    });
    if let Some(age) = worker.age {
        answer.headers_mut().insert(AGE, HeaderValue::from(age.as_secs()));
    }
    Ok(answer)
}

/// Whether a request only reads.
fn is_question(request: &Request) -> bool {
    let path = request.uri().path();
    // Only the worker that answered a question has the rest of its answer.
    if path.contains("/queries/") {
        return false;
    }
    match *request.method() {
        Method::GET | Method::HEAD => !path.ends_with("/events"),
        Method::POST => path.ends_with("/query") || path.ends_with("/render"),
        _ => false,
    }
}

/// The answer of a worker to a `GET` in the name of the caller whose headers these are.
async fn get_from(
    client: &Client,
    worker: &str,
    path: &'static str,
    headers: &HeaderMap,
) -> Result<axum::body::Bytes, Problem> {
    let mut request = Request::new(axum::body::Body::empty());
    *request.uri_mut() = uri(worker, Some(PathAndQuery::from_static(path)))?;
    for name in [header::AUTHORIZATION, header::COOKIE] {
        if let Some(value) = headers.get(&name) {
            request.headers_mut().insert(name, value.clone());
        }
    }
    let unread = |error: &dyn std::fmt::Display| Problem::unavailable(error.to_string());
    let answer = client.request(request).await.map_err(|error| unread(&error))?;
    let body = axum::body::Body::new(answer.into_body());
    axum::body::to_bytes(body, LONGEST_LIST).await.map_err(|error| unread(&error))
}

fn uri(worker: &str, path: Option<PathAndQuery>) -> Result<Uri, Problem> {
    let path = path.unwrap_or_else(|| PathAndQuery::from_static("/"));
    let uri = Uri::builder().scheme("http").authority(worker).path_and_query(path).build();
    uri.map_err(|error| Problem::internal(format!("{worker:?} is no address of a worker: {error}")))
}

impl From<NoWorker> for Problem {
    fn from(error: NoWorker) -> Self {
        match error {
            NoWorker::NoMap { map } => MapError::NotFound { name: map }.into(),
            NoWorker::Loading { .. } | NoWorker::Nobody { .. } => {
                Self::unavailable(error.to_string())
            }
        }
    }
}
