//! Duration of queries, step by step: `cargo bench -p lexsplat-server --bench query`, or
//! `... -- GAUSSIANS` for another number of Gaussians than 100,000.
//!
//! The map is a room of 4 x 3 x 4 m with furniture, each surface with the code of one word. The
//! bundle is `models/tiny`. Each line is the median of [`RUNS`] queries with cached texts. `decode`
//! is 0 where features are cached.

use anyhow::Context as _;
use lexsplat_gpu::{Gpu, HostGaussians};
use lexsplat_server::pipeline::compressor::{CompressorConfig, OnlineStage, online};
use lexsplat_server::pipeline::encoder::LanguageConfig;
use lexsplat_server::pipeline::frame::{Intrinsics, TrackedFrame};
use lexsplat_server::pipeline::network::{
    Bundle, Tensor, TextNetworks, VisionNetworks, VisionStages,
};
use lexsplat_server::pipeline::query::{
    Client, Outputs, Query, QueryConfig, QueryThread, SegmentationRequest, SpatialFilter, Timing,
    View,
};
use lexsplat_server::pipeline::snapshot::{KeyframeInfo, MapSnapshot};
use nalgebra::Isometry3;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

const WORDS: [&str; 12] = [
    "floor", "ceiling", "wall", "chair", "table", "sofa", "lamp", "bed", "book", "plant", "door",
    "window",
];
const RUNS: usize = 15;
const CAMERA: Intrinsics =
    Intrinsics { width: 640, height: 480, fx: 580.0, fy: 580.0, cx: 319.5, cy: 239.5 };

fn main() -> anyhow::Result<()> {
    let size = std::env::args().skip(1).find_map(|word| word.parse().ok()).unwrap_or(100_000);
    let models = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/tiny").into();
    let config = LanguageConfig { models, ..LanguageConfig::default() };
    let (mut vision, mut text) = Bundle::load(&config)?.split();
    let codes: Vec<Vec<f32>> =
        WORDS.iter().map(|word| code(&mut vision, &mut text, word)).collect::<Result<_, _>>()?;
    let mut stage = online(&CompressorConfig::default());
    stage.observe(&codes.concat());
    let codes: Vec<Vec<f32>> = codes.iter().map(|code| stage.encode(code)).collect();
    let gpu = Gpu::new(None)?;
    println!(
        "{size} Gaussians, {} text features, adapter {}",
        text.feature_size,
        gpu.adapter_name()
    );
    let thread = QueryThread::start(gpu, text, &QueryConfig::default())?;
    let bench = Bench {
        runtime: tokio::runtime::Builder::new_current_thread().build()?,
        map: room(size, &codes),
        stage: stage.into(),
        thread,
    };
    bench.run()
}

/// The generic code of a word.
fn code(
    vision: &mut VisionNetworks,
    text: &mut TextNetworks,
    word: &str,
) -> anyhow::Result<Vec<f32>> {
    let embedding = text.tower.embed(word)?;
    let cells = vision.grid[0] * vision.grid[1];
    let planes = embedding.iter().flat_map(|&v| std::iter::repeat_n(v, cells)).collect();
    let features = Tensor::floats(&[1, embedding.len(), vision.grid[0], vision.grid[1]], planes);
    let compressor = match &mut vision.stages {
        VisionStages::Staged { compressor, .. } => Some(compressor),
        VisionStages::EndToEnd { compressor, .. } => compressor.as_mut(),
    };
    let compressor = compressor.context("the bundle has no compressor for single words")?;
    let codes = compressor.run(&[features])?.swap_remove(0);
    Ok(codes.as_floats().iter().step_by(cells).copied().collect())
}

/// Discs on the faces of boxes: the first three words are the room, the others stand in it.
fn room(size: usize, codes: &[Vec<f32>]) -> HostGaussians {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut map = HostGaussians::default();
    (map.color.channels, map.language.channels) = (3, codes[0].len());
    for at in 0..size {
        let word = at % codes.len();
        let half = if word < 3 { [2.0, 1.5, 2.0] } else { [0.3, 0.3, 0.3] };
        let middle = match word {
            0..3 => [0.0; 3],
            _ => [(word % 3) as f32 - 1.0, 0.8, (word / 3) as f32 - 1.8],
        };
        let mut offset = [0, 1, 2].map(|axis| random.random_range(-half[axis]..half[axis]));
        let face = random.random_range(0..3);
        offset[face] = half[face] * if random.random() { 1.0 } else { -1.0 };
        map.means.push(std::array::from_fn(|axis| middle[axis] + offset[axis]));
        let shade = word as f32 / codes.len() as f32;
        for (head, feature) in
            [(&mut map.color, &[shade, 0.5, 1.0 - shade][..]), (&mut map.language, &codes[word])]
        {
            head.rotations.push([1.0, 0.0, 0.0, 0.0]);
            head.log_scales.push([0.02_f32.ln(); 3]);
            head.opacity_logits.push(2.0);
            head.features
                .extend(feature.iter().map(|value| value + random.random_range(-0.02..0.02)));
        }
    }
    map
}

struct Bench {
    runtime: tokio::runtime::Runtime,
    map: HostGaussians,
    stage: Arc<dyn OnlineStage>,
    thread: QueryThread,
}

impl Bench {
    /// The map as a new revision, of which nothing is cached.
    fn snapshot(&self) -> Arc<MapSnapshot> {
        let world_from_camera = Isometry3::translation(0.0, 0.0, -1.9);
        let frame = TrackedFrame {
            sequence: 0,
            timestamp_nanos: 0,
            world_from_camera,
            covariance: None,
            exposure: [0.0; 2],
        };
        Arc::new(MapSnapshot {
            map: "bench".into(),
            revision: 1,
            through: None,
            gaussians: Arc::new(self.map.clone()),
            online: self.stage.clone(),
            trajectory: Arc::new(vec![frame]),
            keyframes: Arc::new(vec![KeyframeInfo {
                frame,
                intrinsics: CAMERA,
                rgb: Arc::default(),
                has_language: false,
            }]),
            evidence: Arc::default(),
            up: None,
        })
    }

    fn ask(
        &self,
        snapshot: &Arc<MapSnapshot>,
        word: &str,
        view: Option<View>,
    ) -> anyhow::Result<Timing> {
        let query = Query {
            text: word.into(),
            negatives: Vec::new(),
            outputs: if view.is_some() { Outputs::VIEW } else { Outputs::SPACE },
            view,
            threshold: None,
            smoothing_pixels: None,
            max_objects: 10,
            filter: SpatialFilter::default(),
        };
        Ok(self.runtime.block_on(self.thread.ask(&Client::Server, snapshot.clone(), query))?.timing)
    }

    fn segment(&self, snapshot: &Arc<MapSnapshot>, view: Option<View>) -> anyhow::Result<Timing> {
        let request = SegmentationRequest {
            texts: WORDS.map(str::to_owned).to_vec(),
            negatives: Vec::new(),
            view,
            threshold: None,
            smoothing_pixels: None,
        };
        Ok(self
            .runtime
            .block_on(self.thread.segment(&Client::Server, snapshot.clone(), request))?
            .timing)
    }

    fn run(&self) -> anyhow::Result<()> {
        let cached = self.snapshot();
        for word in WORDS {
            self.ask(&cached, word, None)?;
        }
        println!(
            "{:34} {:>7} {:>7} {:>7} {:>7} {:>7}",
            "ms", "total", "text", "render", "decode", "score"
        );
        let view = || Some(View::Frame(0));
        let word = |run: usize| WORDS[run % WORDS.len()];
        line("3D, first of a revision", |run| self.ask(&self.snapshot(), word(run), None))?;
        self.ask(&cached, WORDS[0], None)?;
        line("3D", |run| self.ask(&cached, word(run), None))?;
        line("3D, 12 words segmented", |_| self.segment(&cached, None))?;
        line("view 640x480, first of a revision", |run| {
            self.ask(&self.snapshot(), word(run), view())
        })?;
        self.ask(&cached, WORDS[0], view())?;
        line("view 640x480", |run| self.ask(&cached, word(run), view()))?;
        line("view 640x480, 12 words segmented", |_| self.segment(&cached, view()))
    }
}

/// Prints the median run by total duration.
fn line(name: &str, ask: impl Fn(usize) -> anyhow::Result<Timing>) -> anyhow::Result<()> {
    let mut all = (0..RUNS).map(ask).collect::<anyhow::Result<Vec<Timing>>>()?;
    all.sort_by(|a, b| a.total.total_cmp(&b.total));
    let Timing { text, render, decode, score, total } = all[RUNS / 2];
    println!("{name:34} {total:7.1} {text:7.1} {render:7.1} {decode:7.1} {score:7.1}");
    Ok(())
}
