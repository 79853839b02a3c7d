//! Verdicts in plain English: what is wrong, how sure that is, what to do.

use super::super::input_warning::{InputProblem, InputWarning};
use super::pose_check;
use super::reading::Axes;
use super::registration::{self, Placement};

/// Factors that are nearly a power of ten are told as that.
const ROUND: f32 = 0.12;

/// One warning for the poses and one for the depth, as far as they are wrong.
pub(super) fn of_poses(verdict: &pose_check::Verdict) -> Vec<InputWarning> {
    let convention = verdict.reading.convention;
    let evidence = format!(
        "Where two frames show the same surface, {} of it agree that way, and {} as sent ({} of {} pairs of \
         frames fit better).",
        percent(verdict.agreeing),
        percent(verdict.agreeing_sent),
        verdict.won,
        verdict.pairs
    );
    let mut warnings = Vec::new();
    let mut warn = |problem, what: &str, advice: &str| {
        warnings.push(InputWarning { problem, message: format!("{what} {evidence} {advice}") });
    };
    let axes = match convention.axes {
        Axes::Optical => None,
        Axes::OpenGl => {
            Some(("x right, y up, z backward (OpenGL)", "diag(1, -1, -1, 1) turns them around"))
        }
        Axes::Body => Some((
            "x forward, y left, z up (a ROS body)",
            "send the pose of the camera's optical frame",
        )),
    };
    if convention.inverted {
        warn(
            InputProblem::InvertedPoses,
            "The poses look like camera_from_world.",
            "Send world_from_camera, the pose of the camera in the world: the inverse.",
        );
    }
    if let Some((found, advice)) = axes {
        warn(
            InputProblem::CameraAxes,
            &format!("The poses look as if the camera's axes were {found}."),
            &format!("Send poses of a camera with x right, y down, z forward: {advice}."),
        );
    }
    let factor = verdict.reading.depth_factor;
    if (factor - 1.0).abs() > f32::EPSILON {
        let (times, size) = times(1.0 / factor);
        warn(
            InputProblem::DepthUnit,
            &format!(
                "The depth looks about {times} times too {size} for the distances between the poses."
            ),
            "Check depth_unit_metres (0.001 for millimetres), and that translations are in metres.",
        );
    }
    warnings
}

/// The warning that depths are of no size that a room can have.
pub(super) fn of_size(metres: f32) -> InputWarning {
    let message = format!(
        "Half of the depths are {} {metres:.3} metres: no room is like that. Check depth_unit_metres \
         (0.001 for millimetres).",
        if metres < 1.0 { "below" } else { "above" }
    );
    InputWarning { problem: InputProblem::DepthUnit, message }
}

/// The warning that none of the first frames has any depth.
pub(super) fn of_no_depth(frames: usize) -> InputWarning {
    let message = format!(
        "None of the first {frames} frames has any depth: nothing can be mapped. Check that the depth camera \
         sends, and which values mean no measurement (no_depth)."
    );
    InputWarning { problem: InputProblem::NoDepth, message }
}

/// The warning that depth does not lie on the color image.
pub(super) fn of_registration(verdict: &registration::Verdict) -> InputWarning {
    let registration::Verdict { placement, frames, won } = *verdict;
    let message = format!(
        "The depth does not lie on the color image. Edges of depth meet edges of the image far better if \
         the depth picture is {} ({won} of {frames} frames fit better). Check the depth camera that \
         opens the map (depth_camera, color_from_depth), or register depth to color before it is sent.",
        placed(&placement)
    );
    InputWarning { problem: InputProblem::UnregisteredDepth, message }
}

/// What was done to a depth picture.
fn placed(placement: &Placement) -> String {
    let mut parts = Vec::new();
    if placement.turns > 0 {
        parts.push(
            ["turned to the right", "turned upside down", "turned to the left"]
                [usize::from(placement.turns) - 1]
                .to_owned(),
        );
    }
    if (placement.scale - 1.0).abs() > f32::EPSILON {
        let verb = if placement.scale > 1.0 { "enlarged" } else { "reduced" };
        parts.push(format!("{verb} to about {}", percent(placement.scale)));
    }
    let [right, down] = placement.shift;
    for (share, positive, negative) in [(right, "right", "left"), (down, "down", "up")] {
        if share != 0.0 {
            let way = if share > 0.0 { positive } else { negative };
            parts.push(format!("moved {way} by {:.1} % of the width", share.abs() * 100.0));
        }
    }
    parts.join(", ")
}

fn percent(share: f32) -> String {
    format!("{:.0} %", share * 100.0)
}

/// A factor in words: how many times, and "large" or "small".
fn times(factor: f32) -> (String, &'static str) {
    let (factor, size) = if factor < 1.0 { (1.0 / factor, "small") } else { (factor, "large") };
    let power = 10_f32.powf(factor.log10().round());
    let is_round = power > 1.0 && (factor / power - 1.0).abs() < ROUND;
    let text = if is_round {
        format!("{power:.0}")
    } else if factor < 10.0 {
        format!("{factor:.1}")
    } else {
        format!("{factor:.0}")
    };
    (text, size)
}
