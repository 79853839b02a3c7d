//! Sends keyframes to the language thread and counts what is under way.
//!
//! In: keyframes. Out: messages to the map's thread, one for each language map and one when a full queue has
//! room again. Nothing here waits.

use super::super::encoder::LanguageThread;
use super::super::frame::Frame;
use super::super::keyframes::KeyframeStore;
use super::super::map::Message;
use std::collections::VecDeque;
use std::sync::Arc;
use tokio::sync::mpsc;

/// Keyframes of one map on their way through the networks.
pub(super) struct LanguageRequests {
    thread: Arc<LanguageThread>,
    messages: mpsc::Sender<Message>,
    /// Keyframes that the language thread had no room for yet, oldest first.
    waiting: VecDeque<Frame>,
    /// Keyframes that the networks have, in the order in which they answer.
    in_flight: VecDeque<Frame>,
    /// Whether a message will come when the language thread has room.
    awaits_room: bool,
}

impl LanguageRequests {
    /// `messages`: where answers go, the queue of the map's own thread.
    pub fn new(thread: Arc<LanguageThread>, messages: mpsc::Sender<Message>) -> Self {
        Self {
            thread,
            messages,
            waiting: VecDeque::new(),
            in_flight: VecDeque::new(),
            awaits_room: false,
        }
    }

    /// Whether a keyframe waits for the networks or is with them.
    pub fn is_pending(&self) -> bool {
        !self.in_flight.is_empty() || !self.waiting.is_empty()
    }

    /// Keyframes without language, oldest first.
    pub fn pending(&self) -> Vec<Frame> {
        self.in_flight.iter().chain(&self.waiting).cloned().collect()
    }

    /// Queues a keyframe behind those that wait.
    pub fn push(&mut self, keyframe: Frame) {
        self.waiting.push_back(keyframe);
    }

    /// [`Message::Language`] has arrived.
    pub fn answered(&mut self) {
        self.in_flight.pop_front();
    }

    /// [`Message::LanguageRoom`] has arrived.
    pub fn has_room(&mut self) {
        self.awaits_room = false;
    }

    /// Sends what the language thread has room for. Keyframes that were forgotten meanwhile are skipped.
    pub fn send(&mut self, keyframes: &KeyframeStore) {
        while !self.awaits_room
            && let Some(frame) = self.waiting.pop_front()
        {
            let sequence = frame.sequence;
            if !keyframes.contains(sequence) {
                continue;
            }
            // The map may have been deleted when an answer comes: sending fails and nothing is lost.
            let messages = self.messages.clone();
            let reply = move |map| {
                let _ = messages.blocking_send(Message::Language { sequence, map });
            };
            let messages = self.messages.clone();
            let on_room = move || {
                let _ = messages.blocking_send(Message::LanguageRoom);
            };
            let sent = frame.clone();
            match self.thread.submit(frame, reply, on_room) {
                Ok(()) => self.in_flight.push_back(sent),
                Err(frame) => {
                    self.waiting.push_front(frame);
                    self.awaits_room = true;
                }
            }
        }
    }
}
