//! The cameras of the chosen topics: whether depth is registered to color, and where its camera is if not.

use super::choice::{Choice, Chosen, is_maybe_same_frame, is_rectified, is_registered_by_name};
use super::error::RigError;
use super::survey::Survey;
use super::tree::plain;
use super::wanted::Wanted;
use crate::dataset::{Camera, Cameras, DepthCamera, Intrinsics};
use nalgebra::Isometry3;

/// Lenses whose focal lengths and centres differ by a smaller part are the same.
const SAME_LENS: f64 = 0.02;

/// The cameras; what was concluded is added to `notes`.
pub(super) fn of(
    survey: &Survey,
    choice: &Choice,
    wanted: &Wanted,
    notes: &mut Vec<String>,
) -> Result<Cameras, RigError> {
    let color = calibrated(survey, choice.info, &choice.color, notes)?;
    let own = choice.depth_info.map(|info| calibrated(survey, info, &choice.depth, notes));
    let depth = depth_camera(survey, choice, &color, own, wanted, notes)?;
    Ok(Cameras { depth, ..Cameras::from(color) })
}

fn calibrated(
    survey: &Survey,
    info: &str,
    pictures: &Chosen,
    notes: &mut Vec<String>,
) -> Result<Camera, RigError> {
    let calibration = survey.topics[info].calibration.as_ref();
    let calibration = calibration.expect("only topics with a calibration are chosen");
    let found = calibration.of_pictures(pictures.picture.size, is_rectified(pictures.topic));
    let found = found
        .map_err(|error| RigError::Camera { topic: info.to_owned(), reason: error.to_string() })?;
    for note in found.notes {
        let note = format!("{info}: {note}");
        // Color and depth may have one calibration.
        if !notes.contains(&note) {
            notes.push(note);
        }
    }
    Ok(found.camera)
}

fn depth_camera(
    survey: &Survey,
    choice: &Choice,
    color: &Camera,
    own: Option<Result<Camera, RigError>>,
    wanted: &Wanted,
    notes: &mut Vec<String>,
) -> Result<Option<DepthCamera>, RigError> {
    let topic = choice.depth.topic;
    let frames = [&choice.color, &choice.depth].map(|chosen| plain(&chosen.picture.frame_id));
    let is_same_frame = frames[0] == frames[1];
    let is_registered = wanted.registered.unwrap_or_else(|| {
        let is_same_lens = match &own {
            Some(Ok(own)) => is_same_lens(&own.intrinsics, &color.intrinsics),
            _ => true,
        };
        // It may be registered to another camera than the chosen one.
        let is_named =
            is_registered_by_name(topic) && is_maybe_same_frame(&choice.color, &choice.depth);
        is_named || (is_same_frame && is_same_lens)
    });
    let own = match own {
        Some(own) if !is_registered => own?,
        _ => {
            if !is_registered {
                notes.push(format!(
                    "{topic} has no calibration: its depth is taken to be registered to color; depth_info=TOPIC \
                     names one"
                ));
            }
            notes.push(format!("depth is registered to color ({topic})"));
            return registered(choice);
        }
    };
    let color_from_depth = match survey.tree.lookup(frames[0], frames[1], 0) {
        _ if is_same_frame => Isometry3::identity(),
        Ok(pose) => pose,
        Err(reason) => {
            notes.push(format!(
                "{reason}: the depth camera is taken to be where the color camera is"
            ));
            Isometry3::identity()
        }
    };
    let millimetres = color_from_depth.translation.vector.norm() * 1000.0;
    notes
        .push(format!("depth has a camera of its own, {millimetres:.0} mm from color's ({topic})"));
    Ok(Some(DepthCamera::Own { camera: own, color_from_depth }))
}

/// Depth that is registered to color has color's size, or at least its shape.
fn registered(choice: &Choice) -> Result<Option<DepthCamera>, RigError> {
    let [color, depth] = [choice.color, choice.depth].map(|chosen| chosen.picture.size);
    if color == depth {
        return Ok(None);
    }
    let shape = |(width, height): (u32, u32)| f64::from(width) / f64::from(height);
    if (shape(color) / shape(depth) - 1.0).abs() < 0.01 {
        return Ok(Some(DepthCamera::SameLens { width: depth.0, height: depth.1 }));
    }
    Err(RigError::Camera {
        topic: choice.depth.topic.to_owned(),
        reason: format!(
            "expected registered depth of color's shape, {}x{}, found {}x{}: registered=no says that it has a \
             camera of its own",
            color.0, color.1, depth.0, depth.1
        ),
    })
}

fn is_same_lens(one: &Intrinsics, other: &Intrinsics) -> bool {
    let one = one.scaled(other.width, other.height);
    let is_near = |a: f64, b: f64, of: f64| ((a - b) / of).abs() < SAME_LENS;
    is_near(one.fx, other.fx, other.fx)
        && is_near(one.fy, other.fy, other.fy)
        && is_near(one.cx, other.cx, f64::from(other.width))
        && is_near(one.cy, other.cy, f64::from(other.height))
}
