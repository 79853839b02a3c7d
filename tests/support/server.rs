//! A server in this process: real listeners on free ports, real adapter, real networks.

use crate::{Robot, root};
use lexsplat_proto::v1;
use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_server::config::Config;
use lexsplat_server::pipeline::engine::Engine;
use lexsplat_server::pipeline::query::{Outputs, Query, SpatialFilter, View};
use lexsplat_server::pipeline::snapshot::MapSnapshot;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tokio_stream::StreamExt as _;
use tonic::transport::Channel;
use tonic::{Response, Status, Streaming};

/// How long a map may take to settle on a slow machine.
const SETTLE: Duration = Duration::from_secs(300);

/// `configs/tiny.toml`: small budgets, the shipped bundle.
pub fn tiny_config() -> Config {
    let mut config =
        Config::load(Some(&root().join("configs/tiny.toml"))).expect("the shipped file is right");
    config.language.models = root().join("models/tiny");
    config
}

/// A running server; stop it with [`Server::stop`].
pub struct Server {
    /// What is behind the edges.
    pub engine: Arc<Engine>,
    /// Address of gRPC.
    pub grpc: String,
    /// Address of HTTP.
    pub http: String,
    stop: oneshot::Sender<()>,
    serving: JoinHandle<()>,
}

impl Server {
    /// Starts on free ports and waits until it answers.
    pub async fn start(config: Config) -> Self {
        let bind = || async { TcpListener::bind("127.0.0.1:0").await.expect("a port is free") };
        let (grpc, http) = (bind().await, bind().await);
        let address =
            |listener: &TcpListener| listener.local_addr().expect("it is bound").to_string();
        let (grpc_address, http_address) = (address(&grpc), address(&http));
        let engine = Engine::start(config.pipeline()).expect("the pipeline starts");
        let engine = Arc::new(engine);
        let (stop, stopped) = oneshot::channel::<()>();
        let listeners = lexsplat_server::Listeners { grpc, http };
        let behind = engine.clone();
        let serving = tokio::spawn(async move {
            let until = async move {
                let _ = stopped.await;
            };
            lexsplat_server::serve(behind, listeners, config, |_| {}, until)
                .await
                .expect("the server ends well");
        });
        Self { engine, grpc: grpc_address, http: http_address, stop, serving }
    }

    /// Tells the server to stop and waits until it has.
    pub async fn stop(self) {
        self.stop.send(()).expect("the server waits for this");
        let served = tokio::time::timeout(SETTLE, self.serving).await;
        served.expect("the server stops").expect("the server does not panic");
    }

    /// A gRPC client.
    pub async fn client(&self) -> MappingClient<Channel> {
        let url = format!("http://{}", self.grpc);
        let client = MappingClient::connect(url).await.expect("the server listens");
        client.max_decoding_message_size(64 << 20)
    }

    /// Streams everything the robot has into a map and returns all acknowledgements.
    pub async fn stream(&self, robot: &Robot, map: &str) -> Vec<v1::FrameAck> {
        let messages = robot.messages(map);
        self.send(messages).await.expect("the stream ends well")
    }

    /// Sends messages and returns all acknowledgements.
    ///
    /// # Errors
    /// The status that ended the stream.
    pub async fn send(&self, messages: Vec<v1::FrameMessage>) -> Result<Vec<v1::FrameAck>, Status> {
        let mut client = self.client().await;
        let acks = client.stream_frames(tokio_stream::iter(messages)).await?.into_inner();
        acks.collect::<Result<Vec<_>, _>>().await
    }

    /// Waits until a map that the server may still be loading is there.
    pub async fn loaded(&self, map: &str) {
        let (mut client, since) = (self.client().await, Instant::now());
        loop {
            let request = v1::GetMapRequest { name: map.to_owned() };
            match client.get_map(request).await {
                Ok(_) => return,
                Err(status) => assert_eq!(status.code(), tonic::Code::Unavailable, "{status}"),
            }
            assert!(since.elapsed() < SETTLE, "{map} is not loaded");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    /// Waits until the map has done its work on what it has.
    pub async fn settled(&self, map: &str) {
        let map = self.engine.map(map).expect("the map is there");
        let since = Instant::now();
        while !map.status().settled {
            assert!(since.elapsed() < SETTLE, "not settled: {:?}", map.status());
            assert!(map.status().failure.is_none(), "failed: {:?}", map.status());
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    /// Writes files of a map into a folder: each name, and the file as its URL has it.
    pub async fn export(&self, map: &str, folder: &Path, files: &[(&str, &str)]) {
        for (name, file) in files {
            let url = self.url(&format!("/v1/maps/{map}/export/{file}"));
            let reply = reqwest::get(url).await.expect("it answers");
            let is_there = reply.status().is_success();
            let bytes = reply.bytes().await.expect("with bytes");
            assert!(is_there, "{file}: {}", String::from_utf8_lossy(&bytes));
            std::fs::write(folder.join(name), bytes).expect("it can be written");
        }
    }

    /// The things, (class, frame that shows it), on which their heat map peaks.
    pub async fn found(
        &self,
        robot: &Robot,
        snapshot: &Arc<MapSnapshot>,
        things: &[(&'static str, usize)],
    ) -> Vec<&'static str> {
        let mut found = Vec::new();
        for (class, frame) in things {
            let view = Some(View::Frame(*frame as u64));
            let query = Query { view, outputs: Outputs::VIEW, ..in_space(class) };
            let answer = self.engine.query_snapshot(snapshot.clone(), query).await;
            let peak = answer.expect("it is answered").peak.expect("a view query has a peak");
            let seen = robot.class_at(*frame, peak.x as u32, peak.y as u32);
            if seen == Some(*class) {
                found.push(*class);
            }
        }
        found
    }

    /// The things whose best object in space has its centre in a thing of that class.
    pub async fn located(
        &self,
        robot: &Robot,
        snapshot: &Arc<MapSnapshot>,
        things: &[(&'static str, usize)],
    ) -> Vec<&'static str> {
        let mut located = Vec::new();
        for (class, _) in things {
            let answer = self.engine.query_snapshot(snapshot.clone(), in_space(class)).await;
            let answer = answer.expect("it is answered");
            let objects = answer.objects.expect("a question about space has objects");
            let points = answer.points.expect("and points");
            assert_eq!(objects.is_empty(), points.is_empty(), "points are the objects' surface");
            let is_there = |center| robot.is_in(class, center);
            if objects.first().is_some_and(|best| is_there(best.center.into())) {
                located.push(*class);
            }
        }
        located
    }

    /// The address of a path over HTTP.
    pub fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.http)
    }
}

/// A question about the whole map.
fn in_space(text: &str) -> Query {
    Query {
        text: text.into(),
        negatives: Vec::new(),
        view: None,
        outputs: Outputs::SPACE,
        threshold: None,
        smoothing_pixels: None,
        max_objects: 10,
        filter: SpatialFilter::default(),
    }
}

/// The first error of a stream of acknowledgements, at its opening or later.
pub async fn first_error(
    opened: Result<Response<Streaming<v1::FrameAck>>, Status>,
) -> Option<Status> {
    let mut acks = match opened {
        Err(status) => return Some(status),
        Ok(response) => response.into_inner(),
    };
    while let Some(ack) = acks.next().await {
        if let Err(status) = ack {
            return Some(status);
        }
    }
    None
}
