//! Progress bars on standard error.

use indicatif::{ProgressBar, ProgressStyle};
use lexsplat_client::stream::{FrameStatus, Progress, Summary};

/// A bar for `frames` frames.
pub fn progress_bar(frames: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} frames, {eta} left  {msg}")
        .expect("the template is constant");
    ProgressBar::new(frames).with_style(style)
}

/// Shows the progress of a stream on the bar, and above it what is wrong with the frames.
pub fn show(bar: &ProgressBar, progress: &Progress) {
    for warning in &progress.input_warnings {
        let (sequence, message) = (warning.sequence, &warning.message);
        bar.suspend(|| note!("lexsplat: warning (frame {sequence}): {message}"));
    }
    bar.set_length(progress.total);
    bar.set_position(progress.acknowledged);
    let state = match progress.status {
        FrameStatus::Tracked => "tracking",
        FrameStatus::Relocalised => "relocalised",
        FrameStatus::Refused => "refused",
        FrameStatus::Lost | FrameStatus::Unspecified => "lost",
        FrameStatus::Opened => "opened",
    };
    bar.set_message(format!(
        "{:.1} frames/s  {state}  queue {}/{}",
        progress.frames_per_second, progress.queue_depth, progress.queue_capacity
    ));
}

/// Says on standard error how many frames could not be read, and why the first.
pub fn tell_left_out(summary: &Summary) {
    if let [first, ..] = &summary.left_out_frames[..] {
        note!("lexsplat: {} frames left out: {}", summary.left_out, first.reason);
    }
}
