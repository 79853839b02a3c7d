//! All scores of language: queries about frames, about the whole map, and for absent objects.

use crate::context::Context;
use crate::error::EvaluateError;
use crate::labels::{self, COUNTED_EVERY};
use crate::language::{self, Language};
use crate::presence::{self, Presence};
use crate::selection::Selection;
use crate::space::{self, Space};
use crate::step::Step;
use lexsplat_client::dataset::Truth;
use nalgebra::Isometry3;

/// All scores of language.
pub(crate) struct LanguageScores {
    /// Queries about frames.
    pub language: Language,
    /// Queries about the whole map.
    pub space: Space,
    /// Presence and absence.
    pub presence: Presence,
}

/// Asks and scores all queries; `truth_from_map` moves the map into the data set's world.
pub(crate) async fn score(
    context: &Context<'_>,
    truth: &dyn Truth,
    selection: &Selection,
    truth_from_map: &Isometry3<f64>,
    on_step: &mut impl FnMut(Step<'_>),
) -> Result<LanguageScores, EvaluateError> {
    let counted: Vec<usize> = selection.tracked.iter().copied().step_by(COUNTED_EVERY).collect();
    let labels = labels::most_visible(truth, &counted)?;
    let frames = selection.test_frames();
    let language = language::score(context, truth, &labels, &frames, on_step).await?;
    let (space, mut judgements) =
        space::score(context, truth, &labels, truth_from_map, on_step).await?;
    judgements.extend(presence::ask(context, truth, &labels, &frames, on_step).await?);
    Ok(LanguageScores { language, space, presence: Presence::of(judgements, &labels) })
}
