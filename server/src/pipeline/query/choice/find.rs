//! Candidates: what a map has of each kind of thing that a text names.

use super::choose::{Candidates, Choice, Surroundings, choose};
use super::shape::level;
use crate::pipeline::query::error::QueryError;
use crate::pipeline::query::feature_decoder::FeatureDecoder;
use crate::pipeline::query::question::Wanted;
use crate::pipeline::query::relevancy::is_present;
use crate::pipeline::query::search::Search;
use crate::pipeline::query::space::{Found, SpaceFeatures, confidence_of, find};
use crate::pipeline::query::text::TextEmbedder;
use lexsplat_gpu::Camera;

/// Share of choices that leave out the thing that was meant. In synthetic rooms, with names that are given, one
/// question in thirty was answered wrongly; names that networks found are worse.
const WRONG_CHOICES: f32 = 0.1;

/// What finds things by their names.
pub(crate) struct Finder<'a> {
    pub embedder: &'a mut TextEmbedder,
    pub decoder: &'a mut FeatureDecoder,
    pub features: &'a SpaceFeatures,
    /// Relevancy above which other things count, which the wanted one is related to.
    pub threshold: f32,
}

impl Finder<'_> {
    /// The objects that are meant, and why there is none, if attributes or a relation say so. `search` is for
    /// the names of what is wanted.
    pub(crate) fn meant(
        &mut self,
        search: &Search<'_>,
        wanted: &Wanted,
        camera: Option<&Camera>,
    ) -> Result<(Found, Option<String>), QueryError> {
        let found = find(search, self.features, self.decoder)?;
        if wanted.is_plain() {
            return Ok((found, None));
        }
        let others = self.others(search, wanted)?;
        let is_present = is_present(found.confidence);
        let mut candidates = Candidates { wanted, objects: found.objects, is_present, others };
        let up = search.snapshot.up;
        let around = Surroundings {
            gaussians: &search.snapshot.gaussians,
            level_from_world: up.map(|up| level(&up.direction)),
            camera,
        };
        let Choice { kept, reason } = choose(&candidates, &around);
        let mut at = 0..;
        candidates.objects.retain(|_| at.next().is_some_and(|at| kept.contains(&at)));
        let objects = candidates.objects;
        let members = objects.iter().flat_map(|one| &one.members);
        let confidence = match reason {
            // Colors and boxes may be wrong, so "none of them" is not certain.
            Some(_) => WRONG_CHOICES * found.confidence,
            None => confidence_of(search, members),
        };
        Ok((Found { confidence, objects }, reason))
    }

    /// What there is of the things that the wanted one is related to.
    fn others<'w>(
        &mut self,
        search: &Search<'_>,
        wanted: &'w Wanted,
    ) -> Result<Vec<Candidates<'w>>, QueryError> {
        let relation = wanted.relation.iter();
        relation
            .flat_map(|relation| &relation.others)
            .map(|other| self.candidates(search, other))
            .collect()
    }

    fn candidates<'w>(
        &mut self,
        search: &Search<'_>,
        wanted: &'w Wanted,
    ) -> Result<Candidates<'w>, QueryError> {
        let prompts = self.embedder.prompts_of(wanted, &search.query.negatives)?;
        let own = Search { prompts: &prompts, threshold: self.threshold, ..*search };
        let Found { objects, confidence } = find(&own, self.features, self.decoder)?;
        let others = self.others(search, wanted)?;
        Ok(Candidates { wanted, objects, is_present: is_present(confidence), others })
    }
}
