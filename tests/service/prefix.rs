//! A server that a reverse proxy shows below a path, which it takes away: page, links and the client's
//! addresses.

use lexsplat_client::http::{HttpClient, HttpError, Question, View};
use lexsplat_tests::{Robot, Server, tiny_config};
use reqwest::{StatusCode, Url};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, copy_bidirectional};
use tokio::net::{TcpListener, TcpStream};

/// The path that the proxy takes away.
const PREFIX: &str = "/robots/kitchen/";

/// A proxy before `server`, one request a connection; what is not below the path does not exist. Its address.
async fn proxy(server: String) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port is free");
    let address = listener.local_addr().expect("it is bound").to_string();
    tokio::spawn(async move {
        while let Ok((socket, _)) = listener.accept().await {
            tokio::spawn(pass_on(socket, server.clone()));
        }
    });
    address
}

async fn pass_on(mut from: TcpStream, server: String) {
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n") {
        // A connection that was opened ahead and is not used.
        let Ok(byte) = from.read_u8().await else { return };
        head.push(byte);
    }
    let line = String::from_utf8(head).expect("a request line is text");
    if !line.contains(PREFIX) {
        let gone = b"HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\nconnection: close\r\n\r\n";
        from.write_all(gone).await.expect("the client listens");
        return;
    }
    let mut to = TcpStream::connect(server).await.expect("the server listens");
    let line = format!("{}connection: close\r\n", line.replacen(PREFIX, "/", 1));
    to.write_all(line.as_bytes()).await.expect("it reads");
    // Either side may close first.
    let _ = copy_bidirectional(&mut from, &mut to).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn page_links_and_client_work_below_a_path() {
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(5, 2);
    server.stream(&robot, "room").await;
    server.settled("room").await;
    let proxy = proxy(server.http.clone()).await;
    let base = Url::parse(&format!("http://{proxy}{PREFIX}")).expect("an address");
    let status = async |url: Url| reqwest::get(url).await.expect("an answer").status();

    let page = reqwest::get(base.clone()).await.expect("an answer").text().await.expect("text");
    for file in ["dashboard/style.css", "dashboard/app.js"] {
        assert!(page.contains(&format!("\"{file}\"")), "{page}");
        assert_eq!(status(base.join(file).expect("a path")).await, StatusCode::OK, "{file}");
        // Negative control: what begins at the root is not there.
        let at_root = base.join(&format!("/{file}")).expect("a path");
        assert_eq!(status(at_root).await, StatusCode::NOT_FOUND, "{file}");
    }

    for address in [base.as_str(), base.as_str().trim_end_matches('/')] {
        let client = HttpClient::new(address).expect("an address");
        let view = Some(View::of_frame(0));
        let question = Question { text: Some("chair".into()), view, ..Question::default() };
        let answer = client.query("room", &question).await.expect("it is answered");
        let link = answer.heatmap.expect("a view has a heat map");
        assert!(link.url.starts_with(base.as_str()), "{}", link.url);
        client.heatmap(&link).await.expect("the link can be followed");
        let whole = Question { text: Some("chair".into()), ..Question::default() };
        let answer = client.query("room", &whole).await.expect("it is answered");
        client.points(&answer.points.expect("points")).await.expect("the link can be followed");
        let texts = Some(vec!["chair".into(), "wall".into()]);
        let question = Question { texts, view: Some(View::of_frame(0)), ..Question::default() };
        let labels = client.segment("room", &question).await.expect("it is answered").labels;
        client.labels(&labels.expect("labels"), "image/png").await.expect("it can be followed");
    }
    let error = HttpClient::new(&proxy).expect("an address").status("room").await;
    assert!(matches!(error, Err(HttpError::Refused { status: 404, .. })), "{error:?}");

    let maps = base.join("v1/maps").expect("a path");
    let make = reqwest::Client::new().post(maps.clone()).json(&serde_json::json!({"name": "made"}));
    let made = make.send().await.expect("an answer");
    assert_eq!(made.status(), StatusCode::CREATED);
    let location = made.headers()["location"].to_str().expect("text");
    assert_eq!(status(maps.join(location).expect("a path")).await, StatusCode::OK, "{location}");
    server.stop().await;
}
