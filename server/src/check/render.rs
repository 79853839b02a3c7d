//! Requests for rendered images.

use super::refusal::Refusal;
use super::view;
use crate::pipeline::frame::Intrinsics;
use crate::pipeline::query::{Channel, MAX_VIEW_SIDE, RenderRequest, View};
use lexsplat_proto::json;

/// Checks a request for a rendered image. `camera_of` says which camera took a tracked frame.
///
/// # Errors
/// [`Refusal`] names the field.
pub(crate) fn render_request(
    request: json::RenderRequest,
    camera_of: impl Fn(u64) -> Option<Intrinsics>,
    max_pixels: u64,
) -> Result<RenderRequest, Refusal> {
    let json::RenderRequest { frame, camera, world_from_camera, channel, width, height } = request;
    let view = json::View { frame, camera, world_from_camera };
    let view = view::from_json(view, "", max_pixels)?;
    let own = match &view {
        View::Camera { intrinsics, .. } => Some(*intrinsics),
        View::Frame(sequence) => camera_of(*sequence),
    };
    let size = size(width, height, own, max_pixels)?;
    Ok(RenderRequest { view, channel: self::channel(channel), size })
}

fn channel(channel: json::Channel) -> Channel {
    match channel {
        json::Channel::Color => Channel::Color,
        json::Channel::Depth => Channel::Depth,
        json::Channel::Language => Channel::Language,
        json::Channel::Opacity => Channel::Opacity,
        json::Channel::Spread => Channel::Spread,
    }
}

/// The size of the image if it differs from that of the view's camera, `own`. A side that is not
/// given is chosen so that the aspect ratio stays the same.
fn size(
    width: Option<u32>,
    height: Option<u32>,
    own: Option<Intrinsics>,
    max_pixels: u64,
) -> Result<Option<(u32, u32)>, Refusal> {
    for (field, given) in [("width", width), ("height", height)] {
        given.map_or(Ok(()), |pixels| view::side(field, pixels))?;
    }
    // Without a camera the map has no frame either: the renderer reports that.
    let Some(own) = own else { return Ok(None) };
    let follow = |given: u32, own_given: u32, own_other: u32| {
        let other = f64::from(given) * f64::from(own_other) / f64::from(own_given);
        (other.round() as u32).clamp(1, MAX_VIEW_SIDE)
    };
    let (width, height) = match (width, height) {
        (None, None) => return Ok(None),
        (Some(width), Some(height)) => (width, height),
        (Some(width), None) => (width, follow(width, own.width, own.height)),
        (None, Some(height)) => (follow(height, own.height, own.width), height),
    };
    if u64::from(width) * u64::from(height) > max_pixels {
        let reason = format!("expected at most {max_pixels} pixels, found {width}x{height}");
        return Err(Refusal::new("width", reason));
    }
    Ok(Some((width, height)))
}
