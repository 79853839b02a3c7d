//! The query thread: a queue of requests in front of a [`Worker`].
//!
//! Requests are answered one after the other; clients take turns.

use super::answer::{Answer, RenderedImage, Segmentation};
use super::config::QueryConfig;
use super::error::QueryError;
use super::fair_queue::{Client, FairQueue};
use super::request::{Query, RenderRequest, SegmentationRequest};
use super::worker::Worker;
use crate::pipeline::encoder::Embed;
use crate::pipeline::network::TextNetworks;
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::Gpu;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;
use tokio::sync::oneshot;

/// Work for the thread; it sends its own reply.
type Job = Box<dyn FnOnce(&mut Worker) + Send>;

type Queue = Arc<FairQueue<Job>>;

/// A handle to the query thread. Dropping it lets the thread finish its queue and waits for it.
pub struct QueryThread {
    queue: Queue,
    thread: Option<JoinHandle<()>>,
}

impl QueryThread {
    /// Starts the thread, which owns the networks and a renderer.
    ///
    /// # Errors
    /// The system's, if the thread cannot be started.
    pub fn start(gpu: Gpu, networks: TextNetworks, config: &QueryConfig) -> std::io::Result<Self> {
        let queue: Queue = Arc::new(FairQueue::new(config.queue));
        let jobs = queue.clone();
        let mut worker = Worker::new(gpu, networks, config.clone());
        let thread = std::thread::Builder::new().name("query".into()).spawn(move || {
            let _closed = CloseOnDrop(jobs.clone());
            while let Some(job) = jobs.pop() {
                // Whoever asked is told; what the worker caches is taken out while it is changed.
                if catch_unwind(AssertUnwindSafe(|| job(&mut worker))).is_err() {
                    tracing::error!("answering a question panicked");
                }
            }
        })?;
        Ok(Self { queue, thread: Some(thread) })
    }

    /// Answers a question.
    ///
    /// # Errors
    /// [`QueryError`] names the field at fault, or the failure.
    pub async fn ask(
        &self,
        client: &Client,
        snapshot: Arc<MapSnapshot>,
        query: Query,
    ) -> Result<Answer, QueryError> {
        let received = Instant::now();
        self.run(client, move |worker| worker.answer(&snapshot, &query, received)).await
    }

    /// Labels each pixel or Gaussian with the most relevant of several texts.
    ///
    /// # Errors
    /// [`QueryError`] names the field at fault, or the failure.
    pub async fn segment(
        &self,
        client: &Client,
        snapshot: Arc<MapSnapshot>,
        request: SegmentationRequest,
    ) -> Result<Segmentation, QueryError> {
        let received = Instant::now();
        self.run(client, move |worker| worker.segment(&snapshot, &request, received)).await
    }

    /// Renders an image.
    ///
    /// # Errors
    /// [`QueryError`] names the field at fault, or the failure.
    pub(crate) async fn render(
        &self,
        client: &Client,
        snapshot: Arc<MapSnapshot>,
        request: RenderRequest,
    ) -> Result<RenderedImage, QueryError> {
        self.run(client, move |worker| worker.render(&snapshot, &request)).await
    }

    /// Relevancies, 0..1, of codes `[n, code_size]` of the snapshot to a query; 0 for codes of
    /// zeros.
    ///
    /// # Errors
    /// [`QueryError`] names the field at fault, or the failure.
    pub(crate) async fn relevancies(
        &self,
        client: &Client,
        snapshot: Arc<MapSnapshot>,
        codes: Vec<f32>,
        query: Query,
    ) -> Result<Vec<f32>, QueryError> {
        self.run(client, move |worker| worker.relevancies(&snapshot, &codes, &query)).await
    }

    /// A function that embeds texts on the query thread, for other threads of the pipeline. It
    /// blocks, so the query thread itself must not call it.
    pub(crate) fn embedder(&self) -> Embed {
        let queue = self.queue.clone();
        Box::new(move |text| {
            let text = text.to_owned();
            let (job, embedding) = job(move |worker| worker.embed(&text));
            push(&queue, &Client::Server, job).map_err(|error| error.to_string())?;
            let embedding =
                embedding.blocking_recv().map_err(|_| QueryError::Stopped.to_string())?;
            embedding.map_err(|error| error.to_string())
        })
    }

    /// Runs `work` on the thread.
    pub(super) async fn run<T: Send + 'static>(
        &self,
        client: &Client,
        work: impl FnOnce(&mut Worker) -> Result<T, QueryError> + Send + 'static,
    ) -> Result<T, QueryError> {
        let (job, result) = job(work);
        push(&self.queue, client, job)?;
        let lost = |_| match self.queue.is_closed() {
            true => QueryError::Stopped,
            false => QueryError::Panicked,
        };
        result.await.map_err(lost)?
    }
}

fn push(queue: &Queue, client: &Client, job: Job) -> Result<(), QueryError> {
    Ok(queue.push(client, job)?)
}

/// Closes the queue, and with it the replies of the jobs in it, when the thread ends.
struct CloseOnDrop(Queue);

impl Drop for CloseOnDrop {
    fn drop(&mut self) {
        self.0.close();
        while self.0.pop().is_some() {}
    }
}

impl Drop for QueryThread {
    fn drop(&mut self) {
        self.queue.close();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the query thread panicked");
        }
    }
}

/// A job that sends the result of `work`. It does nothing if nobody waits for the result any more.
fn job<T: Send + 'static>(
    work: impl FnOnce(&mut Worker) -> T + Send + 'static,
) -> (Job, oneshot::Receiver<T>) {
    let (reply, result) = oneshot::channel();
    let run = move |worker: &mut Worker| {
        if !reply.is_closed() {
            // An error means that the receiver was dropped in the meantime.
            let _ = reply.send(work(worker));
        }
    };
    (Box::new(run), result)
}
