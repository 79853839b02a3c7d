//! Connections that say nothing, little, or too slowly, and too many of them: others are answered.

use lexsplat_tests::{Server, ServerProcess, tiny_config};
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

/// How long a server may take to close a connection that took longer than a second.
const PATIENCE: Duration = Duration::from_secs(60);
const IDLE: usize = 300;

async fn is_alive(http: &str) -> bool {
    let client = reqwest::Client::builder().timeout(PATIENCE).build().expect("a client");
    let reply = client.get(format!("http://{http}/healthz")).send().await;
    reply.is_ok_and(|reply| reply.status().is_success())
}

/// All that comes until the connection is closed.
async fn rest(mut socket: TcpStream) -> String {
    let mut text = Vec::new();
    // A closed connection may be reset.
    let read = socket.read_to_end(&mut text);
    let _ = tokio::time::timeout(PATIENCE, read).await.expect("the connection is closed");
    String::from_utf8_lossy(&text).into_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn idle_sockets_beyond_the_usual_limit_of_files_stop_nobody() {
    // They are not given up during the test.
    let server =
        ServerProcess::with_files(256, &[("LEXSPLAT__CONNECTIONS__HEADER_SECONDS", "3600")]);
    for address in [&server.http, &server.grpc] {
        let mut idle = Vec::new();
        for _ in 0..IDLE {
            idle.push(TcpStream::connect(address).await.expect("it listens"));
        }
        assert!(is_alive(&server.http).await, "with {IDLE} idle sockets at {address}");
        let url = format!("http://{}", server.grpc);
        let channel = tonic::transport::Endpoint::from_shared(url).expect("an address");
        let channel = channel.timeout(PATIENCE).connect().await.expect("it is accepted");
        let mut health = tonic_health::pb::health_client::HealthClient::new(channel);
        let request = tonic_health::pb::HealthCheckRequest::default();
        health.check(request).await.expect("gRPC answers");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn slow_heads_and_bodies_and_silence_are_given_up() {
    let mut config = tiny_config();
    config.connections.header_seconds = 1;
    config.connections.body_seconds = 1;
    let server = Server::start(config).await;
    let started = [
        ("silence", ""),
        ("half a head", "GET /healthz HTTP/1.1\r\nhost: localhost\r\n"),
        ("half a preface", "PRI * HTTP/2.0\r\n"),
        ("a kept connection", "GET /healthz HTTP/1.1\r\nhost: localhost\r\n\r\n"),
    ];
    for (what, begin) in started {
        for address in [&server.http, &server.grpc] {
            let mut socket = TcpStream::connect(address).await.expect("it listens");
            socket.write_all(begin.as_bytes()).await.expect("it is taken");
            let reply = rest(socket).await;
            let was_asked = what == "a kept connection" && *address == server.http;
            assert_eq!(reply.contains("200 OK"), was_asked, "{what}: {reply}");
        }
    }
    let mut slow = TcpStream::connect(&server.http).await.expect("it listens");
    let head = "POST /v1/maps HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/json\r\n\
                content-length: 100\r\n\r\n{";
    slow.write_all(head.as_bytes()).await.expect("it is taken");
    let reply = rest(slow).await;
    assert!(reply.starts_with("HTTP/1.1 408"), "{reply}");
    assert!(is_alive(&server.http).await);
    let metrics = reqwest::get(server.url("/metrics")).await.expect("an answer").text().await;
    let metrics = metrics.expect("text");
    assert!(metrics.contains("lexsplat_connections_ended_total{"), "{metrics}");
    for port in ["grpc", "http"] {
        let counted = metrics.lines().any(|line| {
            line.starts_with("lexsplat_connections_ended_total{")
                && line.contains(&format!("port=\"{port}\""))
                && line.contains("reason=\"timed_out\"")
        });
        assert!(counted, "{port} in {metrics}");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn connections_beyond_the_limit_are_closed_and_places_become_free() {
    let mut config = tiny_config();
    config.connections.max = 4;
    let server = Server::start(config).await;
    let mut kept = Vec::new();
    for _ in 0..4 {
        let mut socket = TcpStream::connect(&server.http).await.expect("it listens");
        // A request shows that the connection has its place.
        socket.write_all(b"GET /healthz HTTP/1.1\r\nhost: localhost\r\n\r\n").await.expect("taken");
        let mut first = [0; 12];
        socket.read_exact(&mut first).await.expect("an answer");
        assert_eq!(&first, b"HTTP/1.1 200");
        kept.push(socket);
    }
    let fifth = TcpStream::connect(&server.http).await.expect("the system accepts it");
    assert_eq!(rest(fifth).await, "", "it is closed without an answer");
    drop(kept.pop());
    let waiting = async {
        while !is_alive(&server.http).await {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(PATIENCE, waiting).await.expect("a place becomes free");
    let metrics = reqwest::get(server.url("/metrics")).await.expect("an answer").text().await;
    let metrics = metrics.expect("text");
    assert!(metrics.contains("reason=\"too_many\""), "{metrics}");
    server.stop().await;
}
