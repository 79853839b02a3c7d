//! Connecting to a robot, and what it means if that fails.

use super::options::BridgeError;
use super::protocol;
use std::io::{self, ErrorKind};
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::Error;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::error::ProtocolError;
use tokio_tungstenite::tungstenite::handshake::client::Request;
use tokio_tungstenite::tungstenite::http::{HeaderValue, header::SEC_WEBSOCKET_PROTOCOL};
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async_with_config};

const CONNECT_WITHIN: Duration = Duration::from_secs(10);
/// The largest message: a raw picture of 5000x4000 pixels, bytes.
const LARGEST: usize = 64 << 20;

/// The request for a connection to `ws://HOST:PORT`, `wss://HOST:PORT` or `HOST:PORT`.
pub(super) fn request(robot: &str) -> Result<Request, BridgeError> {
    let wrong = |reason: String| BridgeError::Address { found: robot.to_owned(), reason };
    let url = if robot.contains("://") { robot.to_owned() } else { format!("ws://{robot}") };
    let mut request = url.into_client_request().map_err(|error| wrong(error.to_string()))?;
    let scheme = request.uri().scheme_str().unwrap_or_default();
    if scheme != "ws" && scheme != "wss" {
        return Err(wrong(format!("{scheme} is no WebSocket")));
    }
    if request.uri().host().unwrap_or_default().is_empty() {
        return Err(wrong("there is no host".into()));
    }
    // Without this check, a port that is no port counts as none, and 80 is meant.
    let authority = request.uri().authority().map_or("", |authority| authority.as_str());
    let port = authority.rsplit_once(':').map(|(_, port)| port).filter(|port| !port.ends_with(']'));
    if port.is_some_and(|port| port.parse::<u16>().is_err()) {
        return Err(wrong("a port is a number up to 65535".into()));
    }
    let protocols = HeaderValue::from_static(protocol::PROTOCOLS);
    request.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, protocols);
    Ok(request)
}

pub(super) type Socket = WebSocketStream<MaybeTlsStream<TcpStream>>;

/// Why no connection came about.
pub(super) struct NotConnected {
    /// In words.
    pub reason: String,
    /// Something else than a robot answers there: trying again does not help.
    pub is_other: bool,
}

/// Connects to a robot that speaks Foxglove's protocol.
pub(super) async fn connect(request: Request) -> Result<Socket, NotConnected> {
    let config =
        WebSocketConfig::default().max_message_size(Some(LARGEST)).max_frame_size(Some(LARGEST));
    let connecting = connect_async_with_config(request, Some(config), true);
    match timeout(CONNECT_WITHIN, connecting).await {
        Ok(Ok((socket, _))) => Ok(socket),
        Ok(Err(error)) => Err(NotConnected::because(&error)),
        Err(_) => Err(NotConnected::for_now("nothing answers")),
    }
}

impl NotConnected {
    fn for_now(reason: impl Into<String>) -> Self {
        Self { reason: reason.into(), is_other: false }
    }

    fn other(reason: impl Into<String>) -> Self {
        Self { reason: reason.into(), is_other: true }
    }

    fn because(error: &Error) -> Self {
        match error {
            Error::Http(answer) if answer.status().is_server_error() => Self::for_now(format!(
                "a web server answers that it has trouble: {}",
                answer.status()
            )),
            Error::Http(answer) => Self::other(format!(
                "a web server answers without a WebSocket: {}",
                answer.status()
            )),
            Error::Protocol(ProtocolError::SecWebSocketSubProtocolError(_)) => Self::other(
                "a WebSocket answers that does not speak Foxglove's protocol (rosbridge?)",
            ),
            Error::Protocol(ProtocolError::HandshakeIncomplete) => {
                Self::for_now("what answers closes the connection")
            }
            Error::Protocol(_) | Error::HttpFormat(_) | Error::Utf8(_) | Error::Capacity(_) => {
                Self::other("what answers is no WebSocket")
            }
            Error::Tls(error) => Self::other(format!("no encrypted connection: {error}")),
            Error::Io(error) => Self::of_network(error),
            error => Self::for_now(error.to_string()),
        }
    }

    fn of_network(error: &io::Error) -> Self {
        match error.kind() {
            ErrorKind::ConnectionRefused => Self::for_now("nothing listens there"),
            ErrorKind::ConnectionReset | ErrorKind::UnexpectedEof => {
                Self::for_now("what answers closes the connection")
            }
            ErrorKind::InvalidData => Self::other(format!("no encrypted connection: {error}")),
            _ => Self::for_now(error.to_string()),
        }
    }
}
