//! Foxglove's WebSocket protocol, as far as a subscriber needs it: `foxglove.sdk.v1`, and
//! `foxglove.websocket.v1` of earlier bridges. In: text and binary messages. Out: channels, data, and
//! requests as JSON.

use serde::Deserialize;
use tokio_tungstenite::tungstenite::Bytes;

/// The protocols that are spoken, newest first, as in the header `Sec-WebSocket-Protocol`.
pub(super) const PROTOCOLS: &str = "foxglove.sdk.v1, foxglove.websocket.v1";
/// The first byte of data.
const DATA: u8 = 1;
/// Bytes before the payload: the kind, a subscription (u32) and a time (u64), little-endian.
const HEAD: usize = 1 + 4 + 8;

/// A topic that the robot offers.
#[derive(Clone, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "camelCase")]
pub(super) struct Channel {
    pub id: u64,
    pub topic: String,
    pub encoding: String,
    pub schema_name: String,
}

/// What a robot says in JSON.
#[derive(Debug, Deserialize, PartialEq, Eq)]
#[serde(tag = "op", rename_all = "camelCase")]
pub(super) enum Said {
    /// Who it is.
    ServerInfo { name: String },
    /// What it offers.
    Advertise { channels: Vec<Channel> },
    /// What it no longer offers.
    #[serde(rename_all = "camelCase")]
    Unadvertise { channel_ids: Vec<u64> },
    /// That something is wrong: 0 information, 1 a warning, 2 an error.
    Status { level: u8, message: String },
    /// What does not matter here.
    #[serde(other)]
    Other,
}

/// Reads what a robot says.
pub(super) fn said(text: &str) -> Result<Said, String> {
    serde_json::from_str(text).map_err(|error| format!("expected JSON of the protocol: {error}"))
}

/// A message of a topic.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Data {
    pub subscription: u32,
    /// When the robot received or logged it, nanoseconds.
    pub nanos: u64,
    pub payload: Bytes,
}

/// Reads a binary message; `None` if it is of another kind, or too short.
pub(super) fn data(message: &Bytes) -> Option<Data> {
    let (head, _) = message.split_at_checked(HEAD)?;
    let subscription = u32::from_le_bytes(head[1..5].try_into().expect("four bytes"));
    let nanos = u64::from_le_bytes(head[5..].try_into().expect("eight bytes"));
    (head[0] == DATA).then(|| Data { subscription, nanos, payload: message.slice(HEAD..) })
}

/// Asks for channels, each under a number of our own.
pub(super) fn subscribe(subscriptions: &[(u32, u64)]) -> String {
    let each = subscriptions
        .iter()
        .map(|(id, channel)| serde_json::json!({ "id": id, "channelId": channel }));
    let all: Vec<_> = each.collect();
    serde_json::json!({ "op": "subscribe", "subscriptions": all }).to_string()
}

/// Asks for no more of some subscriptions.
pub(super) fn unsubscribe(subscriptions: &[u32]) -> String {
    serde_json::json!({ "op": "unsubscribe", "subscriptionIds": subscriptions }).to_string()
}
