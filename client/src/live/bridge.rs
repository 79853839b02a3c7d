//! Both sides of a bridge together.

use super::board::{Board, BridgeEvent, BridgeProgress};
use super::options::{BridgeError, BridgeOptions};
use super::{robot, sink};
use std::pin::pin;
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio::time::timeout;

/// Frames that wait for the server. When they are as many, new ones are left out: a robot does not wait.
const WAITING: usize = 32;
/// How long the last frames may take after the bridge was stopped.
const LAST: Duration = Duration::from_secs(30);

/// Streams what a robot sends into a map until `stop` is done, or as many frames are acknowledged as the
/// options say. Then the frames that wait are still sent. Connects again, with growing waits, when the
/// robot or the server goes away.
///
/// # Errors
/// [`BridgeError`] if an address is wrong, or the server refuses the map.
pub async fn bridge(
    options: &BridgeOptions,
    stop: impl Future<Output = ()>,
    tell: impl Fn(BridgeEvent) + Sync,
) -> Result<BridgeProgress, BridgeError> {
    let board = Board::new(&tell);
    let (out, passed) = mpsc::channel(WAITING);
    let (end, ends) = watch::channel(false);
    let mut sending = pin!(sink::send(options, passed, &board));
    let mut receiving = pin!(robot::receive(options, out, ends, &board));
    let sent = tokio::select! {
        sent = &mut sending => Some(sent),
        received = &mut receiving => return received.map(|()| board.progress()),
        () = stop => None,
    };
    end.send_replace(true);
    receiving.await?;
    match sent {
        Some(sent) => sent?,
        None => match timeout(LAST, sending).await {
            Ok(sent) => sent?,
            Err(_) => board.tell("the server does not answer: the last frames may be missing"),
        },
    }
    Ok(board.progress())
}
