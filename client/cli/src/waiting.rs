//! Reading a map once it has used the frames that were acknowledged. A frame is acknowledged when it is
//! tracked; its Gaussians and its language come later. The server does the waiting.

use anyhow::Result;
use indicatif::ProgressBar;
use lexsplat_client::Access;
use lexsplat_client::http::{HttpClient, HttpError, ReadOf};
use std::time::Duration;

const TICK: Duration = Duration::from_millis(120);

/// How long a command waits.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Waiting {
    /// Wait at most this long until the map has used all acknowledged frames; 0: do not wait
    #[arg(long, value_name = "SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u64).range(..=600))]
    wait: u64,
    /// Wait until the map has been refined as well
    #[arg(long)]
    converged: bool,
}

impl Waiting {
    /// A client whose questions and files wait.
    ///
    /// # Errors
    /// If the address or a certificate is wrong.
    pub fn client(&self, http: &str, access: &Access) -> Result<HttpClient, HttpError> {
        let client = HttpClient::with_access(http, access)?.waiting(self.wait);
        Ok(if self.converged { client.until_converged() } else { client })
    }
}

/// Shows that a request waits until it is answered.
pub async fn shown<T>(request: impl Future<Output = T>) -> T {
    let spinner = ProgressBar::new_spinner().with_message("waiting for the map");
    spinner.enable_steady_tick(TICK);
    let answer = request.await;
    spinner.finish_and_clear();
    answer
}

/// Says what an answer or a file is of, if the map was not settled.
pub fn note(of: &ReadOf) {
    if let Some(note) = unsettled(of) {
        note!("note: {note}");
    }
}

fn unsettled(of: &ReadOf) -> Option<String> {
    let frame = match of.through {
        Some(through) => format!("through frame {through}"),
        None => "before its first frame".to_owned(),
    };
    let revision = of.revision;
    (!of.settled).then(|| {
        format!(
            "the map is not settled: this is of revision {revision}, {frame}. --wait SECONDS waits longer"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_not_settled_is_noted() {
        let of = ReadOf { revision: 7, through: Some(59), settled: false, converged: false };
        let note = unsettled(&of).unwrap();
        assert!(note.contains("revision 7, through frame 59"), "{note}");
        assert!(unsettled(&ReadOf { through: None, ..of }).unwrap().contains("before its first"));
        assert!(unsettled(&ReadOf { settled: true, ..of }).is_none());
    }
}
