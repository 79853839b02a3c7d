//! All scores of language: queries about frames, about the whole map, and for absent objects.

use crate::context::Context;
use crate::error::EvaluateError;
use crate::labels::Labels;
use crate::language::{self, Language};
use crate::presence::{self, Presence};
use crate::space::{self, Space};
use crate::step::Step;
use crate::uncertainty::Uncertainty;
use nalgebra::Isometry3;

/// All scores of language.
pub(crate) struct LanguageScores {
    /// Queries about frames.
    pub language: Language,
    /// Queries about the whole map; absent without masks.
    pub space: Option<Space>,
    /// Presence and absence.
    pub presence: Presence,
    /// Uncertainty of pixels; absent if no view has language.
    pub uncertainty: Option<Uncertainty>,
}

/// Asks and scores all queries; `truth_from_map` moves the map into the data set's world.
pub(crate) async fn score(
    context: &Context<'_>,
    labels: &Labels<'_>,
    truth_from_map: &Isometry3<f64>,
    on_step: &mut impl FnMut(Step<'_>),
) -> Result<LanguageScores, EvaluateError> {
    let language = language::score(context, labels, on_step).await?;
    let queries = labels.queries();
    let (space, mut judgements) = match labels.masks {
        Some(truth) => {
            let (space, judgements) =
                space::score(context, truth, &queries, truth_from_map, on_step).await?;
            (Some(space), judgements)
        }
        None => (None, presence::ask_for(context, &queries).await?),
    };
    let (others, uncertainty) = presence::ask(context, labels, on_step).await?;
    judgements.extend(others);
    let presence = Presence::of(judgements, &queries);
    Ok(LanguageScores { language, space, presence, uncertainty })
}
