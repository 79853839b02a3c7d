//! The newest answers, kept so that their heat maps, labels and points can be fetched.

use super::error::Problem;
use crate::pipeline::query::{
    Answer, Heatmap, LabelImage, LabelledPoint, ScoredPoint, Segmentation,
};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};

/// The parts of an answer that are fetched by its id.
#[derive(Default)]
pub(super) struct Kept {
    id: String,
    map: String,
    pub(super) heatmap: Option<Heatmap>,
    pub(super) uncertainty: Option<Heatmap>,
    pub(super) points: Option<Vec<ScoredPoint>>,
    labels: Option<Arc<LabelImage>>,
    pub(super) labelled: Option<Vec<LabelledPoint>>,
}

impl Kept {
    fn bytes(&self) -> usize {
        let images = [&self.heatmap, &self.uncertainty].into_iter().flatten();
        let pixels: usize = images.map(|image| image.values.len()).sum();
        let points = self.points.as_ref().map_or(0, Vec::len);
        let labels = self.labels.as_ref().map_or(0, |image| image.labels.len());
        let labelled = self.labelled.as_ref().map_or(0, Vec::len);
        pixels * size_of::<f32>()
            + points * size_of::<ScoredPoint>()
            + labels
            + labelled * size_of::<LabelledPoint>()
    }
}

/// The newest answers, oldest first; bounded in number and in bytes.
pub(super) struct AnswerCache {
    kept: Mutex<VecDeque<Arc<Kept>>>,
    max_count: usize,
    max_bytes: usize,
}

impl AnswerCache {
    pub(super) fn new(max_count: usize, max_bytes: usize) -> Self {
        Self { kept: Mutex::default(), max_count, max_bytes }
    }

    fn locked(&self) -> MutexGuard<'_, VecDeque<Arc<Kept>>> {
        self.kept.lock().expect("no thread panics while it holds the answers")
    }

    /// Keeps the images and the points of an answer, which are taken out of it.
    pub(super) fn keep(&self, id: &str, map: &str, answer: &mut Answer) {
        let (heatmap, uncertainty) = (answer.heatmap.take(), answer.uncertainty.take());
        let points = answer.points.take();
        if heatmap.is_none() && uncertainty.is_none() && points.is_none() {
            return;
        }
        let (id, map) = (id.into(), map.into());
        self.push(Kept { id, map, heatmap, uncertainty, points, ..Kept::default() });
    }

    /// Keeps the labels of an answer to several texts.
    pub(super) fn keep_labels(&self, id: &str, map: &str, found: Segmentation) {
        let (labels, labelled) = (found.image.map(Arc::new), found.points);
        self.push(Kept { id: id.into(), map: map.into(), labels, labelled, ..Kept::default() });
    }

    /// Adds an answer and drops the oldest ones beyond the bounds; the newest is always kept.
    fn push(&self, newest: Kept) {
        let mut kept = self.locked();
        kept.push_back(Arc::new(newest));
        let mut bytes: usize = kept.iter().map(|answer| answer.bytes()).sum();
        while kept.len() > 1 && (kept.len() > self.max_count || bytes > self.max_bytes) {
            bytes -= kept.pop_front().map_or(0, |oldest| oldest.bytes());
        }
    }

    /// The label image of an answer.
    ///
    /// # Errors
    /// A problem with status 404 if the answer is not kept or has no label image.
    pub(super) fn labels(&self, map: &str, id: &str) -> Result<Arc<LabelImage>, Problem> {
        let detail = "the answer has no labels: ask with \"texts\" about a view";
        self.find(map, id)?.labels.clone().ok_or_else(|| Problem::not_found(detail))
    }

    /// # Errors
    /// A problem with status 404 if the answer is not kept.
    pub(super) fn find(&self, map: &str, id: &str) -> Result<Arc<Kept>, Problem> {
        let found = self.locked().iter().find(|kept| kept.id == id && kept.map == map).cloned();
        found.ok_or_else(|| {
            let detail = format!("query {id:?} is not among the recent answers: ask again");
            Problem::not_found(detail).at("query_id")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::query::{Timing, Understood};

    fn answer(pixels: usize) -> Answer {
        Answer {
            revision: 1,
            understood: Understood::default(),
            reason: None,
            present: true,
            confidence: 1.0,
            coverage: 1.0,
            threshold: 0.5,
            heatmap: Some(Heatmap { width: pixels as u32, height: 1, values: vec![0.5; pixels] }),
            uncertainty: None,
            mask: None,
            boxes: None,
            peak: None,
            points: None,
            objects: None,
            timing: Timing::default(),
        }
    }

    #[test]
    fn the_newest_are_kept_within_number_and_bytes() {
        let answers = AnswerCache::new(3, 100);
        for id in ["a", "b", "c", "d"] {
            answers.keep(id, "kitchen", &mut answer(5));
        }
        assert!(answers.find("kitchen", "a").is_err());
        assert!(answers.find("kitchen", "b").is_ok());
        assert!(answers.find("garage", "b").is_err());
        answers.keep("e", "kitchen", &mut answer(21));
        assert!(answers.find("kitchen", "d").is_err());
        answers.keep("f", "kitchen", &mut answer(500));
        assert!(answers.find("kitchen", "e").is_err());
        assert!(answers.find("kitchen", "f").is_ok());
    }
}
