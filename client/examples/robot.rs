//! A robot in about 70 lines: streams the frames of a folder in Replica layout with their poses,
//! prints every acknowledgement, and asks one question about the whole map.
//!
//! ```sh
//! lexsplat synth --seed 7 --frames 40 room7
//! cargo run -p lexsplat-client --example robot -- room7 "sofa"
//! ```
//!
//! The server is at 127.0.0.1:50051 (gRPC) and 127.0.0.1:8080 (HTTP), or where `LEXSPLAT_GRPC` and
//! `LEXSPLAT_HTTP` say; `LEXSPLAT_TOKEN` is the token, if it asks for one. On a robot, take frames from the
//! camera instead of [`Replica`]: color as JPEG or PNG, depth as 16-bit PNG of the same pixels, and the pose
//! `world_from_camera` in metres.

use lexsplat_client::Access;
use lexsplat_client::dataset::{Dataset, DatasetError, Replica};
use lexsplat_client::http::{Answer, HttpClient, Question};
use lexsplat_client::stream::{FrameStatus, FrameStream, MapSpec, Poses};
use std::error::Error;
use std::path::Path;

/// Frames that may wait to be sent.
const QUEUE: usize = 4;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(folder), Some(text)) = (arguments.next(), arguments.next()) else {
        return Err("usage: robot FOLDER TEXT".into());
    };
    let address = |variable, default: &str| std::env::var(variable).unwrap_or(default.into());
    let grpc = address("LEXSPLAT_GRPC", "127.0.0.1:50051");
    let http = address("LEXSPLAT_HTTP", "127.0.0.1:8080");
    let dataset = Replica::open(Path::new(&folder))?;
    let map = dataset.name().to_owned();
    let access = Access { token: std::env::var("LEXSPLAT_TOKEN").ok(), ..Access::default() };
    send(dataset, &map, &grpc, &access).await?;
    ask(&text, &map, &http, &access).await?;
    Ok(())
}

/// Streams all frames, prints every acknowledgement and returns how many frames have a pose.
pub async fn send(
    dataset: Replica,
    map: &str,
    grpc: &str,
    access: &Access,
) -> Result<usize, Box<dyn Error>> {
    let spec = MapSpec {
        map: map.to_owned(),
        cameras: dataset.cameras(),
        depth_unit_metres: dataset.depth_unit_metres(),
        poses: Poses::Given,
        label_texts: Vec::new(),
    };
    let FrameStream { frames, mut acks, .. } = FrameStream::open(grpc, access, spec, QUEUE).await?;
    // Frames are sent while acknowledgements come in; the stream ends when `frames` is dropped.
    let sending = tokio::spawn(async move {
        for index in 0..dataset.len() {
            let frame = dataset.frame(index)?;
            if !frames.send(frame).await {
                break;
            }
        }
        Ok::<_, DatasetError>(())
    });
    let mut tracked = 0;
    while let Some(ack) = acks.next().await? {
        for warning in &ack.input_warnings {
            println!("frame {}: {}", ack.sequence, warning.message);
        }
        tracked += usize::from(ack.status() == FrameStatus::Tracked);
        let keyframe = if ack.keyframe { ", keyframe" } else { "" };
        match ack.status() {
            FrameStatus::Refused => {
                println!("frame {}: refused: {}", ack.sequence, ack.refused_reason)
            }
            status => println!("frame {}: {}{keyframe}", ack.sequence, status.as_str_name()),
        }
    }
    sending.await??;
    Ok(tracked)
}

/// Waits until the map is optimised, asks and prints the objects of the answer.
pub async fn ask(
    text: &str,
    map: &str,
    http: &str,
    access: &Access,
) -> Result<Answer, Box<dyn Error>> {
    let client = HttpClient::with_access(http, access)?;
    client.settled(map, |_| ()).await?;
    let answer = client.query(map, &Question::in_space(text)).await?;
    println!("{text}: present {}, confidence {:.2}", answer.present, answer.confidence);
    for object in answer.objects.iter().flatten() {
        let [x, y, z] = object.center;
        println!("  score {:.2} at ({x:.2}, {y:.2}, {z:.2}) m", object.score);
    }
    Ok(answer)
}
