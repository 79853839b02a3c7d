//! What hostile or broken clients send takes a bounded amount of memory, and others are served all the same.

use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_proto::v1::{self, frame_message::Message};
use lexsplat_tests::{Robot, Server, ServerProcess, tiny_config};
use prost::bytes::Bytes;
use serde_json::json;
use std::io::Write as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use tokio::net::TcpStream;

const MIB: u64 = 1 << 20;
/// Calls that send a part of a message each, and the bytes of each part.
const HALF_SENT_CALLS: usize = 24;
const HALF_SENT_BYTES: usize = 40 << 20;
/// Most memory that all of them may take: twice the limit that the server is given.
const HALF_SENT_MOST: u64 = 2 * 128 * MIB;
/// Longest message, bytes: the limit of all unfinished ones must not be below it.
const MESSAGE_BYTES: &str = "67108864";
/// Length of a color profile that half a megabyte of PNG holds.
const PROFILE_BYTES: usize = 400 << 20;
/// Streams that send such a picture at once.
const PROFILES: usize = 8;
/// Most memory that all of them may take together.
const PROFILES_MOST: u64 = 100 * MIB;

/// Opens calls that send the first part of a message and then nothing. Returns how many the server ended.
async fn send_halves(grpc: &str) -> usize {
    let tcp = TcpStream::connect(grpc).await.expect("it listens");
    let (client, connection) = h2::client::handshake(tcp).await.expect("it speaks HTTP/2");
    tokio::spawn(async move {
        // The server may close it.
        let _ = connection.await;
    });
    let ended = Arc::new(AtomicUsize::new(0));
    let mut calls = Vec::new();
    for _ in 0..HALF_SENT_CALLS {
        let mut client = client.clone().ready().await.expect("it takes another call");
        let request =
            http::Request::post(format!("http://{grpc}/lexsplat.v1.Mapping/StreamFrames"))
                .header("content-type", "application/grpc")
                .header("te", "trailers");
        let request = request.body(()).expect("a request");
        let (_, mut body) = client.send_request(request, false).expect("it is sent");
        let ended = ended.clone();
        calls.push(tokio::spawn(async move {
            let size = u32::try_from(HALF_SENT_BYTES + 1).expect("it fits").to_be_bytes();
            let header = [&[0][..], &size].concat();
            let mut rest = Bytes::from([header, vec![0; HALF_SENT_BYTES]].concat());
            while !rest.is_empty() {
                body.reserve_capacity(rest.len());
                let capacity = std::future::poll_fn(|context| body.poll_capacity(context)).await;
                let Some(Ok(capacity)) = capacity else {
                    ended.fetch_add(1, Ordering::Relaxed);
                    return;
                };
                let part = rest.split_to(capacity.min(rest.len()));
                if body.send_data(part, false).is_err() {
                    ended.fetch_add(1, Ordering::Relaxed);
                    return;
                }
            }
            // Holds the call open for a while.
            let reset = std::future::poll_fn(|context| body.poll_reset(context));
            if tokio::time::timeout(Duration::from_secs(2), reset).await.is_ok() {
                ended.fetch_add(1, Ordering::Relaxed);
            }
        }));
    }
    for call in calls {
        call.await.expect("it does not panic");
    }
    ended.load(Ordering::Relaxed)
}

/// How much memory half-sent messages take, bytes, and how many calls the server ended.
async fn half_sent(most_unfinished: u64) -> (u64, usize) {
    let most = most_unfinished.to_string();
    let server = ServerProcess::start(&[
        ("LEXSPLAT__INGEST__MAX_UNFINISHED_BYTES", &most),
        ("LEXSPLAT__INGEST__MAX_MESSAGE_BYTES", MESSAGE_BYTES),
        // No call ends because its opening message takes long.
        ("LEXSPLAT__INGEST__OPEN_SECONDS", "600"),
    ]);
    let before = server.peak_bytes();
    let ended = send_halves(&server.grpc).await;
    let taken = server.peak_bytes() - before;
    // Others are served.
    let url = format!("http://{}", server.grpc);
    let mut client = MappingClient::connect(url).await.expect("it listens");
    client.list_maps(v1::ListMapsRequest::default()).await.expect("it answers");
    (taken, ended)
}

#[tokio::test(flavor = "multi_thread")]
async fn half_sent_messages_take_bounded_memory() {
    let (taken, ended) = half_sent(128 * MIB).await;
    println!("{HALF_SENT_CALLS} half-sent messages: {} MiB, {ended} calls ended", taken / MIB);
    assert!(taken < HALF_SENT_MOST, "{taken} bytes");
    assert!(ended >= HALF_SENT_CALLS / 2, "{ended} calls ended");
    let (taken, ended) = half_sent(4096 * MIB).await;
    assert!(taken > HALF_SENT_MOST && ended == 0, "negative control: {taken} bytes, {ended} ended");
}

/// A PNG of the robot's size whose color profile is far larger than the file.
fn png_with_a_large_profile(width: u32, height: u32) -> Vec<u8> {
    let mut plain = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut plain);
    let pixels = vec![90; (width * height * 3) as usize];
    image::ImageEncoder::write_image(
        encoder,
        &pixels,
        width,
        height,
        image::ExtendedColorType::Rgb8,
    )
    .expect("it is written");
    let mut deflate = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    for _ in 0..PROFILE_BYTES >> 20 {
        deflate.write_all(&[0; 1 << 20]).expect("it is written to memory");
    }
    let profile = deflate.finish().expect("it is written to memory");
    let chunk = [&b"iCCPprofile\0\0"[..], &profile].concat();
    let mut sum = flate2::Crc::new();
    sum.update(&chunk);
    let length = u32::try_from(chunk.len() - 4).expect("it is short").to_be_bytes();
    // Behind the signature and the header.
    let (head, tail) = plain.split_at(33);
    [head, &length, &chunk, &sum.sum().to_be_bytes(), tail].concat()
}

#[tokio::test(flavor = "multi_thread")]
async fn pictures_with_huge_profiles_take_bounded_memory() {
    let server = ServerProcess::start(&[("LEXSPLAT__MAPPER__MAX_GAUSSIANS", "1000")]);
    let robot = Robot::new(3, 1);
    let bomb = png_with_a_large_profile(robot.camera.width, robot.camera.height);
    assert!((bomb.len() as u64) < MIB, "{} bytes", bomb.len());
    let unlimited = image::codecs::png::PngDecoder::new(std::io::Cursor::new(&bomb));
    let profile = image::ImageDecoder::icc_profile(&mut unlimited.expect("a PNG"));
    let found = profile.expect("a PNG").map(|profile| profile.len());
    assert_eq!(found, Some(PROFILE_BYTES), "negative control: the decoder would unpack it");

    // The maps themselves take memory: the same frames without the profile come first.
    let url = format!("http://{}", server.grpc);
    send_everywhere(&url, &robot, 0, None).await;
    let before = server.peak_bytes();
    send_everywhere(&url, &robot, 1, Some(&bomb)).await;
    let taken = server.peak_bytes() - before;
    println!("{PROFILES} pictures: {} MiB", taken / MIB);
    assert!(taken < PROFILES_MOST, "{taken} bytes");
}

/// Sends the robot's only frame to several maps at once, with other colors if there are any.
async fn send_everywhere(url: &str, robot: &Robot, sequence: u64, png: Option<&[u8]>) {
    let streams = (0..PROFILES).map(|map| {
        let mut messages = robot.messages(&format!("map-{map}"));
        for message in &mut messages {
            if let Some(Message::Frame(frame)) = &mut message.message {
                frame.sequence = sequence;
                if let Some(png) = png {
                    frame.color_format = v1::ColorFormat::Png.into();
                    frame.color = png.to_vec().into();
                }
            }
        }
        let url = url.to_owned();
        tokio::spawn(async move {
            let mut client = MappingClient::connect(url).await.expect("it listens");
            let acks = client.stream_frames(tokio_stream::iter(messages)).await.expect("it opens");
            let mut acks = acks.into_inner();
            while acks.message().await.expect("the stream ends well").is_some() {}
        })
    });
    for stream in streams.collect::<Vec<_>>() {
        stream.await.expect("it does not panic");
    }
}

/// Asks as a client of this address.
fn asker(address: [u8; 4]) -> reqwest::Client {
    let client = reqwest::Client::builder().local_address(std::net::IpAddr::from(address));
    client.build().expect("a client")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_with_many_questions_makes_itself_wait() {
    const MANY: usize = 48;
    let server = Server::start(tiny_config()).await;
    server.stream(&Robot::new(3, 2), "asked").await;
    server.settled("asked").await;
    let url = Arc::new(server.url("/v1/maps/asked/query"));
    // Views of different sizes, so that no answer is kept from the question before.
    let ask = async |client: reqwest::Client, url: Arc<String>, number: usize| {
        let body = json!({"text": format!("chair {number}"), "view": {"frame": number % 2}});
        let answer = client.post(&*url).json(&body).send().await.expect("it answers");
        assert_eq!(answer.status(), 200, "{:?}", answer.text().await);
    };
    for (other, is_served_soon) in [([127, 0, 0, 2], true), ([127, 0, 0, 1], false)] {
        let answered = Arc::new(AtomicUsize::new(0));
        let many: Vec<_> = (0..MANY)
            .map(|number| {
                let (url, answered) = (url.clone(), answered.clone());
                tokio::spawn(async move {
                    ask(asker([127, 0, 0, 1]), url, number).await;
                    answered.fetch_add(1, Ordering::Relaxed);
                })
            })
            .collect();
        while answered.load(Ordering::Relaxed) < 2 {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        let before = answered.load(Ordering::Relaxed);
        ask(asker(other), url.clone(), MANY).await;
        let meanwhile = answered.load(Ordering::Relaxed) - before;
        println!("{other:?}: {meanwhile} of {MANY} questions were answered before");
        assert_eq!(meanwhile < MANY / 4, is_served_soon, "{other:?}: {meanwhile} came before");
        for question in many {
            question.await.expect("it does not panic");
        }
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_may_have_so_many_questions_waiting() {
    let mut config = tiny_config();
    config.query.queue = 2;
    let server = Server::start(config).await;
    server.stream(&Robot::new(3, 2), "asked").await;
    server.settled("asked").await;
    let url = server.url("/v1/maps/asked/query");
    let questions: Vec<_> = (0..16)
        .map(|number| {
            let body = json!({"text": format!("chair {number}"), "view": {"frame": number % 2}});
            tokio::spawn(asker([127, 0, 0, 1]).post(&url).json(&body).send())
        })
        .collect();
    let mut statuses = Vec::new();
    for question in questions {
        let answer = question.await.expect("it does not panic").expect("it answers");
        statuses.push(answer.status().as_u16());
    }
    assert!(statuses.contains(&200) && statuses.contains(&429), "{statuses:?}");
    server.stop().await;
}
