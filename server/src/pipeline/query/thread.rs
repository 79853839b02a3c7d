//! The query thread: a bounded queue of requests in front of a [`Worker`].
//!
//! Requests are answered one after the other. When the queue is full, callers wait.

use super::answer::{Answer, RenderedImage, Segmentation};
use super::config::QueryConfig;
use super::error::QueryError;
use super::request::{Query, RenderRequest, SegmentationRequest};
use super::worker::Worker;
use crate::pipeline::encoder::Embed;
use crate::pipeline::network::TextNetworks;
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::Gpu;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;
use tokio::sync::{mpsc, oneshot};

/// Work for the thread; it sends its own reply.
type Job = Box<dyn FnOnce(&mut Worker) + Send>;

/// A handle to the query thread. Dropping it lets the thread finish its queue and waits for it.
pub struct QueryThread {
    /// `None` only during the drop.
    queue: Option<mpsc::Sender<Job>>,
    thread: Option<JoinHandle<()>>,
}

impl QueryThread {
    /// Starts the thread, which owns the networks and a renderer.
    ///
    /// # Errors
    /// The system's, if the thread cannot be started.
    pub fn start(gpu: Gpu, networks: TextNetworks, config: &QueryConfig) -> std::io::Result<Self> {
        let (queue, mut jobs) = mpsc::channel::<Job>(config.queue);
        let mut worker = Worker::new(gpu, networks, config.clone());
        let thread = std::thread::Builder::new().name("query".into()).spawn(move || {
            while let Some(job) = jobs.blocking_recv() {
                job(&mut worker);
            }
        })?;
        Ok(Self { queue: Some(queue), thread: Some(thread) })
    }

    /// Answers a question.
    ///
    /// # Errors
    /// [`QueryError`] names the field at fault, or the failure.
    pub async fn ask(
        &self,
        snapshot: Arc<MapSnapshot>,
        query: Query,
    ) -> Result<Answer, QueryError> {
        let received = Instant::now();
        self.run(move |worker| worker.answer(&snapshot, &query, received)).await
    }

    /// Labels each pixel or Gaussian with the most relevant of several texts.
    ///
    /// # Errors
    /// [`QueryError`] names the field at fault, or the failure.
    pub async fn segment(
        &self,
        snapshot: Arc<MapSnapshot>,
        request: SegmentationRequest,
    ) -> Result<Segmentation, QueryError> {
        let received = Instant::now();
        self.run(move |worker| worker.segment(&snapshot, &request, received)).await
    }

    /// Renders an image.
    ///
    /// # Errors
    /// [`QueryError`] names the field at fault, or the failure.
    pub(crate) async fn render(
        &self,
        snapshot: Arc<MapSnapshot>,
        request: RenderRequest,
    ) -> Result<RenderedImage, QueryError> {
        self.run(move |worker| worker.render(&snapshot, &request)).await
    }

    /// Relevancies, 0..1, of codes `[n, code_size]` of the snapshot to a query; 0 for codes of
    /// zeros.
    ///
    /// # Errors
    /// [`QueryError`] names the field at fault, or the failure.
    pub(crate) async fn relevancies(
        &self,
        snapshot: Arc<MapSnapshot>,
        codes: Vec<f32>,
        query: Query,
    ) -> Result<Vec<f32>, QueryError> {
        self.run(move |worker| worker.relevancies(&snapshot, &codes, &query)).await
    }

    /// A function that embeds texts on the query thread, for other threads of the pipeline. It
    /// blocks, so the query thread itself must not call it. It does not keep the query thread
    /// alive.
    pub(crate) fn embedder(&self) -> Embed {
        let queue = self.queue().downgrade();
        Box::new(move |text| {
            let stopped = || QueryError::Stopped.to_string();
            let queue = queue.upgrade().ok_or_else(stopped)?;
            let text = text.to_owned();
            let (job, embedding) = job(move |worker| worker.embed(&text));
            queue.blocking_send(job).map_err(|_| stopped())?;
            drop(queue);
            let embedding = embedding.blocking_recv().map_err(|_| stopped())?;
            embedding.map_err(|error| error.to_string())
        })
    }

    /// Runs `work` on the thread.
    async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Worker) -> Result<T, QueryError> + Send + 'static,
    ) -> Result<T, QueryError> {
        let (job, result) = job(work);
        self.queue().send(job).await.map_err(|_| QueryError::Stopped)?;
        result.await.map_err(|_| QueryError::Stopped)?
    }

    fn queue(&self) -> &mpsc::Sender<Job> {
        self.queue.as_ref().expect("only the drop takes the queue")
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

/// A job that sends the result of `work`. The receiver may be dropped before.
fn job<T: Send + 'static>(
    work: impl FnOnce(&mut Worker) -> T + Send + 'static,
) -> (Job, oneshot::Receiver<T>) {
    let (reply, result) = oneshot::channel();
    (Box::new(move |worker| drop(reply.send(work(worker)))), result)
}
