//! Tests of the routes without a socket, with a real pipeline and a map of one small frame.

mod images;
mod maps;
mod questions;
mod service;

use super::{Context, HttpConfig, router};
use crate::access::{AccessConfig, Gate};
use crate::import::{Imports, ImportsConfig};
use crate::ingest::{IngestConfig, MappingService};
use crate::maps::RecordedMaps;
use crate::pipeline::frame::{Frame, FrameUp};
use crate::store::Store;
use crate::test_support::{CAMERA, engine};
use axum::Router;
use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, Request};
use nalgebra::Isometry3;
use serde_json::Value;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;
use tower::Service as _;

/// The sequence of the one frame.
const FRAME: u64 = 7;
/// How long the mapper may take for the frame.
const PATIENCE: Duration = Duration::from_secs(120);

struct Server {
    router: Router,
    stopping: CancellationToken,
}

struct Reply {
    status: u16,
    headers: HeaderMap,
    body: Bytes,
}

impl Reply {
    fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap()
    }

    fn header(&self, name: &str) -> &str {
        self.headers[name].to_str().unwrap()
    }
}

impl Server {
    fn start() -> Self {
        let stopping = CancellationToken::new();
        let maps = RecordedMaps::new(engine(), Store::default());
        let gate = Gate::new(AccessConfig::default()).unwrap();
        let service = MappingService::new(
            maps.clone(),
            gate.clone(),
            &IngestConfig::default(),
            stopping.clone(),
        );
        let router = router(Context {
            imports: Imports::new(maps.clone(), service, &ImportsConfig::default(), 0),
            maps,
            gate,
            config: HttpConfig { max_body_bytes: 16 << 10, ..HttpConfig::default() },
            body_limit: PATIENCE,
            stopping: stopping.clone(),
        });
        Self { router, stopping }
    }

    async fn send(&self, request: Request<Body>) -> Reply {
        let response = self.router.clone().call(request).await.unwrap();
        let (status, headers) = (response.status().as_u16(), response.headers().clone());
        let body = axum::body::to_bytes(response.into_body(), usize::MAX).await.unwrap();
        Reply { status, headers, body }
    }

    async fn get(&self, path: &str) -> Reply {
        self.send(Request::get(path).body(Body::empty()).unwrap()).await
    }

    async fn get_with(&self, path: &str, name: &str, value: &str) -> Reply {
        self.send(Request::get(path).header(name, value).body(Body::empty()).unwrap()).await
    }

    async fn post(&self, path: &str, body: impl Into<Body>) -> Reply {
        let request = Request::post(path).header("content-type", "application/json");
        self.send(request.body(body.into()).unwrap()).await
    }

    /// Checks that the answer is a problem with this status and field.
    async fn problem(&self, request: Request<Body>, status: u16, field: &str) {
        let what = format!("{} {}", request.method(), request.uri());
        let reply = self.send(request).await;
        let text = String::from_utf8_lossy(&reply.body).into_owned();
        assert_eq!(reply.status, status, "{what}: {text}");
        assert_eq!(reply.header("content-type"), "application/problem+json", "{what}");
        let problem = reply.json();
        assert_eq!(problem["status"], status);
        for key in ["type", "title", "detail"] {
            assert!(problem[key].as_str().is_some_and(|text| !text.is_empty()), "{what}: {text}");
        }
        assert_eq!(problem["field"].as_str().unwrap_or_default(), field, "{what}: {text}");
    }

    async fn problem_get(&self, path: &str, status: u16, field: &str) {
        self.problem(Request::get(path).body(Body::empty()).unwrap(), status, field).await;
    }

    async fn problem_post(&self, path: &str, body: &Value, status: u16, field: &str) {
        let request = Request::post(path).header("content-type", "application/json");
        let request = request.body(body.to_string().into()).unwrap();
        self.problem(request, status, field).await;
    }
}

/// A wall 2 m away, red on the left and blue on the right.
fn wall() -> Frame {
    let pixels = (CAMERA.width * CAMERA.height) as usize;
    let column = |at: usize| at as u32 % CAMERA.width;
    let rgb = |at| if column(at) < CAMERA.width / 2 { [200, 40, 40] } else { [40, 40, 200] };
    Frame {
        sequence: FRAME,
        timestamp_nanos: 1_500_000_000,
        intrinsics: CAMERA,
        rgb: (0..pixels).flat_map(rgb).collect::<Vec<u8>>().into(),
        depth_metres: vec![2.0; pixels].into(),
        depth_lag_nanos: 0,
        world_from_camera: Some(Isometry3::identity()),
        hint: None,
        labels: None,
        held_out: false,
        up: FrameUp::default(),
    }
}

/// A map of the wall; the mapper has finished it.
async fn mapped(name: &str) -> Arc<crate::pipeline::map::Map> {
    let map = engine().open(name).unwrap();
    let guard = map.claim().unwrap();
    guard.map().submit(wall()).await.unwrap().await.unwrap();
    let started = Instant::now();
    while !(map.status().settled && map.snapshot().await.keyframes.len() == 1) {
        assert!(started.elapsed() < PATIENCE, "{:?}", map.status());
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    map
}
