//! The parameters and the results of a search, in a view or in space.

use super::answer::{
    Answer, Heatmap, Mask, Object, Peak, ScoredBox, ScoredPoint, Timing, Understood,
};
use super::config::QueryConfig;
use super::relevancy::{Calibration, Prompts, is_present};
use super::request::Query;
use crate::pipeline::snapshot::MapSnapshot;

/// A query with everything that its search depends on.
#[derive(Clone, Copy)]
pub(super) struct Search<'a> {
    pub snapshot: &'a MapSnapshot,
    pub query: &'a Query,
    pub prompts: &'a Prompts,
    /// Relevancy above which a pixel or a Gaussian counts.
    pub threshold: f32,
    pub config: &'a QueryConfig,
    pub calibration: &'a Calibration,
}

/// The results of a search: the parts of an [`Answer`].
#[derive(Default)]
pub(super) struct Findings {
    pub confidence: f32,
    pub coverage: f32,
    pub heatmap: Option<Heatmap>,
    pub uncertainty: Option<Heatmap>,
    pub mask: Option<Mask>,
    pub boxes: Option<Vec<ScoredBox>>,
    pub peak: Option<Peak>,
    pub points: Option<Vec<ScoredPoint>>,
    pub objects: Option<Vec<Object>>,
    /// Why nothing is meant, although there may be things of the kind.
    pub reason: Option<String>,
}

impl Findings {
    /// The answer of a revision.
    pub(super) fn into_answer(
        self,
        revision: u64,
        understood: Understood,
        threshold: f32,
        timing: Timing,
    ) -> Answer {
        let Self {
            confidence,
            coverage,
            heatmap,
            uncertainty,
            mask,
            boxes,
            peak,
            points,
            objects,
            reason,
        } = self;
        let present = is_present(confidence);
        Answer {
            revision,
            understood,
            present,
            reason,
            confidence,
            coverage,
            threshold,
            heatmap,
            uncertainty,
            mask,
            boxes,
            peak,
            points,
            objects,
            timing,
        }
    }
}
