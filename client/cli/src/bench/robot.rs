//! A robot that sends frames at a constant rate, whether or not the last one is acknowledged.

use super::plan::{BenchError, Plan};
use lexsplat_client::dataset::{Dataset, RgbdFrame};
use lexsplat_client::stream::{
    Acks, ClientError, FrameSender, FrameStatus, FrameStream, MapSpec, Poses,
};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::Instant;

/// Frames queued between a robot and its connection. Further ones wait, and their latency counts.
const BETWEEN: usize = 2;
/// Frames kept in memory; longer runs go back and forth over them.
const MOST_FRAMES: usize = 300;

/// The outcome of a robot's frames.
#[derive(Default)]
pub(super) struct Sent {
    pub sent: u64,
    pub tracked: u64,
    pub lost: u64,
    pub refused: u64,
    pub latencies: Vec<Duration>,
}

/// An open stream, with its frames in memory.
pub(super) struct Robot {
    frames: Vec<RgbdFrame>,
    period: Duration,
    outbound: FrameSender,
    acks: Acks,
}

impl Robot {
    /// Reads or renders the frames and opens the map.
    pub(super) async fn ready(
        plan: &Plan,
        map: &str,
        dataset: Arc<dyn Dataset>,
    ) -> Result<Self, BenchError> {
        let count = dataset.len().min(MOST_FRAMES);
        let source = dataset.clone();
        let read = move || (0..count).map(|at| source.frame(at)).collect::<Result<Vec<_>, _>>();
        let frames = tokio::task::spawn_blocking(read).await.map_err(|_| BenchError::Panicked)?;
        let frames = frames.map_err(ClientError::from)?;
        if let Some(frame) = frames.iter().find(|frame| frame.world_from_camera.is_none()) {
            return Err(ClientError::NoPose { sequence: frame.sequence }.into());
        }
        let spec = MapSpec {
            map: map.to_owned(),
            cameras: dataset.cameras(),
            depth_unit_metres: dataset.depth_unit_metres(),
            poses: Poses::Given,
            label_texts: Vec::new(),
        };
        let FrameStream { frames: outbound, acks, .. } =
            FrameStream::open(&plan.grpc, &plan.access, spec, BETWEEN).await?;
        let period = Duration::from_secs_f64(1.0 / plan.frames_per_second);
        Ok(Self { frames, period, outbound, acks })
    }

    /// Sends the frames that are due between `begin` and `end` and waits for every acknowledgement;
    /// the first one adds one to `first_acks`.
    pub(super) async fn run(
        self,
        begin: Instant,
        end: Instant,
        first_acks: Arc<watch::Sender<usize>>,
    ) -> Result<Sent, BenchError> {
        let Self { frames, period, outbound, mut acks } = self;
        let sending = tokio::spawn(async move {
            for number in 0_u32.. {
                let due = begin + period * number;
                if due >= end {
                    break;
                }
                tokio::time::sleep_until(due).await;
                let frame = numbered(&frames, u64::from(number), period);
                if !outbound.send(frame).await {
                    break;
                }
            }
        });
        let mut sent = Sent::default();
        while let Some(ack) = acks.next().await? {
            let due = begin + period * u32::try_from(ack.sequence).unwrap_or(u32::MAX);
            sent.latencies.push(due.elapsed());
            sent.sent += 1;
            match ack.status() {
                FrameStatus::Tracked | FrameStatus::Relocalised => sent.tracked += 1,
                FrameStatus::Refused => sent.refused += 1,
                FrameStatus::Lost | FrameStatus::Opened | FrameStatus::Unspecified => {
                    sent.lost += 1
                }
            }
            if sent.sent == 1 {
                first_acks.send_modify(|robots| *robots += 1);
            }
        }
        sending.await.map_err(|_| BenchError::Panicked)?;
        Ok(sent)
    }
}

/// Frame `number`: back and forth over the frames in memory, so that the camera never jumps.
fn numbered(frames: &[RgbdFrame], number: u64, period: Duration) -> RgbdFrame {
    let mut frame = frames[back_and_forth(number, frames.len())].clone();
    frame.sequence = number;
    frame.timestamp_nanos = number * period.as_nanos() as u64;
    frame
}

fn back_and_forth(number: u64, count: usize) -> usize {
    if count == 1 {
        return 0;
    }
    let there = count as u64 - 1;
    let at = number % (2 * there);
    at.min(2 * there - at) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_go_back_and_forth() {
        let found: Vec<usize> = (0..9).map(|number| back_and_forth(number, 4)).collect();
        assert_eq!(found, [0, 1, 2, 3, 2, 1, 0, 1, 2]);
        assert_eq!(back_and_forth(5, 1), 0);
    }
}
