//! Whose turn it is: the keyframe that an optimiser step is taken on (paper §4.3).
//!
//! Half of the steps go round the newest keyframes, half go round all of them, so that each is visited at
//! regular intervals and what is new more often. With a random choice, quality differs by luck: maps of eight
//! keyframes differed by 0.6 dB between seeds.

use super::super::keyframes::{Keyframe, KeyframeStore, StepKind, Visits};
use super::super::live_map::StepBudget;
use super::config::MapperConfig;

/// Index of the keyframe that the map's next step is taken on, and what it optimises. While color steps are
/// left, one in `mapper.language_every` visits of a keyframe also optimises its language. Afterwards language
/// steps are taken alone. `None` if no keyframe has what is to be optimised.
pub(super) fn next(
    keyframes: &KeyframeStore,
    steps: &StepBudget,
    config: &MapperConfig,
) -> Option<(usize, StepKind)> {
    let candidates: Vec<Candidate> = keyframes.iter().map(Candidate::of).collect();
    choose(&candidates, steps, config)
}

/// What decides about a keyframe.
#[derive(Clone, Copy, Default)]
struct Candidate {
    visits: Visits,
    has_language: bool,
}

impl Candidate {
    fn of(keyframe: &Keyframe) -> Self {
        Self { visits: keyframe.visits, has_language: keyframe.language.is_some() }
    }
}

fn choose(
    candidates: &[Candidate],
    steps: &StepBudget,
    config: &MapperConfig,
) -> Option<(usize, StepKind)> {
    let (number, window) = (steps.next_number(), config.window);
    if steps.color_left() > 0 {
        let last_steps = candidates.iter().map(|one| Some(one.visits.color));
        let at = in_turn(last_steps, number, window)?;
        let Candidate { visits, has_language } = candidates[at];
        let is_due = has_language && visits.color_alone + 1 >= config.language_every;
        Some((at, StepKind { color: true, language: is_due && steps.language_left() > 0 }))
    } else {
        let last_steps =
            candidates.iter().map(|one| one.has_language.then_some(one.visits.language));
        let at = in_turn(last_steps, number, window)?;
        Some((at, StepKind { color: false, language: true }))
    }
}

/// `last_steps`: the last step of each keyframe, the oldest keyframe first; 0: it had none, `None`: it can
/// have none. Those without a step come first, and of those that waited equally long the newest.
fn in_turn(
    last_steps: impl ExactSizeIterator<Item = Option<usize>>,
    number: usize,
    window: usize,
) -> Option<usize> {
    let all = last_steps.len();
    // Visits are proportional to these weights. All are alike until the newest would get less than half.
    let newest = window.max(all.saturating_sub(window));
    let weight = |at: usize| if at + window < all { window } else { newest };
    let waited = |at: usize, last: usize| number.saturating_sub(last).saturating_mul(weight(at));
    let ready = last_steps.enumerate().filter_map(|(at, last)| Some((at, last?)));
    ready.max_by_key(|(at, last)| (*last == 0, waited(*at, *last), *at)).map(|(at, _)| at)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Takes steps `numbers`. Returns how often each keyframe was visited, and the longest wait.
    fn walk(
        last_steps: &mut [Option<usize>],
        numbers: std::ops::RangeInclusive<usize>,
        window: usize,
    ) -> (Vec<usize>, usize) {
        let (mut visits, mut longest) = (vec![0; last_steps.len()], 0);
        for number in numbers {
            let at = in_turn(last_steps.iter().copied(), number, window).unwrap();
            longest = longest.max(number - last_steps[at].unwrap());
            last_steps[at] = Some(number);
            visits[at] += 1;
        }
        (visits, longest)
    }

    #[test]
    fn a_window_of_all_is_a_round() {
        let mut last_steps = [Some(0); 5];
        let (visits, _) = walk(&mut last_steps, 1..=5, 8);
        assert_eq!(visits, [1; 5]);
        assert_eq!(last_steps, [5, 4, 3, 2, 1].map(Some), "the newest first");
        let (visits, longest) = walk(&mut last_steps, 6..=105, 8);
        assert_eq!((visits, longest), (vec![20; 5], 5));
    }

    #[test]
    fn the_newest_get_half_and_the_others_are_not_forgotten() {
        let mut last_steps = [Some(0); 20];
        walk(&mut last_steps, 1..=100, 4);
        let (visits, longest) = walk(&mut last_steps, 101..=1100, 4);
        assert!(visits[16..].iter().all(|n| n.abs_diff(500 / 4) <= 2), "{visits:?}");
        assert!(visits[..16].iter().all(|n| n.abs_diff(500 / 16) <= 2), "{visits:?}");
        assert!(longest <= 36, "{longest}");
    }

    /// Takes all steps that are due. Returns what each optimised.
    fn take_all(candidates: &mut [Candidate], steps: &mut StepBudget) -> Vec<StepKind> {
        let config = MapperConfig { language_every: 3, ..MapperConfig::default() };
        let mut taken = Vec::new();
        while !steps.is_empty() {
            let (at, kind) = choose(candidates, steps, &config).unwrap();
            candidates[at].visits.count(kind, steps.next_number());
            steps.take(kind);
            taken.push(kind);
        }
        taken
    }

    #[test]
    fn language_is_optimised_with_color_and_alone_if_it_is_late() {
        const COLOR: StepKind = StepKind { color: true, language: false };
        const LANGUAGE: StepKind = StepKind { color: false, language: true };
        const BOTH: StepKind = StepKind { color: true, language: true };
        let mut keyframe = [Candidate { has_language: true, ..Candidate::default() }];
        let mut steps = StepBudget::new(6, 3);
        steps.earn();
        steps.earn_language();
        let taken = take_all(&mut keyframe, &mut steps);
        assert_eq!(taken, [COLOR, COLOR, BOTH, COLOR, COLOR, BOTH], "in time");

        let mut keyframe = [Candidate::default()];
        let mut steps = StepBudget::new(6, 3);
        steps.earn();
        assert_eq!(take_all(&mut keyframe, &mut steps), [COLOR; 6], "not there yet");
        keyframe[0].has_language = true;
        steps.earn_language();
        assert_eq!(take_all(&mut keyframe, &mut steps), [LANGUAGE; 2], "late");
        steps.earn_language();
        assert!(choose(&[Candidate::default()], &steps, &MapperConfig::default()).is_none());
    }

    /// With a round as long as `language_every`, language would always fall on the same keyframe if steps
    /// instead of visits were counted.
    #[test]
    fn every_keyframe_s_language_is_optimised_alike() {
        let mut candidates = [Candidate { has_language: true, ..Candidate::default() }; 3];
        let mut steps = StepBudget::new(90, 3);
        steps.earn();
        steps.earn_language();
        let config = MapperConfig { language_every: 3, ..MapperConfig::default() };
        let mut visits = [0; 3];
        while steps.color_left() > 0 {
            let (at, kind) = choose(&candidates, &steps, &config).unwrap();
            candidates[at].visits.count(kind, steps.next_number());
            steps.take(kind);
            visits[at] += usize::from(kind.language);
        }
        assert_eq!(visits, [10; 3]);
    }

    #[test]
    fn who_has_no_language_has_no_turn() {
        assert_eq!(in_turn([None, Some(3), None].into_iter(), 9, 8), Some(1));
        assert_eq!(in_turn([None, Some(3), Some(0)].into_iter(), 9, 8), Some(2), "its first step");
        assert_eq!(in_turn([None, None].into_iter(), 9, 8), None);
    }
}
