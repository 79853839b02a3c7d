//! The side of the robot: connects, subscribes, and passes frames on.

use super::board::Board;
use super::connect::{NotConnected, Socket, connect, request};
use super::intake::{Arrived, Intake};
use super::options::{BridgeError, BridgeOptions, Waits};
use super::protocol::{self, Channel, Said};
use crate::dataset::RgbdFrame;
use crate::messages::Decoder;
use crate::stream::MapSpec;
use futures::{SinkExt as _, StreamExt as _};
use std::collections::HashMap;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, watch};
use tokio::time::{MissedTickBehavior, interval, timeout};
use tokio_tungstenite::tungstenite::{Message, Utf8Bytes};

/// How long saying goodbye may take.
const GOODBYE: Duration = Duration::from_secs(2);
/// How long topics are looked at before some are chosen.
const LOOK: Duration = Duration::from_secs(2);
/// After so long without a choice, the robot is asked anew for what it sends only once.
const LOOK_AGAIN: Duration = Duration::from_secs(60);
/// Between two reminders of what is missing.
const REMIND: Duration = Duration::from_secs(10);
const TICK: Duration = Duration::from_millis(500);
const PING_EVERY: Duration = Duration::from_secs(5);
/// Channels that the robot does not know are asked for again so often at most.
const MOST_ASKED_AGAIN: u32 = 20;
/// A robot that says nothing, not even to a ping, is gone.
const SILENCE: Duration = Duration::from_secs(20);

/// What is passed on to the server's side.
pub(super) enum Passed {
    /// The map to open; first.
    Map(Box<MapSpec>),
    /// A frame without a number.
    Frame(Box<RgbdFrame>),
}

/// Connects again and again, until `ends` is true or nobody takes frames any more. `out` is dropped at the
/// end.
///
/// # Errors
/// [`BridgeError`] if the address is wrong, something else than a robot answers, or no frame came.
pub(super) async fn receive(
    options: &BridgeOptions,
    out: mpsc::Sender<Passed>,
    mut ends: watch::Receiver<bool>,
    board: &Board<'_>,
) -> Result<(), BridgeError> {
    let request = request(&options.robot)?;
    let url = request.uri().to_string();
    let mut intake = Intake::new(&options.wanted, options.poses);
    let mut waits = Waits::new();
    let mut last = String::new();
    while !*ends.borrow() && !out.is_closed() {
        let connecting = tokio::select! {
            connecting = connect(request.clone()) => connecting,
            _ = ends.wait_for(|end| *end) => break,
        };
        let reason = match connecting {
            Err(NotConnected { reason, is_other: true })
                if board.progress().robot_connections == 0 =>
            {
                return Err(BridgeError::NoRobot { robot: url, reason });
            }
            Err(NotConnected { reason, .. }) => format!("cannot connect to {url}: {reason}"),
            Ok(socket) => {
                board.count(|counts| counts.robot_connections += 1);
                board.tell(format!("connected to {url}"));
                let mut session = Session::new(socket, &mut intake, &out, board, &options.map);
                let reason = tokio::select! {
                    reason = session.run() => reason,
                    _ = ends.wait_for(|end| *end) => {
                        let _ = timeout(GOODBYE, session.socket.close(None)).await;
                        last = session.missing.unwrap_or_else(|| board.progress().missing());
                        break;
                    }
                };
                if session.has_data {
                    waits = Waits::new();
                }
                reason
            }
        };
        if !intake.is_running() {
            intake = Intake::new(&options.wanted, options.poses);
        }
        let wait = waits.next();
        board.tell(format!("{reason}; trying again in {:.1} s", wait.as_secs_f64()));
        last = reason;
        let _ = timeout(wait, ends.wait_for(|end| *end)).await;
    }
    match board.progress().frames {
        0 => Err(BridgeError::NoFrames { robot: url, reason: last }),
        _ => Ok(()),
    }
}

/// A topic that was asked for.
struct Subscribed {
    channel: u64,
    topic: String,
    decoder: Decoder,
}

/// One connection.
struct Session<'a> {
    socket: Socket,
    intake: &'a mut Intake,
    out: &'a mpsc::Sender<Passed>,
    board: &'a Board<'a>,
    map: &'a str,
    /// By our own numbers.
    subscribed: HashMap<u32, Subscribed>,
    next: u32,
    began: Instant,
    heard: Instant,
    pinged: Instant,
    reminded: Option<Instant>,
    /// What is missing before topics can be chosen, in words.
    missing: Option<String>,
    has_data: bool,
    /// Channels that were asked for before the robot knew them.
    early: Vec<u64>,
    /// How many times they were asked for again.
    asked_again: u32,
}

impl<'a> Session<'a> {
    fn new(
        socket: Socket,
        intake: &'a mut Intake,
        out: &'a mpsc::Sender<Passed>,
        board: &'a Board<'a>,
        map: &'a str,
    ) -> Self {
        let now = Instant::now();
        Self {
            socket,
            intake,
            out,
            board,
            map,
            subscribed: HashMap::new(),
            next: 0,
            began: now,
            heard: now,
            pinged: now,
            reminded: None,
            missing: None,
            has_data: false,
            early: Vec::new(),
            asked_again: 0,
        }
    }

    /// Until the connection ends; why, in words.
    async fn run(&mut self) -> String {
        let mut tick = interval(TICK);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let done = tokio::select! {
                message = self.socket.next() => match message {
                    None => Err("the robot closed the connection".to_owned()),
                    Some(Err(error)) => Err(format!("the connection to the robot broke: {error}")),
                    Some(Ok(message)) => self.heard(message).await,
                },
                _ = tick.tick() => self.tick().await,
            };
            if let Err(reason) = done {
                return reason;
            }
        }
    }

    async fn send(&mut self, message: Message) -> Result<(), String> {
        let sent = self.socket.send(message).await;
        sent.map_err(|error| format!("the connection to the robot broke: {error}"))
    }

    async fn heard(&mut self, message: Message) -> Result<(), String> {
        self.heard = Instant::now();
        match message {
            Message::Text(text) => self.said(&text).await,
            Message::Binary(bytes) => {
                let Some(data) = protocol::data(&bytes) else { return Ok(()) };
                let Some(from) = self.subscribed.get(&data.subscription) else { return Ok(()) };
                let (topic, decoder) = (from.topic.clone(), from.decoder);
                let arrived = Arrived { topic, decoder, nanos: data.nanos, payload: data.payload };
                if !self.has_data {
                    (self.has_data, self.began) = (true, Instant::now());
                }
                self.take(arrived)
            }
            _ => Ok(()),
        }
    }

    async fn said(&mut self, text: &Utf8Bytes) -> Result<(), String> {
        match protocol::said(text)? {
            Said::ServerInfo { name } => self.board.tell(format!("the robot is {name}")),
            Said::Status { level, message } if level > 0 => match self.not_yet_known(&message) {
                Some(channel) => self.early.push(channel),
                None => self.board.tell(format!("the robot says: {message}")),
            },
            Said::Advertise { channels } => return self.subscribe(channels).await,
            Said::Unadvertise { channel_ids } => {
                self.subscribed.retain(|_, known| !channel_ids.contains(&known.channel));
            }
            Said::Status { .. } | Said::Other => {}
        }
        Ok(())
    }

    /// The channel that was asked for before the robot could give it: Foxglove's SDK advertises channels a
    /// moment before it knows them.
    fn not_yet_known(&self, status: &str) -> Option<u64> {
        let channel = status.strip_prefix("Unknown channel ID: ")?.trim().parse().ok()?;
        let is_wanted = self.subscribed.values().any(|known| known.channel == channel);
        (is_wanted && self.asked_again < MOST_ASKED_AGAIN).then_some(channel)
    }

    /// Asks again for channels that the robot did not know yet.
    async fn ask_again(&mut self) -> Result<(), String> {
        let early = std::mem::take(&mut self.early);
        let again = self.subscribed.iter().filter(|(_, known)| early.contains(&known.channel));
        let again: Vec<(u32, u64)> = again.map(|(id, known)| (*id, known.channel)).collect();
        if again.is_empty() {
            return Ok(());
        }
        self.asked_again += 1;
        self.send(Message::text(protocol::subscribe(&again))).await
    }

    async fn subscribe(&mut self, channels: Vec<Channel>) -> Result<(), String> {
        let mut asked = Vec::new();
        for Channel { id, topic, encoding, schema_name } in channels {
            let is_known = self.subscribed.values().any(|known| known.channel == id);
            let Some(decoder) = Decoder::of(&encoding, &schema_name) else { continue };
            if is_known || !self.intake.needs(&topic, decoder) {
                continue;
            }
            self.board.tell(format!("topic {topic} ({schema_name})"));
            asked.push((self.next, id));
            self.subscribed.insert(self.next, Subscribed { channel: id, topic, decoder });
            self.next += 1;
        }
        if asked.is_empty() {
            return Ok(());
        }
        self.send(Message::text(protocol::subscribe(&asked))).await
    }

    /// Takes a message and passes on the frames that are whole now.
    fn take(&mut self, arrived: Arrived) -> Result<(), String> {
        let mut frames = Vec::new();
        self.board.count(|counts| {
            self.intake.take(arrived, counts);
            frames = self.intake.frames(counts);
        });
        for frame in frames {
            match self.out.try_send(Passed::Frame(Box::new(frame))) {
                Ok(()) => {}
                Err(mpsc::error::TrySendError::Full(_)) => {
                    self.board.count(|counts| counts.dropped += 1);
                }
                Err(mpsc::error::TrySendError::Closed(_)) => return Err("the bridge ends".into()),
            }
        }
        Ok(())
    }

    async fn tick(&mut self) -> Result<(), String> {
        if self.heard.elapsed() > SILENCE {
            return Err(format!("the robot said nothing for {} s", SILENCE.as_secs()));
        }
        if self.pinged.elapsed() > PING_EVERY {
            self.pinged = Instant::now();
            self.send(Message::Ping(Vec::new().into())).await?;
        }
        self.ask_again().await?;
        match self.has_data && !self.intake.is_running() && self.began.elapsed() >= LOOK {
            true => self.choose().await,
            false => Ok(()),
        }
    }

    async fn choose(&mut self) -> Result<(), String> {
        match self.intake.choose(self.map) {
            Ok((spec, notes)) => {
                self.missing = None;
                notes.into_iter().for_each(|note| self.board.tell(note));
                let passed = self.out.send(Passed::Map(Box::new(spec))).await;
                passed.map_err(|_| "the bridge ends".to_owned())?;
                self.unsubscribe().await
            }
            Err(reason) if self.began.elapsed() > LOOK_AGAIN => Err(reason),
            Err(reason) => {
                if self.reminded.is_none_or(|told| told.elapsed() > REMIND) {
                    self.reminded = Some(Instant::now());
                    self.board.tell(format!("waiting: {reason}"));
                }
                self.missing = Some(reason);
                Ok(())
            }
        }
    }

    /// Asks for no more of pictures that are not used.
    async fn unsubscribe(&mut self) -> Result<(), String> {
        let intake = &self.intake;
        let idle = self.subscribed.iter().filter(|(_, k)| !intake.needs(&k.topic, k.decoder));
        let idle: Vec<u32> = idle.map(|(id, _)| *id).collect();
        self.subscribed.retain(|id, _| !idle.contains(id));
        if idle.is_empty() {
            return Ok(());
        }
        self.send(Message::text(protocol::unsubscribe(&idle))).await
    }
}
