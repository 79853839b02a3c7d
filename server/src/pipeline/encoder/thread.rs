//! The thread that owns the vision networks, shared by all maps.

use super::config::LanguageConfig;
use super::labels::Embed;
use super::language_map::LanguageMap;
use super::vision::Vision;
use crate::pipeline::frame::Frame;
use crate::pipeline::network::VisionNetworks;
use crate::telemetry::LANGUAGE_SECONDS;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::Instant;

type Reply = Box<dyn FnOnce(Result<LanguageMap, String>) + Send>;

struct Job {
    frame: Frame,
    reply: Reply,
}

/// A handle to the thread "language". Dropping it lets the thread finish its queue and waits for
/// it.
pub struct LanguageThread {
    /// `None` only while dropping.
    queue: Option<SyncSender<Job>>,
    thread: Option<JoinHandle<()>>,
}

impl LanguageThread {
    /// Starts the thread; it takes the networks with it. `embed` makes features of labels' texts.
    ///
    /// # Errors
    /// The system's, if there is no thread to be had.
    pub fn start(
        networks: VisionNetworks,
        embed: Embed,
        config: &LanguageConfig,
    ) -> std::io::Result<Self> {
        let (queue, jobs) = sync_channel(config.queue.max(1));
        let vision = Vision::new(networks, embed, config);
        let thread = std::thread::Builder::new()
            .name("language".into())
            .spawn(move || work(vision, &jobs))?;
        Ok(Self { queue: Some(queue), thread: Some(thread) })
    }

    /// Queues a keyframe. `reply` runs on the language thread and must not block for long.
    ///
    /// # Errors
    /// Gives the frame back if the queue is full (ask again later) or the thread has ended.
    #[expect(
        clippy::result_large_err,
        reason = "the frame goes back to the caller, not up the stack"
    )]
    pub fn try_submit(
        &self,
        frame: Frame,
        reply: impl FnOnce(Result<LanguageMap, String>) + Send + 'static,
    ) -> Result<(), Frame> {
        let queue = self.queue.as_ref().expect("only dropping takes the queue");
        queue.try_send(Job { frame, reply: Box::new(reply) }).map_err(|refused| match refused {
            TrySendError::Full(job) | TrySendError::Disconnected(job) => job.frame,
        })
    }
}

impl Drop for LanguageThread {
    fn drop(&mut self) {
        self.queue = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the language thread panicked");
        }
    }
}

fn work(mut vision: Vision, jobs: &Receiver<Job>) {
    while let Ok(Job { frame, reply }) = jobs.recv() {
        let started = Instant::now();
        let result = vision.run(&frame);
        metrics::histogram!(LANGUAGE_SECONDS).record(started.elapsed());
        if let Ok(map) = &result {
            tracing::debug!(sequence = frame.sequence, timing = ?map.timing, "keyframe read");
        }
        reply(result.map_err(|error| error.to_string()));
    }
}
