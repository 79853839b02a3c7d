//! A queue that serves clients in turn.
//!
//! In: jobs, each of a client. Out: one job at a time: the oldest one of the client that has waited longest
//! for its turn. So a client with many jobs makes itself wait, not the others.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Who asks.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Client {
    /// Somebody outside: the name of a caller, or an address.
    Caller(Arc<str>),
    /// The server itself.
    Server,
}

impl Client {
    /// Somebody outside, with the name of a caller or an address.
    pub fn new(name: &str) -> Self {
        Self::Caller(name.into())
    }
}

/// Why a job was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refused {
    /// So many jobs of the client wait already.
    Full(usize),
    Closed,
}

/// The queue. It is closed for new jobs on request; jobs that wait are still served.
pub(super) struct FairQueue<J> {
    state: Mutex<State<J>>,
    changed: Condvar,
}

struct State<J> {
    waiting: Waiting<J>,
    is_closed: bool,
}

/// Jobs that wait, in the order of their turns.
pub(super) struct Waiting<J> {
    /// Jobs of one client that may wait.
    most_of_client: usize,
    /// Clients with jobs, the next one first.
    turns: VecDeque<Client>,
    jobs: HashMap<Client, VecDeque<J>>,
}

impl<J> FairQueue<J> {
    pub fn new(most_of_client: usize) -> Self {
        let state = State { waiting: Waiting::new(most_of_client), is_closed: false };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// Adds a job.
    ///
    /// # Errors
    /// [`Refused`]; then the job is dropped.
    pub fn push(&self, client: &Client, job: J) -> Result<(), Refused> {
        let mut state = self.state();
        if state.is_closed {
            return Err(Refused::Closed);
        }
        state.waiting.push(client, job)?;
        self.changed.notify_one();
        Ok(())
    }

    /// The next job; waits for one. `None` once the queue is closed and empty.
    pub fn pop(&self) -> Option<J> {
        let mut state = self.state();
        loop {
            if let Some(job) = state.waiting.next() {
                return Some(job);
            }
            if state.is_closed {
                return None;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Whether it refuses jobs.
    pub fn is_closed(&self) -> bool {
        self.state().is_closed
    }

    /// Takes no more jobs; those that wait are still handed out.
    pub fn close(&self) {
        self.state().is_closed = true;
        self.changed.notify_all();
    }

    fn state(&self) -> MutexGuard<'_, State<J>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<J> Waiting<J> {
    pub fn new(most_of_client: usize) -> Self {
        Self { most_of_client, turns: VecDeque::new(), jobs: HashMap::new() }
    }

    /// Adds a job.
    ///
    /// # Errors
    /// [`Refused::Full`]; then the job is dropped.
    pub fn push(&mut self, client: &Client, job: J) -> Result<(), Refused> {
        let jobs = self.jobs.entry(client.clone()).or_default();
        if jobs.len() >= self.most_of_client {
            return Err(Refused::Full(jobs.len()));
        }
        jobs.push_back(job);
        if jobs.len() == 1 {
            self.turns.push_back(client.clone());
        }
        Ok(())
    }

    /// The next job, if there is one.
    pub fn next(&mut self) -> Option<J> {
        let client = self.turns.pop_front()?;
        let jobs = self.jobs.get_mut(&client)?;
        let job = jobs.pop_front();
        if jobs.is_empty() {
            self.jobs.remove(&client);
        } else {
            self.turns.push_back(client);
        }
        job
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clients_take_turns() {
        let queue = FairQueue::new(100);
        let (many, few) = (Client::new("many"), Client::new("few"));
        (0..50).for_each(|job| queue.push(&many, job).unwrap());
        queue.push(&few, 1000).unwrap();
        queue.push(&few, 1001).unwrap();
        let served: Vec<i32> = (0..6).filter_map(|_| queue.pop()).collect();
        assert_eq!(served, [0, 1000, 1, 1001, 2, 3]);
    }

    #[test]
    fn a_client_that_has_too_many_is_refused_alone() {
        let queue = FairQueue::new(2);
        let (many, few) = (Client::new("many"), Client::new("few"));
        queue.push(&many, 0).unwrap();
        queue.push(&many, 1).unwrap();
        assert_eq!(queue.push(&many, 2), Err(Refused::Full(2)));
        queue.push(&few, 3).unwrap();
        assert_eq!(queue.pop(), Some(0));
        queue.push(&many, 4).unwrap();
    }

    #[test]
    fn a_closed_queue_is_emptied() {
        let queue = Arc::new(FairQueue::new(2));
        let client = Client::Server;
        queue.push(&client, 0).unwrap();
        queue.close();
        assert_eq!(queue.push(&client, 1), Err(Refused::Closed));
        assert_eq!((queue.pop(), queue.pop()), (Some(0), None));

        let waiting = Arc::new(FairQueue::<u8>::new(2));
        let thread = std::thread::Builder::new().spawn({
            let waiting = waiting.clone();
            move || waiting.pop()
        });
        waiting.close();
        assert_eq!(thread.unwrap().join().unwrap(), None);
    }
}
