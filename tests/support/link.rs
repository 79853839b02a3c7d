//! A link between two programs that can be cut and slowed down: TCP through this process.

use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

/// Bytes that are passed on at once.
const BLOCK: usize = 16 << 10;

/// What a link does with what it is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Passing {
    /// Passes it on.
    All,
    /// Keeps it, as a network that is cut: nobody is told.
    Nothing,
    /// Passes on this many bytes a second.
    Slowly(u32),
}

/// A link to one address. It ends with its runtime.
#[derive(Clone)]
pub struct Link {
    /// Where it listens.
    pub address: String,
    passing: Arc<watch::Sender<Passing>>,
}

impl Link {
    /// A link to an address, where nobody has to listen yet.
    pub async fn to(target: &str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port is free");
        let address = listener.local_addr().expect("it is bound").to_string();
        let passing = Arc::new(watch::Sender::new(Passing::All));
        tokio::spawn(accept(listener, target.to_owned(), passing.clone()));
        Self { address, passing }
    }

    /// What it does from now on, also for open connections.
    pub fn set(&self, passing: Passing) {
        self.passing.send_replace(passing);
    }
}

async fn accept(listener: TcpListener, target: String, passing: Arc<watch::Sender<Passing>>) {
    while let Ok((from, _)) = listener.accept().await {
        let (target, passing) = (target.clone(), passing.clone());
        tokio::spawn(async move {
            // Who connects to nobody is told so.
            let Ok(to) = TcpStream::connect(target).await else { return };
            let (from_reads, from_writes) = from.into_split();
            let (to_reads, to_writes) = to.into_split();
            tokio::select! {
                () = pass(from_reads, to_writes, passing.subscribe()) => {}
                () = pass(to_reads, from_writes, passing.subscribe()) => {}
            }
        });
    }
}

/// Passes bytes on until one side has ended.
async fn pass(
    mut from: OwnedReadHalf,
    mut to: OwnedWriteHalf,
    mut passing: watch::Receiver<Passing>,
) {
    let mut block = vec![0; BLOCK];
    loop {
        let Ok(count @ 1..) = from.read(&mut block).await else { return };
        let is_open = passing.wait_for(|passing| *passing != Passing::Nothing).await;
        let Ok(passing) = is_open.map(|passing| *passing) else { return };
        if let Passing::Slowly(bytes) = passing {
            tokio::time::sleep(Duration::from_secs_f64(count as f64 / f64::from(bytes))).await;
        }
        if to.write_all(&block[..count]).await.is_err() {
            return;
        }
    }
}
