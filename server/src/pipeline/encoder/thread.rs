//! The thread that owns the vision networks, shared by all maps.

use super::config::LanguageConfig;
use super::labels::Embed;
use super::language_map::LanguageMap;
use super::vision::Vision;
use crate::pipeline::frame::Frame;
use crate::pipeline::network::VisionNetworks;
use crate::telemetry::LANGUAGE_SECONDS;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Instant;

type Reply = Box<dyn FnOnce(Result<LanguageMap, String>) + Send>;
/// Callbacks of maps that found the queue full.
type RoomWatchers = Arc<Mutex<Vec<Box<dyn FnOnce() + Send>>>>;

struct Job {
    frame: Frame,
    reply: Reply,
}

/// A handle to the thread "language". Dropping it lets the thread finish its queue and waits for
/// it.
pub struct LanguageThread {
    /// `None` only during the drop.
    queue: Option<SyncSender<Job>>,
    watchers: RoomWatchers,
    thread: Option<JoinHandle<()>>,
}

impl LanguageThread {
    /// Starts the thread and gives it the networks. `embed` embeds the texts of labels.
    ///
    /// # Errors
    /// The system's error if it has no thread left.
    pub fn start(
        networks: VisionNetworks,
        embed: Embed,
        config: &LanguageConfig,
    ) -> std::io::Result<Self> {
        let (queue, jobs) = sync_channel(config.queue.max(1));
        let vision = Vision::new(networks, embed, config);
        let watchers = RoomWatchers::default();
        let shared = watchers.clone();
        let thread = std::thread::Builder::new()
            .name("language".into())
            .spawn(move || work(vision, &jobs, &shared))?;
        Ok(Self { queue: Some(queue), watchers, thread: Some(thread) })
    }

    /// Queues a keyframe. `reply` runs on the language thread and must not block for long. If the
    /// queue is full, `on_room` runs there as soon as it has room again, so that callers need not
    /// poll.
    ///
    /// # Errors
    /// Gives the frame back if the queue is full or the thread has ended.
    #[expect(
        clippy::result_large_err,
        reason = "the frame goes back to the caller, not up the stack"
    )]
    pub fn submit(
        &self,
        frame: Frame,
        reply: impl FnOnce(Result<LanguageMap, String>) + Send + 'static,
        on_room: impl FnOnce() + Send + 'static,
    ) -> Result<(), Frame> {
        let queue = self.queue.as_ref().expect("only dropping takes the queue");
        match queue.try_send(Job { frame, reply: Box::new(reply) }) {
            Ok(()) => Ok(()),
            Err(TrySendError::Disconnected(job)) => Err(job.frame),
            Err(TrySendError::Full(job)) => {
                lock(&self.watchers).push(Box::new(on_room));
                // The thread may have taken a job before it could see the callback. If the queue is
                // still full now, the next job that it takes calls back.
                queue.try_send(job).map_err(|refused| match refused {
                    TrySendError::Full(job) | TrySendError::Disconnected(job) => job.frame,
                })
            }
        }
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

fn lock(watchers: &RoomWatchers) -> MutexGuard<'_, Vec<Box<dyn FnOnce() + Send>>> {
    watchers.lock().expect("no thread panics while it holds the callbacks")
}

fn work(mut vision: Vision, jobs: &Receiver<Job>, watchers: &RoomWatchers) {
    while let Ok(Job { frame, reply }) = jobs.recv() {
        // Taken out first: a callback may block, and must not hold the lock meanwhile.
        let callbacks = std::mem::take(&mut *lock(watchers));
        callbacks.into_iter().for_each(|on_room| on_room());
        let started = Instant::now();
        let result = vision.run(&frame);
        metrics::histogram!(LANGUAGE_SECONDS).record(started.elapsed());
        if let Ok(map) = &result {
            tracing::debug!(sequence = frame.sequence, timing = ?map.timing, "keyframe encoded");
        }
        reply(result.map_err(|error| error.to_string()));
    }
}
