//! Starting the thread of a map.

use super::super::checkpoint::{Checkpoint, Progress};
use super::super::closure::{Closure, ClosureConfig};
use super::super::compressor;
use super::super::encoder::LanguageThread;
use super::super::input_check::InputCheck;
use super::super::live_map::{LiveMap, StepBudget};
use super::super::map::Map;
use super::super::mapper::{MapperConfig, TiesConfig};
use super::super::snapshot::MapSnapshot;
use super::super::tracker::{Tracker, TrackerConfig};
use super::MapThread;
use super::language_requests::LanguageRequests;
use super::publisher::Publisher;
use super::refiner::Refiner;
use lexsplat_gpu::{Gaussians, Gpu, HostGaussians, Ties, Trainer};
use std::collections::VecDeque;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;

/// The settings of a map's stages.
#[derive(Clone, Copy)]
pub(in super::super) struct StageConfigs<'a> {
    pub compressor: &'a compressor::CompressorConfig,
    pub tracker: &'a TrackerConfig,
    pub closure: &'a ClosureConfig,
    pub mapper: &'a MapperConfig,
}

/// Starts a map's thread, with an empty map or with the one of a checkpoint.
///
/// # Errors
/// The reason why there is no device memory, no kernel or no thread for it.
pub(in super::super) fn spawn(
    name: &str,
    gpu: &Gpu,
    language: &Arc<LanguageThread>,
    configs: StageConfigs<'_>,
    saved: Option<Checkpoint>,
) -> Result<(Arc<Map>, JoinHandle<()>), String> {
    let config = configs.mapper;
    let online = compressor::online(configs.compressor);
    let mut trainer = Trainer::new(gpu, online.code_size()).map_err(|error| error.to_string())?;
    let TiesConfig { rotation, scale, opacity } = config.ties;
    trainer.set_ties(Ties { rotation, scale, opacity });
    let gaussians = Gaussians::new(gpu, online.code_size());
    let empty = MapSnapshot {
        map: name.to_owned(),
        revision: 0,
        through: None,
        gaussians: Arc::new(HostGaussians::default()),
        online: Arc::from(online.boxed_clone()),
        trajectory: Arc::default(),
        keyframes: Arc::default(),
        evidence: Arc::default(),
        up: None,
    };
    let (map, messages) = Map::new(name, config.queue_frames, empty);
    let map = Arc::new(map);
    let steps = StepBudget::new(config.steps_per_keyframe, config.language_every);
    let mut thread = MapThread {
        config: config.clone(),
        compressor_config: configs.compressor.clone(),
        tracker_config: configs.tracker.clone(),
        gpu: gpu.clone(),
        live: LiveMap::new(gaussians, online, steps),
        tracker: Tracker::new(gpu, configs.tracker),
        closure: Closure::new(configs.closure),
        input_check: InputCheck::new(),
        trainer,
        language: LanguageRequests::new(language.clone(), map.sender()),
        publisher: Publisher::new(config.clock),
        refiner: Refiner::new(config),
        deferred: VecDeque::new(),
        progress: Progress::default(),
        newest_frame: Instant::now(),
        has_step_in_flight: false,
        saves: Vec::new(),
        map: map.clone(),
    };
    if let Some(saved) = saved {
        thread.restore(saved)?;
    }
    thread.tell_state();
    let handle = std::thread::Builder::new()
        .name(format!("map {name}"))
        .spawn(move || thread.run(messages))
        .map_err(|error| error.to_string())?;
    Ok((map, handle))
}
