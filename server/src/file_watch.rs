//! Following files that may be replaced while the server runs: tokens and certificates.
//!
//! The contents are compared every [`PERIOD`]. Notifications of the file system would be faster, and
//! miss changes on network file systems and behind the symbolic links of mounted secrets.

use std::path::PathBuf;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Time between looks.
const PERIOD: Duration = Duration::from_secs(1);

/// Files, and what was in them when they were last looked at.
pub(crate) struct FileWatch {
    paths: Vec<PathBuf>,
    /// A file that is missing has no contents.
    contents: Vec<Option<Vec<u8>>>,
}

impl FileWatch {
    /// Looks at the files. Make it before they are read, so that no change is missed.
    pub(crate) fn new(paths: Vec<PathBuf>) -> Self {
        Self { contents: contents(&paths), paths }
    }

    /// Calls `changed` whenever the contents have changed, until `stopping` is cancelled.
    pub(crate) async fn follow(mut self, mut changed: impl FnMut(), stopping: CancellationToken) {
        let follow = async {
            loop {
                tokio::time::sleep(PERIOD).await;
                let paths = self.paths.clone();
                let Ok(now) = tokio::task::spawn_blocking(move || contents(&paths)).await else {
                    return;
                };
                if now != self.contents {
                    self.contents = now;
                    changed();
                }
            }
        };
        stopping.run_until_cancelled(follow).await;
    }
}

fn contents(paths: &[PathBuf]) -> Vec<Option<Vec<u8>>> {
    paths.iter().map(|path| std::fs::read(path).ok()).collect()
}
