//! `lexsplat bridge`: streams what a robot sends over its WebSocket into a map, until Ctrl-C.

use crate::access::AccessOptions;
use crate::choices::Poses;
use crate::files::plain;
use crate::output::OutputError;
use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use lexsplat_client::live::{BridgeEvent, BridgeOptions, BridgeProgress, bridge};
use lexsplat_client::rig::Wanted;
use std::time::Duration;
use tokio::signal::unix::{SignalKind, signal};

/// Stream a live robot (foxglove_bridge, Foxglove's SDK) into a map; connects again when one of both goes
/// away
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  lexsplat bridge ws://robot:8765 --map kitchen\n  \
                        lexsplat bridge robot:8765 --map kitchen --poses estimate\n  \
                        lexsplat bridge robot:8765 --map kitchen --color /rgb/image_raw/compressed")]
pub struct Bridge {
    /// Address of the robot's WebSocket
    #[arg(value_name = "ws://ROBOT:PORT")]
    robot: String,
    /// Map to create or resume
    #[arg(long, value_name = "NAME")]
    map: String,
    /// Where poses come from; from the robot if it tells any, if not given
    #[arg(long, value_enum)]
    poses: Option<Poses>,
    #[command(flatten)]
    topics: Topics,
    /// End after so many acknowledged frames
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
    /// The server's gRPC address
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:50051")]
    grpc: String,
    #[command(flatten)]
    access: AccessOptions,
    /// Print the counts as one line of JSON at the end
    #[arg(long)]
    json: bool,
}

/// Topics to use instead of those that are chosen by what they hold.
#[derive(clap::Args)]
struct Topics {
    /// Topic of color pictures
    #[arg(long, value_name = "TOPIC")]
    color: Option<String>,
    /// Topic of depth pictures
    #[arg(long, value_name = "TOPIC")]
    depth: Option<String>,
    /// Topic of the color camera's calibration
    #[arg(long, value_name = "TOPIC")]
    info: Option<String>,
    /// Topic of the depth camera's calibration
    #[arg(long, value_name = "TOPIC")]
    depth_info: Option<String>,
    /// Topic of transforms, odometry or poses, or none
    #[arg(long, value_name = "TOPIC")]
    pose: Option<String>,
    /// Frame of coordinates that poses without names are of
    #[arg(long, value_name = "FRAME")]
    pose_frame: Option<String>,
    /// Frame of coordinates that is the map's
    #[arg(long, value_name = "FRAME")]
    world: Option<String>,
    /// Whether depth is registered to color
    #[arg(long, value_name = "true|false")]
    registered: Option<bool>,
}

impl Topics {
    fn wanted(&self) -> Wanted {
        Wanted {
            color: self.color.clone(),
            depth: self.depth.clone(),
            info: self.info.clone(),
            depth_info: self.depth_info.clone(),
            pose: self.pose.clone(),
            pose_frame: self.pose_frame.clone(),
            world: self.world.clone(),
            registered: self.registered,
        }
    }
}

/// Runs the command.
pub async fn run(arguments: &Bridge) -> Result<()> {
    let options = BridgeOptions {
        robot: arguments.robot.clone(),
        grpc: arguments.grpc.clone(),
        access: arguments.access.read()?,
        map: arguments.map.clone(),
        poses: arguments.poses.map(Into::into),
        wanted: arguments.topics.wanted(),
        frames: arguments.frames,
    };
    let mut terminated = signal(SignalKind::terminate())?;
    let stop = async {
        tokio::select! {
            _ = tokio::signal::ctrl_c() => {}
            _ = terminated.recv() => {}
        }
        note!("lexsplat: sending the frames that wait");
    };
    let bar = bar();
    let ended = bridge(&options, stop, |event| show(&bar, &event)).await;
    bar.finish_and_clear();
    let counts = ended?;
    if arguments.json {
        say!("{}", serde_json::to_string(&counts)?)?;
    } else {
        print(&options.map, &counts)?;
    }
    Ok(())
}

fn bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{spinner} {msg}").expect("the template is constant");
    let bar = ProgressBar::new_spinner().with_style(style);
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}

fn show(bar: &ProgressBar, event: &BridgeEvent) {
    match event {
        BridgeEvent::Told(what) => bar.suspend(|| note!("lexsplat: {}", plain(what))),
        BridgeEvent::Progress(counts) => bar.set_message(format!(
            "color {}  depth {}  frames {}  in the map {}  lost {}  left out {}",
            counts.colors,
            counts.depths,
            counts.frames,
            counts.tracked,
            counts.lost,
            left_out(counts)
        )),
    }
}

fn left_out(counts: &BridgeProgress) -> u64 {
    counts.unpaired + counts.without_pose + counts.damaged + counts.dropped
}

fn print(map: &str, counts: &BridgeProgress) -> Result<(), OutputError> {
    say!(
        "map {map}: {} frames, {} tracked, {} lost, {} refused",
        counts.acknowledged,
        counts.tracked,
        counts.lost,
        counts.refused
    )?;
    if left_out(counts) > 0 {
        say!(
            "left out: {} without depth, {} without a pose, {} damaged, {} because the map could not keep up",
            counts.unpaired,
            counts.without_pose,
            counts.damaged,
            counts.dropped
        )?;
    }
    match counts.durable_through {
        Some(sequence) => say!("durable through frame {sequence}"),
        None if counts.acknowledged == 0 => Ok(()),
        None => say!("not durable: the server has no data directory"),
    }
}
