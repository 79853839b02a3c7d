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

    /// Calls `changed` whenever the contents have changed, until `stopping` is cancelled. Contents
    /// count when they are the same at two looks: a file may be half written at the first, and a
    /// certificate is replaced before its key.
    pub(crate) async fn follow(mut self, mut changed: impl FnMut(), stopping: CancellationToken) {
        let follow = async {
            let mut last = self.contents.clone();
            loop {
                tokio::time::sleep(PERIOD).await;
                let paths = self.paths.clone();
                let Ok(now) = tokio::task::spawn_blocking(move || contents(&paths)).await else {
                    return;
                };
                if now == last && now != self.contents {
                    self.contents.clone_from(&now);
                    changed();
                }
                last = now;
            }
        };
        stopping.run_until_cancelled(follow).await;
    }
}

fn contents(paths: &[PathBuf]) -> Vec<Option<Vec<u8>>> {
    paths.iter().map(|path| std::fs::read(path).ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Arc, Mutex};

    #[tokio::test]
    async fn changes_are_told_once_and_half_written_files_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, "old").unwrap();
        let watch = FileWatch::new(vec![path.clone()]);
        let seen = Arc::new(Mutex::new(Vec::new()));
        let stopping = CancellationToken::new();
        let (noted, read) = (seen.clone(), path.clone());
        let note = move || noted.lock().unwrap().push(std::fs::read_to_string(&read).unwrap());
        let following = tokio::spawn(watch.follow(note, stopping.clone()));
        // Another text at each look: nothing counts before the last.
        for number in 0..30 {
            std::fs::write(&path, format!("half written {number}")).unwrap();
            tokio::time::sleep(PERIOD / 10).await;
        }
        assert!(seen.lock().unwrap().is_empty());
        std::fs::write(&path, "new").unwrap();
        while seen.lock().unwrap().is_empty() {
            tokio::time::sleep(PERIOD / 10).await;
        }
        tokio::time::sleep(3 * PERIOD).await;
        assert_eq!(*seen.lock().unwrap(), ["new"]);
        stopping.cancel();
        following.await.unwrap();
    }
}
