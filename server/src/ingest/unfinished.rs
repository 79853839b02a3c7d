//! Limits the memory of gRPC messages that have begun and are not complete.
//!
//! In: the bodies of all requests. Out: the same, until a message takes too long, or until all unfinished
//! messages together are too large. Then the call with the most unfinished bytes ends, so that large messages
//! which somebody began and never completes do not shut out ordinary frames.

use crate::telemetry::UNFINISHED_ENDED;
use axum::BoxError;
use axum::body::Body;
use http_body::{Body as HttpBody, Frame};
use std::collections::HashMap;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::time::{Instant, Sleep, sleep};
use tokio_util::sync::{CancellationToken, WaitForCancellationFutureOwned};
use tonic::Status;

/// Length of the header before each message: a flag, and the size of the message, big-endian.
const HEADER: usize = 5;

/// The unfinished bytes of all calls. Cheap to clone.
#[derive(Clone)]
pub(super) struct Unfinished {
    /// Bytes that all calls may have together.
    most: usize,
    /// How long a message may take from its first byte to its last.
    message_timeout: Duration,
    calls: Arc<Mutex<Calls>>,
}

#[derive(Default)]
struct Calls {
    next_id: u64,
    total: usize,
    open: HashMap<u64, Call>,
}

struct Call {
    bytes: usize,
    /// Cancelled when the call has to end.
    ended: CancellationToken,
}

impl Unfinished {
    pub(super) fn new(most: usize, message_timeout: Duration) -> Self {
        Self { most, message_timeout, calls: Arc::default() }
    }

    /// The body of a request, with its unfinished bytes counted.
    pub(super) fn watch(&self, body: Body) -> Body {
        let ended = CancellationToken::new();
        let mut calls = self.calls();
        let id = calls.next_id;
        calls.next_id += 1;
        calls.open.insert(id, Call { bytes: 0, ended: ended.clone() });
        Body::new(Watched {
            body,
            id,
            ended: Box::pin(ended.cancelled_owned()),
            deadline: Box::pin(sleep(self.message_timeout)),
            message: Message::default(),
            all: self.clone(),
        })
    }

    fn calls(&self) -> MutexGuard<'_, Calls> {
        self.calls.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the unfinished bytes of a call. Ends the call with the most if all together are too many.
    fn set(&self, id: u64, bytes: usize) {
        let mut calls = self.calls();
        calls.set(id, bytes);
        if calls.total > self.most
            && let Some((&largest, call)) = calls.open.iter().max_by_key(|(_, call)| call.bytes)
        {
            call.ended.cancel();
            metrics::counter!(UNFINISHED_ENDED, "reason" => "bytes").increment(1);
            // Its memory is free as soon as its task runs.
            calls.set(largest, 0);
            calls.open.remove(&largest);
        }
    }
}

impl Calls {
    /// Does nothing for a call that has ended.
    fn set(&mut self, id: u64, bytes: usize) {
        if let Some(call) = self.open.get_mut(&id) {
            self.total = self.total - call.bytes + bytes;
            call.bytes = bytes;
        }
    }
}

/// Where the bytes of a call are in its messages.
#[derive(Default)]
struct Message {
    header: [u8; HEADER],
    /// Bytes of the header that have come.
    header_bytes: usize,
    /// Bytes of the message that are missing.
    missing: usize,
    /// Bytes since the reader last had all of them.
    unfinished: usize,
}

impl Message {
    fn is_complete(&self) -> bool {
        self.header_bytes == HEADER && self.missing == 0
    }

    /// Takes the next bytes.
    fn add(&mut self, mut data: &[u8]) {
        while !data.is_empty() {
            if self.is_complete() {
                *self = Self::default();
            }
            if self.header_bytes < HEADER {
                let taken = data.len().min(HEADER - self.header_bytes);
                let (header, rest) = data.split_at(taken);
                self.header[self.header_bytes..][..taken].copy_from_slice(header);
                self.header_bytes += taken;
                self.unfinished += taken;
                data = rest;
                let [_, a, b, c, d] = self.header;
                if self.header_bytes == HEADER {
                    self.missing = u32::from_be_bytes([a, b, c, d]) as usize;
                }
            }
            let taken = data.len().min(self.missing);
            self.missing -= taken;
            self.unfinished += taken;
            data = &data[taken..];
        }
    }
}

/// The body of a request.
struct Watched {
    body: Body,
    id: u64,
    ended: Pin<Box<WaitForCancellationFutureOwned>>,
    deadline: Pin<Box<Sleep>>,
    message: Message,
    all: Unfinished,
}

impl Watched {
    fn add(&mut self, data: &[u8]) {
        if self.message.unfinished == 0 {
            self.deadline.as_mut().reset(Instant::now() + self.all.message_timeout);
        }
        self.message.add(data);
        self.all.set(self.id, self.message.unfinished);
    }

    /// Why the call has to end; pending as long as it need not.
    fn poll_end(&mut self, context: &mut Context<'_>) -> Poll<Status> {
        if self.ended.as_mut().poll(context).is_ready() {
            return Poll::Ready(Status::resource_exhausted(
                "the server holds too many bytes of unfinished messages, and this call has the most: send the \
                 message again, in one go (limit: ingest.max_unfinished_bytes)",
            ));
        }
        if self.message.unfinished > 0 && self.deadline.as_mut().poll(context).is_ready() {
            metrics::counter!(UNFINISHED_ENDED, "reason" => "time").increment(1);
            let limit = self.all.message_timeout;
            return Poll::Ready(Status::deadline_exceeded(format!(
                "a message was not complete after {limit:?} (limit: ingest.message_seconds)"
            )));
        }
        Poll::Pending
    }
}

impl HttpBody for Watched {
    type Data = <Body as HttpBody>::Data;
    type Error = BoxError;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Self::Data>, BoxError>>> {
        let this = &mut *self;
        if this.message.is_complete() {
            // The reader asks for more, so it has taken what it had.
            this.message = Message::default();
            this.all.set(this.id, 0);
        }
        if let Poll::Ready(status) = this.poll_end(context) {
            return Poll::Ready(Some(Err(status.into())));
        }
        let polled = Pin::new(&mut this.body).poll_frame(context).map_err(BoxError::from);
        if let Poll::Ready(Some(Ok(frame))) = &polled
            && let Some(data) = frame.data_ref()
        {
            this.add(data);
            // It may be this call that has to end, or the time of the message may begin.
            if let Poll::Ready(status) = this.poll_end(context) {
                return Poll::Ready(Some(Err(status.into())));
            }
        }
        polled
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        let mut calls = self.all.calls();
        calls.set(self.id, 0);
        calls.open.remove(&self.id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures::StreamExt as _;
    use http_body_util::{BodyExt as _, StreamBody};
    use tokio::sync::mpsc::{Sender, channel};
    use tokio_stream::wrappers::ReceiverStream;
    use tonic::Code;

    /// A message of `size` bytes.
    fn message(size: usize) -> Vec<u8> {
        let mut bytes = vec![0; HEADER + size];
        bytes[1..HEADER].copy_from_slice(&u32::try_from(size).unwrap().to_be_bytes());
        bytes
    }

    /// A body that is sent piece by piece.
    fn sent(all: &Unfinished) -> (Sender<Vec<u8>>, Body) {
        let (sender, receiver) = channel::<Vec<u8>>(16);
        let frames = ReceiverStream::new(receiver)
            .map(|bytes| Ok::<_, Status>(Frame::data(axum::body::Bytes::from(bytes))));
        (sender, all.watch(Body::new(StreamBody::new(frames))))
    }

    async fn next(body: &mut Body) -> Result<usize, Code> {
        let frame = body.frame().await.expect("it has not ended");
        let code =
            |error: axum::Error| Status::try_from_error(error.into()).expect("a status").code();
        frame.map(|frame| frame.into_data().unwrap().len()).map_err(code)
    }

    #[tokio::test]
    async fn the_largest_unfinished_message_ends_and_others_go_on() {
        let all = Unfinished::new(1000, Duration::from_secs(600));
        let ((large, mut large_body), (small, mut small_body)) = (sent(&all), sent(&all));
        large.send(message(5000)[..700].to_vec()).await.unwrap();
        assert_eq!(next(&mut large_body).await, Ok(700));
        small.send(message(5000)[..250].to_vec()).await.unwrap();
        assert_eq!(next(&mut small_body).await, Ok(250));
        assert_eq!(all.calls().total, 950);
        small.send(vec![0; 100]).await.unwrap();
        assert_eq!(next(&mut small_body).await, Ok(100), "it has the smaller message");
        assert_eq!(next(&mut large_body).await, Err(Code::ResourceExhausted));
        assert_eq!(all.calls().total, 350);
        drop((large_body, small_body));
        let calls = all.calls();
        assert_eq!((calls.total, calls.open.len()), (0, 0));
    }

    #[tokio::test]
    async fn complete_messages_do_not_add_up() {
        let all = Unfinished::new(1000, Duration::from_secs(600));
        let (sender, mut body) = sent(&all);
        for _ in 0..20 {
            // Two messages and the beginning of a third; then its rest.
            let bytes = [message(100), message(200), message(300)].concat();
            sender.send(bytes[..400].to_vec()).await.unwrap();
            assert_eq!(next(&mut body).await, Ok(400));
            assert_eq!(all.calls().total, 400 - 2 * HEADER - 300);
            sender.send(bytes[400..].to_vec()).await.unwrap();
            assert_eq!(next(&mut body).await, Ok(bytes.len() - 400));
            assert_eq!(all.calls().total, HEADER + 300, "the reader has not asked for more");
        }
    }

    #[tokio::test]
    async fn a_message_has_to_be_complete_in_time() {
        let all = Unfinished::new(1000, Duration::from_millis(100));
        let (sender, mut body) = sent(&all);
        // Nothing is unfinished between messages.
        sender.send(message(10)).await.unwrap();
        assert_eq!(next(&mut body).await, Ok(15));
        let nothing = tokio::time::timeout(Duration::from_millis(400), body.frame()).await;
        assert!(nothing.is_err(), "it waits for the next message");
        sender.send(message(10)[..7].to_vec()).await.unwrap();
        assert_eq!(next(&mut body).await, Ok(7));
        assert_eq!(next(&mut body).await, Err(Code::DeadlineExceeded));
    }
}
