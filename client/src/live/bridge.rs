//! Both sides of a bridge together.

use super::board::{Board, BridgeEvent, BridgeProgress};
use super::options::{BridgeError, BridgeOptions};
use super::{robot, sink};
use crate::dataset::is_map_name;
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
/// [`BridgeError`] if an address or the map's name is wrong, something else than a robot answers, the server
/// refuses the map, or no frame came until the bridge was stopped.
pub async fn bridge(
    options: &BridgeOptions,
    stop: impl Future<Output = ()>,
    tell: impl Fn(BridgeEvent) + Sync,
) -> Result<BridgeProgress, BridgeError> {
    if !is_map_name(&options.map) {
        return Err(BridgeError::Name { found: options.map.clone() });
    }
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
    let received = receiving.await;
    match sent {
        Some(sent) => sent?,
        None => {
            received?;
            match timeout(LAST, sending).await {
                Ok(sent) => sent?,
                Err(_) => board.tell("the server does not answer: the last frames may be missing"),
            }
        }
    }
    Ok(board.progress())
}
