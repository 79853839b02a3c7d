//! `lexsplat inspect`: what a recording holds, what of it would be used, and what is wrong with it.

use crate::dataset::{DatasetSpec, recognised};
use crate::files::plain;
use anyhow::{Result, anyhow};
use indicatif::ProgressBar;
use lexsplat_client::dataset::{DepthCameraSeen, DistortionSeen, Inspection, inspect, shown};
use lexsplat_client::stream::Poses;

/// Say what a recording holds, what of it would be used, and what is wrong with it
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  lexsplat inspect room0\n  lexsplat inspect tum:fr3_office --json"
)]
pub struct Inspect {
    /// A folder or file, whose kind is recognised, or KIND:PATH as for `stream`
    #[arg(value_name = "PATH")]
    recording: String,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Inspect) -> Result<()> {
    let spec = spec(&arguments.recording)?;
    let dataset = spec.whole(0.0, Poses::Estimate)?;
    let bar = ProgressBar::new(dataset.len() as u64);
    let found = inspect(&*dataset, |done| bar.set_position(done as u64));
    bar.finish_and_clear();
    if arguments.json {
        let mut told = serde_json::to_value(&found)?;
        told["dataset"] = spec.to_string().into();
        say!("{told}")?;
    } else {
        say_part!("{}", plain(&described(&spec, &found)))?;
    }
    Ok(())
}

/// `KIND:PATH`, or a folder of any kind.
fn spec(text: &str) -> Result<DatasetSpec> {
    match text.parse() {
        Ok(spec) => Ok(spec),
        Err(error) if text.contains(':') && !std::path::Path::new(text).exists() => {
            Err(error.into())
        }
        Err(_) => recognised(text).map_err(|reason| anyhow!(reason)),
    }
}

/// A camera in a few words.
fn lens([width, height]: [u32; 2], camera: [f64; 4], bent: Option<&DistortionSeen>) -> String {
    let bent = bent.map_or(String::new(), |DistortionSeen { model, coefficients }| {
        format!(", {model} {}", numbers(coefficients))
    });
    format!("{width}x{height}, fx fy cx cy = {}{bent}", numbers(&camera))
}

fn numbers(all: &[f64]) -> String {
    all.iter().map(|number| shown(*number)).collect::<Vec<_>>().join(" ")
}

fn depth_camera(found: &DepthCameraSeen) -> String {
    let ([width, height], [x, y, z]) = (found.size, found.place_metres);
    match found.camera {
        None => format!("         depth {width}x{height}, through the same lens"),
        Some(camera) => format!(
            "         depth {}; at {x:.4} {y:.4} {z:.4} m from color, turned by {:.2} degrees",
            lens(found.size, camera, found.distortion.as_ref()),
            found.turned_degrees
        ),
    }
}

fn described(spec: &DatasetSpec, found: &Inspection) -> String {
    let Inspection { frames, readable, with_pose, .. } = found;
    let mut lines = vec![
        format!("{spec}: {frames} frames over {:.1} s, map {}", found.seconds, found.name),
        format!("camera   {}", lens(found.size, found.camera, found.distortion.as_ref())),
    ];
    let own = found.own_cameras;
    lines.extend((own > 0).then(|| format!("         {own} frames have a camera of their own")));
    lines.extend(found.depth_camera.as_ref().map(depth_camera));
    lines.push(match found.depth {
        None => "depth    none was found".into(),
        Some(depth) => format!(
            "depth    {} m per unit; {:.0} % of the pixels measured, median {:.2} m, 99 % within {:.2} m",
            shown(found.depth_unit_metres),
            100.0 * depth.measured,
            depth.median_metres,
            depth.far_metres
        ),
    });
    lines.push(match found.metres {
        Some(metres) => format!("poses    {with_pose} of {frames} frames, a path of {metres:.1} m"),
        None => "poses    none".into(),
    });
    lines.push(format!(
        "used     {readable} frames with --poses estimate, {with_pose} with --poses given"
    ));
    lines.extend(found.has_masks.then(|| "masks    there: language can be scored".to_owned()));
    lines.extend(found.no_pose.iter().map(|reason| format!("no pose  {reason}")));
    lines.extend(found.assumed.iter().map(|note| format!("assumed  {note}")));
    if let [first, ..] = &found.left_out[..] {
        lines.push(format!("left out {} frames, the first: {first}", found.left_out.len()));
    }
    lines.extend(found.problems.iter().map(|problem| format!("problem  {problem}")));
    lines.join("\n") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let camera = [1e300, 525.0, 319.5, -1e-9];
        let told = lens([640, 480], camera, None);
        assert_eq!(told, "640x480, fx fy cx cy = 1e300 525 319.5 -1e-9");
    }

    #[test]
    fn a_folder_is_recognised_or_named_by_its_kind() {
        let folder = tempfile::tempdir().unwrap();
        let text = folder.path().to_str().unwrap();
        let error = spec(text).unwrap_err().to_string();
        assert!(error.contains("expected recording.toml (folder)"), "{error}");
        for (name, kind) in [("bag_0.mcap", "mcap"), ("metadata.yaml", "rosbag2")] {
            std::fs::write(folder.path().join(name), "").unwrap();
            assert_eq!(spec(text).unwrap().to_string(), format!("{kind}:{text}"));
        }
        let cases = [
            ("frame-000000.color.png", "7scenes"),
            ("results/frame.jpg", "replica"),
            ("rgb.txt", "tum"),
            ("transforms.json", "nerfstudio"),
            ("recording.toml", "folder"),
        ];
        for (name, kind) in [("a.r3d", "r3d"), ("a.SENS", "scannet")] {
            let path = folder.path().join(name);
            std::fs::write(&path, "").unwrap();
            let found = spec(path.to_str().unwrap()).unwrap().to_string();
            assert_eq!(found, format!("{kind}:{}", path.display()));
            std::fs::remove_file(path).unwrap();
        }
        for (name, kind) in cases {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
            assert_eq!(spec(text).unwrap().to_string(), format!("{kind}:{text}"));
        }
        let old = format!("{text}/old.bag");
        std::fs::write(&old, "").unwrap();
        assert!(spec(&old).unwrap_err().to_string().contains("a bag of ROS 1: convert it"));
        let file = format!("{text}/bag_0.mcap");
        assert_eq!(spec(&file).unwrap().to_string(), format!("mcap:{file}"));
        let wanted = format!("{file}?color=/rgb");
        assert_eq!(spec(&wanted).unwrap().to_string(), format!("mcap:{wanted}"));
        assert_eq!(spec("tum:desk").unwrap().to_string(), "tum:desk");
        let error = spec("avi:desk").unwrap_err().to_string();
        assert!(error.starts_with("dataset: expected replica:PATH"), "{error}");
        assert!(
            spec("nowhere-at-all").unwrap_err().to_string().contains("cannot read nowhere-at-all")
        );
    }
}
