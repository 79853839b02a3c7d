//! Waiting until a map has used the frames that were acknowledged. A frame is acknowledged when it is
//! tracked; its Gaussians and its language come later.

use anyhow::Result;
use indicatif::ProgressBar;
use lexsplat_client::http::{HttpClient, Status};
use std::time::Duration;

/// How long a command waits.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Waiting {
    /// Wait at most this long until the map has used all acknowledged frames; 0: do not wait
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    wait: u64,
}

impl Waiting {
    /// Waits until the map is settled. If it is not in time, says so and what the answer is of.
    ///
    /// # Errors
    /// If there is no such map, it has failed, or the server does not answer.
    pub async fn until_settled(&self, client: &HttpClient, map: &str) -> Result<()> {
        let spinner = ProgressBar::new_spinner();
        let settled = client.settled(map, |status| {
            spinner.set_message(format!("waiting for the map: {}", work(status)));
            spinner.tick();
        });
        let done = tokio::time::timeout(Duration::from_secs(self.wait), settled).await;
        spinner.finish_and_clear();
        if let Ok(settled) = done {
            settled?;
            return Ok(());
        }
        let status = client.status(map).await?;
        if !status.settled {
            eprintln!(
                "note: the map is not settled ({}): this is of revision {}. --wait SECONDS waits longer",
                work(&status),
                status.revision
            );
        }
        Ok(())
    }
}

/// What the map still has to do.
fn work(status: &Status) -> String {
    match status.queue_depth {
        0 => "it is being optimised".into(),
        frames => format!("{frames} frames wait"),
    }
}
