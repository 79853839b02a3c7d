//! Questions in plain words, from gRPC and from HTTP.

mod fields;

use super::limits::Limits;
use super::refusal::Refusal;
use super::view;
use crate::pipeline::query::{Query, SegmentationRequest, View};
use fields::{max_objects, negatives, outputs, smoothing, spatial_filter, texts, threshold, words};
use lexsplat_proto::{json, v1};

/// A checked question.
#[derive(Clone, Debug)]
pub(crate) enum Question {
    /// Where is this text?
    Text(Query),
    /// Which of these texts fits where?
    Texts(SegmentationRequest),
}

impl Question {
    /// Checks a question that came over gRPC.
    ///
    /// # Errors
    /// [`Refusal`] names the field.
    pub(crate) fn from_wire(request: v1::QueryRequest, limits: &Limits) -> Result<Self, Refusal> {
        Unchecked {
            view: view::from_wire(request.view, limits.max_pixels)?,
            text: request.text,
            texts: request.texts,
            negatives: request.negatives,
            outputs: request.outputs,
            threshold: request.threshold,
            smoothing_pixels: request.smoothing_pixels,
            max_objects: request.max_objects,
            near: request.near_metres.map(metres),
            within: request.within.map(bounds),
        }
        .checked()
    }

    /// Checks a question that came over HTTP.
    ///
    /// # Errors
    /// [`Refusal`] names the field.
    pub(crate) fn from_json(question: json::Question, max_pixels: u64) -> Result<Self, Refusal> {
        let view = question.view.map(|view| view::from_json(view, "view.", max_pixels));
        Unchecked {
            view: view.transpose()?,
            text: question.text.unwrap_or_default(),
            texts: question.texts.unwrap_or_default(),
            negatives: question.negatives.unwrap_or_default(),
            outputs: question.outputs.unwrap_or_default(),
            threshold: question.threshold,
            smoothing_pixels: question.smoothing,
            max_objects: question.max_objects,
            near: question.near,
            within: question.within,
        }
        .checked()
    }
}

/// Checks a 3D question with one text and nothing else.
///
/// # Errors
/// [`Refusal`] names `text`.
pub(super) fn about(text: &str) -> Result<Query, Refusal> {
    Unchecked { text: text.to_owned(), ..Unchecked::default() }.one()
}

fn metres(point: v1::Vector3) -> [f32; 3] {
    [point.x as f32, point.y as f32, point.z as f32]
}

fn bounds(wire: v1::Bounds) -> json::Bounds {
    let [min, max] =
        [wire.min_metres, wire.max_metres].map(|corner| metres(corner.unwrap_or_default()));
    json::Bounds { min, max }
}

/// A question with a checked view; its other fields are unchecked.
#[derive(Clone, Debug, Default)]
struct Unchecked {
    text: String,
    texts: Vec<String>,
    negatives: Vec<String>,
    view: Option<View>,
    outputs: Vec<String>,
    threshold: Option<f32>,
    smoothing_pixels: Option<u32>,
    max_objects: Option<u32>,
    near: Option<[f32; 3]>,
    within: Option<json::Bounds>,
}

impl Unchecked {
    fn checked(self) -> Result<Question, Refusal> {
        match self.texts.is_empty() {
            true => self.one().map(Question::Text),
            false => self.several().map(Question::Texts),
        }
    }

    /// Checks a question with one text.
    fn one(self) -> Result<Query, Refusal> {
        let text = words("text", &self.text)?;
        let filter = spatial_filter(self.near, self.within, self.view.is_some())?;
        let max_objects = max_objects(self.max_objects)?;
        Ok(Query {
            outputs: outputs(&self.outputs, self.view.is_some())?,
            text,
            negatives: negatives(&self.negatives)?,
            view: self.view,
            threshold: threshold(self.threshold)?,
            smoothing_pixels: smoothing(self.smoothing_pixels)?,
            max_objects,
            filter,
        })
    }

    /// Checks a question with several texts.
    fn several(self) -> Result<SegmentationRequest, Refusal> {
        let only_with_one_text = [
            ("text", !self.text.is_empty()),
            ("outputs", !self.outputs.is_empty()),
            ("max_objects", self.max_objects.is_some()),
            ("near_metres", self.near.is_some()),
            ("within", self.within.is_some()),
        ];
        if let Some((field, _)) = only_with_one_text.into_iter().find(|(_, given)| *given) {
            return Err(Refusal::new(field, "expected nothing beside texts"));
        }
        Ok(SegmentationRequest {
            texts: texts(&self.texts)?,
            negatives: negatives(&self.negatives)?,
            view: self.view,
            threshold: threshold(self.threshold)?,
            smoothing_pixels: smoothing(self.smoothing_pixels)?,
        })
    }
}

#[cfg(test)]
mod tests;
