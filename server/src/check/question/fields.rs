//! Checks of the single fields of a question.

use crate::check::refusal::Refusal;
use crate::pipeline::query::{
    Bounds, MAX_NEGATIVES, MAX_TEXT_BYTES, MAX_TEXTS, Outputs, SpatialFilter,
};
use lexsplat_proto::json;
use nalgebra::Point3;

/// Objects in an answer if the question does not say.
const DEFAULT_MAX_OBJECTS: usize = 10;
/// The most objects that can be asked for.
const MAX_OBJECTS: u32 = 1000;
/// The widest mean filter, pixels.
const MAX_SMOOTHING_PIXELS: u32 = 512;

pub(super) fn negatives(given: &[String]) -> Result<Vec<String>, Refusal> {
    if given.len() > MAX_NEGATIVES {
        let reason = format!("expected at most {MAX_NEGATIVES}, found {}", given.len());
        return Err(Refusal::new("negatives", reason));
    }
    let each = |(at, negative): (usize, &String)| words(&format!("negatives[{at}]"), negative);
    given.iter().enumerate().map(each).collect()
}

pub(super) fn threshold(given: Option<f32>) -> Result<Option<f32>, Refusal> {
    match given {
        Some(found) if !(0.0..=1.0).contains(&found) => {
            Err(Refusal::new("threshold", format!("expected 0 to 1, found {found}")))
        }
        good => Ok(good),
    }
}

pub(super) fn smoothing(given: Option<u32>) -> Result<Option<u32>, Refusal> {
    match given {
        Some(found) if found > MAX_SMOOTHING_PIXELS => {
            let reason = format!("expected 0 to {MAX_SMOOTHING_PIXELS} pixels, found {found}");
            Err(Refusal::new("smoothing_pixels", reason))
        }
        good => Ok(good),
    }
}

pub(super) fn spatial_filter(
    near: Option<[f32; 3]>,
    within: Option<json::Bounds>,
    has_view: bool,
) -> Result<SpatialFilter, Refusal> {
    let given = [("near_metres", near.is_some()), ("within", within.is_some())];
    if let Some((field, _)) = given.into_iter().find(|(_, given)| *given && has_view) {
        return Err(Refusal::new(field, "expected only in a question without a view"));
    }
    let near = near.map(|point| finite("near_metres", point)).transpose()?;
    let within = within.map(|json::Bounds { min, max }| {
        let bounds = Bounds {
            min: finite("within.min_metres", min)?,
            max: finite("within.max_metres", max)?,
        };
        let ordered = (0..3).all(|axis| bounds.min[axis] <= bounds.max[axis]);
        let reason =
            || format!("expected no coordinate below within.min_metres {min:?}, found {max:?}");
        if ordered { Ok(bounds) } else { Err(Refusal::new("within.max_metres", reason())) }
    });
    Ok(SpatialFilter { near, within: within.transpose()? })
}

fn finite(field: &str, point: [f32; 3]) -> Result<Point3<f32>, Refusal> {
    match point.iter().all(|part| part.is_finite()) {
        true => Ok(Point3::from(point)),
        false => Err(Refusal::new(field, format!("expected finite metres, found {point:?}"))),
    }
}

/// Checks a text and removes surrounding white space.
pub(super) fn words(field: &str, text: &str) -> Result<String, Refusal> {
    let text = text.trim();
    if text.is_empty() {
        return Err(Refusal::new(field, "expected a text, found nothing"));
    }
    if text.len() > MAX_TEXT_BYTES {
        let found = text.len();
        return Err(Refusal::new(
            field,
            format!("expected at most {MAX_TEXT_BYTES} bytes, found {found}"),
        ));
    }
    Ok(text.to_owned())
}

pub(super) fn max_objects(given: Option<u32>) -> Result<usize, Refusal> {
    match given {
        None => Ok(DEFAULT_MAX_OBJECTS),
        Some(count @ 1..=MAX_OBJECTS) => Ok(count as usize),
        Some(found) => {
            let reason = format!("expected 1 to {MAX_OBJECTS}, found {found}");
            Err(Refusal::new("max_objects", reason))
        }
    }
}

/// Checks 1 to [`MAX_TEXTS`] different texts.
pub(super) fn texts(given: &[String]) -> Result<Vec<String>, Refusal> {
    let found = given.len();
    if !(1..=MAX_TEXTS).contains(&found) {
        return Err(Refusal::new("texts", format!("expected 1 to {MAX_TEXTS}, found {found}")));
    }
    let mut texts: Vec<String> = Vec::with_capacity(found);
    for (at, text) in given.iter().enumerate() {
        let field = format!("texts[{at}]");
        let text = words(&field, text)?;
        if texts.contains(&text) {
            let reason = format!("expected different texts, found {text:?} again");
            return Err(Refusal::new(field, reason));
        }
        texts.push(text);
    }
    Ok(texts)
}

/// Reads the names of outputs; without names, all outputs that fit the question.
pub(super) fn outputs(names: &[String], has_view: bool) -> Result<Outputs, Refusal> {
    if names.is_empty() {
        return Ok(if has_view { Outputs::VIEW } else { Outputs::SPACE });
    }
    let mut outputs = Outputs::NONE;
    for name in names {
        let (output, needs_view) = match name.as_str() {
            "heatmap" => (&mut outputs.heatmap, true),
            "uncertainty" => (&mut outputs.uncertainty, true),
            "mask" => (&mut outputs.mask, true),
            "boxes" => (&mut outputs.boxes, true),
            "points" => (&mut outputs.points, false),
            "objects" => (&mut outputs.objects, false),
            other => {
                let reason = format!(
                    "expected heatmap, uncertainty, mask, boxes, points or objects, found {:?}",
                    other.chars().take(40).collect::<String>()
                );
                return Err(Refusal::new("outputs", reason));
            }
        };
        if needs_view && !has_view {
            return Err(Refusal::new(
                "outputs",
                format!("{name} needs a view, and none was given"),
            ));
        }
        *output = true;
    }
    Ok(outputs)
}
