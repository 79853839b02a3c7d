//! The thread that owns the text networks and a renderer for readers.
//!
//! In: snapshots with questions. Out: answers. Questions are answered one after the other; a full
//! queue makes the asker wait.

use super::answer::{Answer, Heatmap, Picture, Segmentation, Timing};
use super::clusters::{Clusters, Density, Worth, clustered};
use super::config::QueryConfig;
use super::picture::{self, PaletteCache};
use super::presence::Presence;
use super::relevancy::Comparison;
use super::request::{Contest, Query, RenderRequest, View};
use super::scene::Scene;
use super::space::SpaceCache;
use super::text::Words;
use super::view::{self, ViewCache, ViewFeatures};
use super::{QueryError, place, presence, regions, surface, viewpoint};
use crate::pipeline::compressor::generic::GenericDecoder;
use crate::pipeline::encoder::Embed;
use crate::pipeline::network::TextNetworks;
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::{Camera, Gpu};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;
use tokio::sync::{mpsc, oneshot};

enum Job {
    Ask {
        asked: Asked,
        reply: oneshot::Sender<Result<Answer, QueryError>>,
    },
    Render {
        snapshot: Arc<MapSnapshot>,
        request: RenderRequest,
        reply: oneshot::Sender<Result<Picture, QueryError>>,
    },
    Segment {
        snapshot: Arc<MapSnapshot>,
        contest: Contest,
        since: Instant,
        reply: oneshot::Sender<Result<Segmentation, QueryError>>,
    },
    Compare {
        snapshot: Arc<MapSnapshot>,
        codes: Vec<f32>,
        query: Query,
        reply: oneshot::Sender<Result<Vec<f32>, QueryError>>,
    },
    Embed {
        text: String,
        reply: oneshot::Sender<Result<Arc<[f32]>, QueryError>>,
    },
}

struct Asked {
    snapshot: Arc<MapSnapshot>,
    query: Query,
    since: Instant,
}

/// A handle to the thread "query". Dropping it lets the thread finish its queue and waits for it.
pub struct QueryThread {
    /// `None` only while dropping.
    queue: Option<mpsc::Sender<Job>>,
    thread: Option<JoinHandle<()>>,
}

impl QueryThread {
    /// Starts the thread; it takes the networks with it.
    ///
    /// # Errors
    /// The system's, if there is no thread to be had.
    pub fn start(gpu: Gpu, networks: TextNetworks, config: &QueryConfig) -> std::io::Result<Self> {
        let (queue, jobs) = mpsc::channel(config.queue);
        let worker = Worker::new(gpu, networks, config.clone());
        let thread =
            std::thread::Builder::new().name("query".into()).spawn(move || worker.work(jobs))?;
        Ok(Self { queue: Some(queue), thread: Some(thread) })
    }

    /// Answers a question.
    ///
    /// # Errors
    /// [`QueryError`] names what is wrong with the question, or what failed.
    pub async fn ask(
        &self,
        snapshot: Arc<MapSnapshot>,
        query: Query,
    ) -> Result<Answer, QueryError> {
        let asked = Asked { snapshot, query, since: Instant::now() };
        self.send(|reply| Job::Ask { asked, reply }).await
    }

    /// Words to features for other threads of the pipeline; it waits, so never for the query thread's
    /// own. It does not keep this thread alive.
    pub fn embedder(&self) -> Embed {
        let queue = self.queue.as_ref().expect("only dropping takes the queue").downgrade();
        Box::new(move |text| {
            let stopped = || QueryError::Stopped.to_string();
            let (reply, embedding) = oneshot::channel();
            let job = Job::Embed { text: text.to_owned(), reply };
            queue.upgrade().ok_or_else(stopped)?.blocking_send(job).map_err(|_| stopped())?;
            let embedding = embedding.blocking_recv().map_err(|_| stopped())?;
            embedding.map_err(|error| error.to_string())
        })
    }

    /// Renders a picture.
    ///
    /// # Errors
    /// [`QueryError`] names what is wrong with the request, or what failed.
    pub async fn render(
        &self,
        snapshot: Arc<MapSnapshot>,
        request: RenderRequest,
    ) -> Result<Picture, QueryError> {
        self.send(|reply| Job::Render { snapshot, request, reply }).await
    }

    /// Compares several texts with each other.
    ///
    /// # Errors
    /// [`QueryError`] names what is wrong with the texts, or what failed.
    pub async fn segment(
        &self,
        snapshot: Arc<MapSnapshot>,
        contest: Contest,
    ) -> Result<Segmentation, QueryError> {
        let since = Instant::now();
        self.send(|reply| Job::Segment { snapshot, contest, since, reply }).await
    }

    /// Relevancies, 0..1, of codes `[n, code_size]` of the snapshot; 0 for codes of zeros.
    ///
    /// # Errors
    /// [`QueryError`] names what is wrong with the question, or what failed.
    pub async fn compare(
        &self,
        snapshot: Arc<MapSnapshot>,
        codes: Vec<f32>,
        query: Query,
    ) -> Result<Vec<f32>, QueryError> {
        self.send(|reply| Job::Compare { snapshot, codes, query, reply }).await
    }

    async fn send<T>(
        &self,
        job: impl FnOnce(oneshot::Sender<Result<T, QueryError>>) -> Job,
    ) -> Result<T, QueryError> {
        let queue = self.queue.as_ref().expect("only dropping takes the queue");
        let (reply, answer) = oneshot::channel();
        queue.send(job(reply)).await.map_err(|_| QueryError::Stopped)?;
        answer.await.map_err(|_| QueryError::Stopped)?
    }
}

impl Drop for QueryThread {
    fn drop(&mut self) {
        self.queue = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the query thread panicked");
        }
    }
}

/// What the thread owns.
pub(super) struct Worker {
    pub(super) config: QueryConfig,
    threshold: f32,
    presence: Presence,
    pub(super) feature_size: usize,
    pub(super) words: Words,
    pub(super) decoder: GenericDecoder,
    scene: Scene,
    views: ViewCache,
    pub(super) space: SpaceCache,
    palette: PaletteCache,
}

impl Worker {
    fn new(gpu: Gpu, networks: TextNetworks, config: QueryConfig) -> Self {
        let TextNetworks { tower, decompressor, mut relevancy, feature_size } = networks;
        relevancy.bias = config.bias.unwrap_or(relevancy.bias);
        let threshold = config.threshold.unwrap_or(relevancy.threshold);
        Self {
            threshold,
            presence: Presence::new(
                relevancy.present_threshold.unwrap_or(threshold),
                relevancy.confidence_steepness,
            ),
            feature_size,
            words: Words::new(tower, relevancy, config.cached_texts),
            decoder: GenericDecoder::new(decompressor),
            scene: Scene::new(gpu),
            views: ViewCache::default(),
            space: SpaceCache::new(config.feature_cache_mib),
            palette: PaletteCache::default(),
            config,
        }
    }

    fn work(mut self, mut jobs: mpsc::Receiver<Job>) {
        // Who asked may have gone away: then nobody takes the reply, and that is fine.
        while let Some(job) = jobs.blocking_recv() {
            match job {
                Job::Ask { asked, reply } => drop(reply.send(self.answer(&asked))),
                Job::Embed { text, reply } => drop(reply.send(self.words.embed(&text))),
                Job::Render { snapshot, request, reply } => {
                    let (scene, palette) = (&mut self.scene, &mut self.palette);
                    drop(reply.send(picture::render(scene, palette, &snapshot, &request)));
                }
                Job::Segment { snapshot, contest, since, reply } => {
                    drop(reply.send(self.segmentation(&snapshot, &contest, since)));
                }
                Job::Compare { snapshot, codes, query, reply } => {
                    drop(reply.send(self.compare(&snapshot, &codes, &query)));
                }
            }
        }
    }

    fn answer(&mut self, asked: &Asked) -> Result<Answer, QueryError> {
        let Asked { snapshot, query, since } = asked;
        let threshold = query.threshold.unwrap_or(self.threshold);
        if !(0.0..=1.0).contains(&threshold) {
            return Err(QueryError::BadThreshold { found: threshold });
        }
        let mut clock = Instant::now();
        let comparison = self.words.comparison(query)?;
        let text = lap(&mut clock);
        let mut answer = match &query.view {
            Some(view) => self.answer_view(snapshot, query, view, &comparison, threshold)?,
            None => self.answer_space(snapshot, query, &comparison, threshold)?,
        };
        answer.timing.text = text;
        answer.timing.total = milliseconds(*since);
        Ok(answer)
    }

    fn compare(
        &mut self,
        snapshot: &MapSnapshot,
        codes: &[f32],
        query: &Query,
    ) -> Result<Vec<f32>, QueryError> {
        let comparison = self.words.comparison(query)?;
        let mut found = Vec::with_capacity(codes.len() / snapshot.online.code_size());
        let generic = snapshot.online.decode(codes);
        self.decoder.decompress(&generic, |batch| found.extend(comparison.relevancies(batch)))?;
        for (code, found) in codes.chunks_exact(snapshot.online.code_size()).zip(&mut found) {
            if code.iter().all(|&value| value == 0.0) {
                *found = 0.0;
            }
        }
        Ok(found)
    }

    /// Decoded features of a view, with the time that rendering and decoding took.
    pub(super) fn features(
        &mut self,
        snapshot: &MapSnapshot,
        camera: &Camera,
        timing: &mut Timing,
    ) -> Result<Arc<ViewFeatures>, QueryError> {
        if let Some(features) = self.views.get(snapshot, camera) {
            return Ok(features);
        }
        let mut clock = Instant::now();
        let image = view::render(&mut self.scene, snapshot, camera, &self.config)?;
        timing.render = lap(&mut clock);
        let features = view::decode(&mut self.decoder, snapshot, &image, self.feature_size)?;
        timing.decode = lap(&mut clock);
        let features = Arc::new(features);
        self.views.put(snapshot, camera, features.clone());
        Ok(features)
    }

    fn answer_view(
        &mut self,
        snapshot: &MapSnapshot,
        query: &Query,
        view: &View,
        comparison: &Comparison,
        threshold: f32,
    ) -> Result<Answer, QueryError> {
        let camera = viewpoint::camera(snapshot, view)?;
        let mut timing = Timing::default();
        let features = self.features(snapshot, &camera, &mut timing)?;
        let mut clock = Instant::now();
        let side = self.config.smoothing(query.smoothing_pixels, camera.width);
        let relevancy = features.relevancy(comparison, &camera).smoothed(side);
        let peak = regions::peak(&relevancy);
        let boxes = regions::boxes(&relevancy, threshold);
        let scores = relevancy.values.iter().copied();
        let confidence = self.presence.confidence(scores, regions::least_pixels(&relevancy));
        let outputs = query.outputs;
        let mask = outputs.mask.then(|| regions::mask(&relevancy, threshold));
        timing.score = lap(&mut clock);
        Ok(Answer {
            revision: snapshot.revision,
            present: presence::is_present(confidence),
            confidence,
            coverage: features.coverage(),
            threshold,
            heatmap: outputs.heatmap.then_some(Heatmap {
                width: camera.width,
                height: camera.height,
                values: relevancy.values,
            }),
            mask,
            boxes: outputs.boxes.then_some(boxes),
            peak,
            points: None,
            objects: None,
            timing,
        })
    }

    fn answer_space(
        &mut self,
        snapshot: &MapSnapshot,
        query: &Query,
        comparison: &Comparison,
        threshold: f32,
    ) -> Result<Answer, QueryError> {
        let mut timing = Timing::default();
        let mut clock = Instant::now();
        let size = self.feature_size;
        self.space.prepare(&mut self.decoder, snapshot, size)?;
        timing.decode = lap(&mut clock);
        let scores = self.space.scores(&mut self.decoder, snapshot, comparison, threshold)?;
        let density =
            Density { metres: self.config.cluster_metres, points: self.config.cluster_points };
        let worth =
            Worth { threshold, score: self.config.object_score, size: self.config.object_size };
        let Clusters { mut objects, members } = clustered(&scores.relevant, density, worth);
        place::sort_out(&mut objects, &query.place);
        let points = query.outputs.points.then(|| {
            let covering: Vec<_> = members.iter().map(|&at| scores.relevant[at]).collect();
            let mut points = surface::sampled(&snapshot.gaussians.language, &covering);
            points.retain(|point| {
                query.place.within.is_none_or(|within| within.contains(&point.position))
            });
            points
        });
        let enough = self.config.cluster_points;
        let confidence = self.presence.confidence(scores.all.iter().copied(), enough);
        objects.truncate(query.max_objects);
        timing.score = lap(&mut clock);
        let outputs = query.outputs;
        Ok(Answer {
            revision: snapshot.revision,
            present: presence::is_present(confidence),
            confidence,
            coverage: scores.coverage,
            threshold,
            heatmap: None,
            mask: None,
            boxes: None,
            peak: None,
            points,
            objects: outputs.objects.then_some(objects),
            timing,
        })
    }
}

/// Milliseconds since the last lap.
pub(super) fn lap(clock: &mut Instant) -> f32 {
    milliseconds(std::mem::replace(clock, Instant::now()))
}

pub(super) fn milliseconds(since: Instant) -> f32 {
    since.elapsed().as_secs_f32() * 1e3
}
