//! Starts and owns everything behind the edges: the adapter, the networks, the maps and their threads.

use super::checkpoint::{self, Checkpoint};
use super::closure::ClosureConfig;
use super::compressor::CompressorConfig;
use super::encoder::{LanguageConfig, LanguageThread};
use super::map::{Map, MapError, Message};
use super::map_thread::start::{StageConfigs, spawn};
use super::mapper::MapperConfig;
use super::network::{Bundle, BundleError};
use super::query::{
    self, Answer, Client, Mesh, Query, QueryConfig, QueryError, QueryThread, RenderRequest,
    RenderedImage, Segmentation, SegmentationRequest, Turns,
};
use super::snapshot::MapSnapshot;
use super::tracker::TrackerConfig;
use lexsplat_gpu::{Gpu, GpuError};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;

/// Longest name of a map.
const MAX_NAME_BYTES: usize = 64;

/// The settings of the stages.
#[derive(Clone, Debug, Default)]
pub struct PipelineConfig {
    /// Part of the adapter's name; `None`: the fastest adapter.
    pub adapter: Option<String>,
    /// The vision networks.
    pub language: LanguageConfig,
    /// The online compressor.
    pub compressor: CompressorConfig,
    /// The tracker.
    pub tracker: TrackerConfig,
    /// Loop closure.
    pub closure: ClosureConfig,
    /// The mapper.
    pub mapper: MapperConfig,
    /// Queries.
    pub query: QueryConfig,
}

/// Why the server cannot start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// There is no usable adapter.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The bundle of networks cannot be loaded.
    #[error(transparent)]
    Bundle(#[from] BundleError),
    /// The system has no thread left.
    #[error("cannot start a thread")]
    Thread(#[from] std::io::Error),
}

struct Running {
    map: Arc<Map>,
    thread: JoinHandle<()>,
}

/// The running pipeline. Share it with `Arc`.
pub struct Engine {
    config: PipelineConfig,
    gpu: Gpu,
    bundle_name: String,
    fingerprint: String,
    language: Arc<LanguageThread>,
    query: QueryThread,
    maps: Mutex<BTreeMap<String, Running>>,
    creating: Mutex<()>,
    /// Meshes are made one at a time, because each takes much memory and all cores.
    meshing: Turns,
}

impl Engine {
    /// Opens the adapter, loads the bundle and starts the language and the query thread.
    ///
    /// # Errors
    /// [`StartError`] names what is missing and what to do about it.
    pub fn start(config: PipelineConfig) -> Result<Self, StartError> {
        let gpu = Gpu::new(config.adapter.as_deref())?;
        let bundle = Bundle::load(&config.language)?;
        let bundle_name = bundle.name().to_owned();
        let fingerprint = fingerprint(&config, bundle.digest());
        let (vision, text) = bundle.split();
        let query = QueryThread::start(gpu.clone(), text, &config.query)?;
        let embed = query.embedder();
        let meshing = Turns::new(config.query.queue);
        let language = Arc::new(LanguageThread::start(vision, embed, &config.language)?);
        Ok(Self {
            config,
            gpu,
            bundle_name,
            fingerprint,
            language,
            query,
            maps: Mutex::default(),
            creating: Mutex::default(),
            meshing,
        })
    }

    /// The adapter's name.
    pub fn adapter(&self) -> &str {
        self.gpu.adapter_name()
    }

    /// The bundle's name.
    pub fn bundle(&self) -> &str {
        &self.bundle_name
    }

    /// How many maps there may be.
    pub fn max_maps(&self) -> usize {
        self.config.mapper.max_maps
    }

    /// A digest of all that decides what a map becomes, beside its frames: the program's version, the bundle
    /// and the settings of the stages. A checkpoint can be continued by an engine with the same one.
    pub fn fingerprint(&self) -> &str {
        &self.fingerprint
    }

    fn locked(&self) -> MutexGuard<'_, BTreeMap<String, Running>> {
        self.maps.lock().expect("no thread panics while it holds the list of maps")
    }

    /// Creates a map and starts its thread.
    ///
    /// # Errors
    /// [`MapError::InvalidName`], [`MapError::AlreadyExists`], [`MapError::TooMany`],
    /// [`MapError::Failed`] if there is no thread or no device memory for it.
    pub fn create(&self, name: &str) -> Result<Arc<Map>, MapError> {
        self.begin(name, None)
    }

    /// Creates a map that goes on where a checkpoint of a map with the same [`Engine::fingerprint`] ends.
    ///
    /// # Errors
    /// As [`Engine::create`]; [`MapError::Failed`] also if the checkpoint does not fit.
    pub fn restore(&self, name: &str, saved: Checkpoint) -> Result<Arc<Map>, MapError> {
        self.begin(name, Some(saved))
    }

    fn begin(&self, name: &str, saved: Option<Checkpoint>) -> Result<Arc<Map>, MapError> {
        check_name(name)?;
        // One map at a time, so that its name stays free while its thread starts. That takes a second, during
        // which the list of maps stays readable.
        let _turn = self.creating.lock().expect("no thread panics while it makes a map");
        let limit = self.max_maps();
        {
            let maps = self.locked();
            if maps.contains_key(name) {
                return Err(MapError::AlreadyExists { name: name.into() });
            }
            if maps.len() >= limit {
                return Err(MapError::TooMany { limit });
            }
        }
        let PipelineConfig { compressor, tracker, closure, mapper, .. } = &self.config;
        let configs = StageConfigs { compressor, tracker, closure, mapper };
        let (map, thread) = spawn(name, &self.gpu, &self.language, configs, saved)
            .map_err(|reason| MapError::Failed { name: name.into(), reason })?;
        self.locked().insert(name.into(), Running { map: map.clone(), thread });
        Ok(map)
    }

    /// The map of this name; it is created if there is none.
    ///
    /// # Errors
    /// As [`Engine::create`], but never [`MapError::AlreadyExists`].
    pub fn open(&self, name: &str) -> Result<Arc<Map>, MapError> {
        match self.create(name) {
            Err(MapError::AlreadyExists { .. }) => self.map(name),
            other => other,
        }
    }

    /// The map.
    ///
    /// # Errors
    /// [`MapError::NotFound`].
    pub fn map(&self, name: &str) -> Result<Arc<Map>, MapError> {
        let maps = self.locked();
        let running = maps.get(name).ok_or_else(|| MapError::NotFound { name: name.into() })?;
        Ok(running.map.clone())
    }

    /// All maps, by name.
    pub fn maps(&self) -> Vec<Arc<Map>> {
        self.locked().values().map(|running| running.map.clone()).collect()
    }

    /// Stops a map's thread and removes the map. Frames in its queue are not mapped.
    ///
    /// # Errors
    /// [`MapError::NotFound`].
    pub async fn delete(&self, name: &str) -> Result<(), MapError> {
        let running =
            self.locked().remove(name).ok_or_else(|| MapError::NotFound { name: name.into() })?;
        running.map.fail("it was deleted".into());
        stop(running).await;
        let gpu = self.gpu.clone();
        // A device that is lost has told the other maps.
        let _ = tokio::task::spawn_blocking(move || gpu.reclaim()).await;
        Ok(())
    }

    /// Answers a question from a snapshot.
    ///
    /// # Errors
    /// [`QueryError`] names what is wrong with the question.
    pub async fn query(
        &self,
        client: &Client,
        snapshot: Arc<MapSnapshot>,
        query: Query,
    ) -> Result<Answer, QueryError> {
        self.query.ask(client, snapshot, query).await
    }

    /// Answers a question of the server itself.
    ///
    /// # Errors
    /// As [`Engine::query`].
    pub async fn query_snapshot(
        &self,
        snapshot: Arc<MapSnapshot>,
        query: Query,
    ) -> Result<Answer, QueryError> {
        self.query.ask(&Client::Server, snapshot, query).await
    }

    /// Compares several texts with each other in a snapshot.
    ///
    /// # Errors
    /// [`QueryError`] names what is wrong with the texts.
    pub async fn segment(
        &self,
        client: &Client,
        snapshot: Arc<MapSnapshot>,
        request: SegmentationRequest,
    ) -> Result<Segmentation, QueryError> {
        self.query.segment(client, snapshot, request).await
    }

    /// Renders a snapshot.
    ///
    /// # Errors
    /// [`QueryError`] names what is wrong with the request.
    pub async fn render(
        &self,
        client: &Client,
        snapshot: Arc<MapSnapshot>,
        request: RenderRequest,
    ) -> Result<RenderedImage, QueryError> {
        self.query.render(client, snapshot, request).await
    }

    /// Makes a mesh of a snapshot, with the relevancy of each vertex if there is a question. Dropping the
    /// future cancels it.
    ///
    /// # Errors
    /// [`QueryError`] names what is wrong with the voxel or the question; [`QueryError::TooMany`] if the
    /// client waits for too many meshes already.
    pub async fn mesh(
        &self,
        client: &Client,
        snapshot: Arc<MapSnapshot>,
        voxel_metres: f32,
        question: Option<Query>,
    ) -> Result<Mesh, QueryError> {
        let _turn = self.meshing.wait(client).await?;
        let mut mesh = query::mesh(self.gpu.clone(), snapshot.clone(), voxel_metres).await?;
        if let Some(question) = question {
            let codes = mesh.codes.clone();
            mesh.relevancies = self.query.relevancies(client, snapshot, codes, question).await?;
        }
        Ok(mesh)
    }

    /// Lets every map finish the frames in its queue and stops its thread.
    pub async fn shutdown(&self) {
        let running = std::mem::take(&mut *self.locked());
        for (_, running) in running {
            stop(running).await;
        }
    }
}

/// Tells the map's thread to stop behind what is in its queue, and waits for it.
async fn stop(running: Running) {
    // An error means that the thread has already stopped.
    let _ = running.map.sender().send(Message::Stop).await;
    let joined = tokio::task::spawn_blocking(move || running.thread.join()).await;
    if !matches!(joined, Ok(Ok(()))) {
        tracing::error!(map = running.map.name(), "a map's thread panicked");
    }
}

fn fingerprint(config: &PipelineConfig, bundle: &str) -> String {
    // These settings do not change a map.
    let unimportant = MapperConfig::default();
    let mapper = MapperConfig {
        max_maps: unimportant.max_maps,
        queue_frames: unimportant.queue_frames,
        snapshot_seconds: unimportant.snapshot_seconds,
        ..config.mapper.clone()
    };
    let PipelineConfig { compressor, tracker, closure, .. } = config;
    let version = (env!("CARGO_PKG_VERSION"), checkpoint::VERSION);
    let all = (version, bundle, compressor, tracker, closure, mapper);
    let bytes = rmp_serde::to_vec_named(&all).expect("settings can be written");
    Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Whether a map may have this name.
///
/// # Errors
/// [`MapError::InvalidName`].
pub(crate) fn check_name(name: &str) -> Result<(), MapError> {
    let good = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-');
    if name.is_empty()
        || name.len() > MAX_NAME_BYTES
        || name.starts_with('.')
        || !name.chars().all(good)
    {
        return Err(MapError::InvalidName { name: name.chars().take(MAX_NAME_BYTES).collect() });
    }
    Ok(())
}
