//! Turns at something that one client has at a time; clients get it in turn.

use super::error::QueryError;
use super::fair_queue::{Client, Waiting};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::oneshot;

/// Who has the turn, and who waits for it. Cheap to clone.
#[derive(Clone)]
pub(crate) struct Turns(Arc<Mutex<State>>);

struct State {
    is_taken: bool,
    waiting: Waiting<oneshot::Sender<Turn>>,
}

/// The turn of one client, until it is dropped.
pub(crate) struct Turn(Turns);

impl Turns {
    /// `most_of_client`: how often one client may wait.
    pub fn new(most_of_client: usize) -> Self {
        let state = State { is_taken: false, waiting: Waiting::new(most_of_client) };
        Self(Arc::new(Mutex::new(state)))
    }

    /// Waits for a turn. Dropping the future gives it up.
    ///
    /// # Errors
    /// [`QueryError::TooMany`] if the client waits too often already.
    pub async fn wait(&self, client: &Client) -> Result<Turn, QueryError> {
        let received = {
            let mut state = self.state();
            if !state.is_taken {
                state.is_taken = true;
                return Ok(Turn(self.clone()));
            }
            let (turn, received) = oneshot::channel();
            state.waiting.push(client, turn)?;
            received
        };
        received.await.map_err(|_| QueryError::Stopped)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let next = {
            let mut state = self.0.state();
            let next = state.waiting.next();
            state.is_taken = next.is_some();
            next
        };
        // If nobody waits there any more, the new turn is dropped at once, and the one after it gets it.
        let _ = next.map(|next| next.send(Turn(self.0.clone())));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::sync::mpsc;

    #[tokio::test]
    async fn clients_take_turns_and_who_gives_up_is_left_out() {
        let turns = Turns::new(3);
        let first = turns.wait(&Client::Server).await.unwrap();
        let (served, mut order) = mpsc::channel(8);
        let mut waiting = Vec::new();
        for (name, number) in [("many", 0), ("many", 1), ("many", 2), ("few", 3)] {
            let (turns, served) = (turns.clone(), served.clone());
            waiting.push(tokio::spawn(async move {
                let _turn = turns.wait(&Client::new(name)).await.unwrap();
                served.send(number).await.unwrap();
            }));
            // Until it waits.
            tokio::task::yield_now().await;
        }
        let refused = turns.wait(&Client::new("many")).await;
        assert!(matches!(refused, Err(QueryError::TooMany { waiting: 3 })));
        waiting.remove(1).abort();
        drop(first);
        let mut found = Vec::new();
        for _ in 0..3 {
            found.push(order.recv().await.unwrap());
        }
        assert_eq!(found, [0, 3, 2]);
        for task in waiting {
            task.await.unwrap();
        }
        turns.wait(&Client::new("many")).await.unwrap();
    }
}
