//! TLS on both ports: versions, trust, client certificates, and certificates that are replaced.

use lexsplat_client::dataset::Intrinsics;
use lexsplat_client::http::{HttpClient, HttpError};
use lexsplat_client::stream::{ClientError, FrameStream, MapSpec, Poses};
use lexsplat_client::{Access, Identity};
use lexsplat_server::access::{Scope, issue};
use lexsplat_server::config::{Config, TlsConfig};
use lexsplat_tests::{Authority, Certified, Server, tiny_config};
use std::path::Path;
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

/// How long a server may take to read its certificates again.
const PATIENCE: Duration = Duration::from_secs(60);
/// Where the servers of these tests listen.
const NAME: &str = "127.0.0.1";

fn write(folder: &Path, certified: &Certified) {
    std::fs::write(folder.join("server.pem"), &certified.certificate).expect("it can be written");
    std::fs::write(folder.join("server.key"), &certified.key).expect("it can be written");
}

fn encrypted(folder: &Path) -> Config {
    let mut config = tiny_config();
    let (certificate, key) = (folder.join("server.pem"), folder.join("server.key"));
    config.server.tls = Some(TlsConfig { certificate, key, client_ca: None });
    config
}

fn trusts(authority: &Authority) -> Access {
    Access { authorities: Some(authority.pem().into()), ..Access::default() }
}

fn spec(map: &str) -> MapSpec {
    MapSpec {
        map: map.into(),
        cameras: Intrinsics { width: 8, height: 8, fx: 8.0, fy: 8.0, cx: 4.0, cy: 4.0 }.into(),
        depth_unit_metres: 0.001,
        poses: Poses::Given,
        label_texts: Vec::new(),
    }
}

async fn opens(address: &str, access: &Access) -> Result<(), ClientError> {
    FrameStream::open(address, access, spec("room"), 1).await.map(drop)
}

/// The first bytes of a TLS record with a `ClientHello` of this version and no newer one.
fn hello(minor: u8) -> Vec<u8> {
    let mut body = vec![3, minor];
    body.extend([7; 32]);
    // No session; the suites TLS_ECDHE_ECDSA_WITH_AES_128_CBC_SHA and ..._GCM_SHA256; no compression.
    body.extend([0, 0, 4, 0xc0, 0x09, 0xc0, 0x2b, 1, 0]);
    // Groups (P-256), point formats, signature algorithms (ecdsa_secp256r1_sha256).
    let extensions = [0, 10, 0, 4, 0, 2, 0, 23, 0, 11, 0, 2, 1, 0, 0, 13, 0, 4, 0, 2, 4, 3];
    body.extend([0, extensions.len() as u8]);
    body.extend(extensions);
    let mut record = vec![22, 3, 1, 0, body.len() as u8 + 4, 1, 0, 0, body.len() as u8];
    record.extend(body);
    record
}

/// What the server answers: kind of record, and for an alert its number.
async fn answer(address: &str, hello: &[u8]) -> (u8, u8) {
    let mut socket = TcpStream::connect(address).await.expect("it listens");
    socket.write_all(hello).await.expect("it is taken");
    let mut record = [0; 7];
    socket.read_exact(&mut record).await.expect("the server answers");
    (record[0], record[6])
}

const ALERT: u8 = 21;
const HANDSHAKE: u8 = 22;
const PROTOCOL_VERSION: u8 = 70;

#[tokio::test(flavor = "multi_thread")]
async fn both_ports_speak_tls_1_2_and_1_3_and_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let authority = Authority::new("ours");
    write(folder.path(), &authority.issue(NAME));
    let mut config = encrypted(folder.path());
    config.http.hosts = vec!["maps.example.org".into()];
    let server = Server::start(config).await;
    let (http, grpc) = (format!("https://{}", server.http), format!("https://{}", server.grpc));
    for version in [reqwest::tls::Version::TLS_1_2, reqwest::tls::Version::TLS_1_3] {
        let root = reqwest::Certificate::from_pem(authority.pem().as_bytes()).expect("it is PEM");
        let client = reqwest::Client::builder()
            .add_root_certificate(root)
            .min_tls_version(version)
            .max_tls_version(version)
            .build()
            .expect("a client");
        let reply = client.get(format!("{http}/healthz")).send().await.expect("it is trusted");
        assert!(reply.status().is_success(), "{version:?}");
    }
    for address in [&server.http, &server.grpc] {
        for old in [1, 2] {
            assert_eq!(
                answer(address, &hello(old)).await,
                (ALERT, PROTOCOL_VERSION),
                "1.{}",
                old - 1
            );
        }
        // Negative control: the same message with TLS 1.2 is answered with a handshake.
        assert_eq!(answer(address, &hello(3)).await.0, HANDSHAKE);
    }
    // A browser that came by a name comes back by TLS only; an address is not pinned.
    let root = reqwest::Certificate::from_pem(authority.pem().as_bytes()).expect("it is PEM");
    let client = reqwest::Client::builder().add_root_certificate(root).build().expect("a client");
    for (host, is_pinned) in [("maps.example.org", true), (NAME, false), ("localhost", false)] {
        let request = client.get(format!("{http}/healthz")).header("host", host);
        let reply = request.send().await.expect("an answer");
        assert!(reply.status().is_success(), "{host}: {}", reply.status());
        let found = reply.headers().contains_key("strict-transport-security");
        assert_eq!(found, is_pinned, "{host}");
    }
    let log_in = client.post(format!("{http}/v1/session"));
    let reply = log_in.json(&serde_json::json!({"token": "any"})).send().await.expect("an answer");
    let cookie = reply.headers()["set-cookie"].to_str().expect("text");
    assert!(cookie.contains("Secure"), "{cookie}");
    opens(&grpc, &trusts(&authority)).await.expect("gRPC by TLS");
    let client = HttpClient::with_access(&http, &trusts(&authority)).expect("right");
    client.health().await.expect("HTTP by TLS");
    // Who does not trust the authority sends nothing; who speaks no TLS gets no answer.
    let stranger = trusts(&Authority::new("theirs"));
    let error = opens(&grpc, &stranger).await.expect_err("it is not trusted");
    assert!(matches!(error, ClientError::Tls { .. }), "{error}");
    let client = HttpClient::with_access(&http, &stranger).expect("right");
    let error = client.health().await.expect_err("it is not trusted");
    assert!(matches!(error, HttpError::Tls { .. }), "{error}");
    opens(&server.grpc, &Access::default()).await.expect_err("plain text is not answered");
    let plain = HttpClient::new(&server.http).expect("right");
    plain.health().await.expect_err("plain text is not answered");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_sent_in_plain_text_to_an_https_address() {
    let server = Server::start(tiny_config()).await;
    let access = Access { token: Some("secret".into()), ..trusts(&Authority::new("ours")) };
    let error = opens(&format!("https://{}", server.grpc), &access).await.expect_err("no TLS");
    assert!(matches!(error, ClientError::Tls { .. }), "{error}");
    assert!(!error.to_string().contains("secret"), "{error}");
    let client = HttpClient::with_access(&format!("https://{}", server.http), &access);
    let error = client.expect("right").health().await.expect_err("no TLS");
    assert!(matches!(error, HttpError::Tls { .. }), "{error}");
    assert!(server.engine.maps().is_empty(), "no map was opened");
    // Negative control: without https:// it is.
    opens(&server.grpc, &Access::default()).await.expect("plain text");
    assert_eq!(server.engine.maps().len(), 1);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_certificate_that_is_replaced_is_used_and_a_broken_one_is_not() {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let (old, new) = (Authority::new("old"), Authority::new("new"));
    write(folder.path(), &old.issue(NAME));
    let server = Server::start(encrypted(folder.path())).await;
    let https = format!("https://{}", server.http);
    let health = |authority: &Authority| {
        let client = HttpClient::with_access(&https, &trusts(authority)).expect("right");
        async move { client.health().await }
    };
    health(&old).await.expect("the old one");
    health(&new).await.expect_err("there is no new one yet");
    std::fs::write(folder.path().join("server.key"), "broken").expect("it can be written");
    tokio::time::sleep(Duration::from_secs(3)).await;
    health(&old).await.expect("a broken key changes nothing");
    write(folder.path(), &new.issue(NAME));
    let waiting = async {
        while health(&new).await.is_err() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    tokio::time::timeout(PATIENCE, waiting).await.expect("the new one is used");
    health(&old).await.expect_err("the old one is gone");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_certificate_stands_for_a_caller() {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let (authority, clients) = (Authority::new("ours"), Authority::new("clients"));
    write(folder.path(), &authority.issue(NAME));
    let client_ca = folder.path().join("clients.pem");
    std::fs::write(&client_ca, clients.pem()).expect("it can be written");
    let mut config = encrypted(folder.path());
    config.server.tls.as_mut().expect("it is set").client_ca = Some(client_ca);
    config.access.entries = vec!["robot-7 write room* certificate".into()];
    let tokens = folder.path().join("tokens");
    let (token, _) = issue("reader", &[Scope::Read], "*", Some(&tokens)).expect("a token");
    config.access.tokens = Some(tokens);
    let server = Server::start(config).await;
    let grpc = format!("https://{}", server.grpc);
    let shows = |certified: Certified| Access {
        identity: Some(Identity {
            certificate: certified.certificate.into(),
            key: certified.key.into(),
        }),
        ..trusts(&authority)
    };
    opens(&grpc, &shows(clients.issue("robot-7"))).await.expect("it is known");
    let code = |error: ClientError| match error {
        ClientError::Refused { code, .. } => Some(code),
        _ => None,
    };
    use tonic::Code;
    let error = opens(&grpc, &trusts(&authority)).await.expect_err("it shows nothing");
    assert_eq!(code(error), Some(Code::Unauthenticated));
    let error = opens(&grpc, &shows(clients.issue("robot-8"))).await.expect_err("it is unknown");
    assert_eq!(code(error), Some(Code::Unauthenticated));
    opens(&grpc, &shows(authority.issue("robot-7"))).await.expect_err("another authority's");
    // The scopes and maps of its line hold.
    let https = format!("https://{}", server.http);
    let robot = HttpClient::with_access(&https, &shows(clients.issue("robot-7"))).expect("right");
    let error = robot.status("room").await.expect_err("it may only write");
    assert!(matches!(error, HttpError::Refused { status: 403, .. }), "{error}");
    // A token works beside it.
    let reader = Access { token: Some(token), ..trusts(&authority) };
    let reader = HttpClient::with_access(&https, &reader).expect("right");
    reader.status("room").await.expect("it may read");
    server.stop().await;
}
