//! How slowly a client may send or take an archive.

use std::io::{Error, ErrorKind};
use std::time::Duration;
use tokio::time::{Instant, timeout};

/// Fewer bytes a second are too slow.
const BYTES_PER_SECOND: u32 = 16 << 10;

/// Waits for a client as long as it keeps a pace. Bytes earn time for waiting, but never more than at the
/// beginning: so many bytes sent fast do not pay for a long pause.
pub(super) struct Pace {
    left: Duration,
    most: Duration,
}

impl Pace {
    /// `most`: how long a client that moves nothing is waited for.
    pub(super) fn new(most: Duration) -> Self {
        Self { left: most, most }
    }

    /// Waits for the client to do something.
    ///
    /// # Errors
    /// [`ErrorKind::TimedOut`] if it is too slow.
    pub(super) async fn wait<T>(&mut self, client: impl Future<Output = T>) -> Result<T, Error> {
        let began = Instant::now();
        let done = timeout(self.left, client).await;
        self.waited(began.elapsed());
        done.map_err(|_| {
            let least = BYTES_PER_SECOND >> 10;
            let reason = format!("fewer than {least} KiB a second for {:?}", self.most);
            Error::new(ErrorKind::TimedOut, reason)
        })
    }

    fn waited(&mut self, time: Duration) {
        self.left = self.left.saturating_sub(time);
    }

    /// The client has sent or taken so many bytes.
    pub(super) fn moved(&mut self, bytes: usize) {
        let earned = Duration::from_secs_f64(bytes as f64 / f64::from(BYTES_PER_SECOND));
        self.left = (self.left + earned).min(self.most);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds until a client is given up that moves so many bytes in each; at most 1000.
    fn lasts(mut pace: Pace, bytes: usize) -> usize {
        let is_waited_for = |_: &usize| {
            pace.waited(Duration::from_secs(1));
            pace.moved(bytes);
            pace.left >= Duration::from_secs(1)
        };
        (0..1000).take_while(is_waited_for).count() + 1
    }

    #[tokio::test]
    async fn who_keeps_the_pace_is_waited_for() {
        let pace = || Pace::new(Duration::from_secs(30));
        assert!(lasts(pace(), 16 << 10) > 1000);
        assert_eq!(lasts(pace(), 1), 30, "drop by drop");
        assert_eq!(lasts(pace(), 8 << 10), 59, "at half the pace");
        let mut fast_first = pace();
        fast_first.moved(1 << 30);
        assert_eq!(lasts(fast_first, 1), 30, "bytes at first pay for no pause");
        let mut pace = Pace::new(Duration::from_millis(1));
        let told = pace.wait(std::future::pending::<()>()).await.unwrap_err();
        assert!(
            told.kind() == ErrorKind::TimedOut && told.to_string().contains("16 KiB"),
            "{told}"
        );
    }
}
