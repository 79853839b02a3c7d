//! Words for relations between things.

use super::tokens::{Word, starts_with};
use super::wanted::RelationKind;

/// Words for a relation, and whether they negate it. Those that others begin with come later.
const RELATIONS: &[(&str, RelationKind, bool)] = &[
    ("next to", RelationKind::Near, false),
    ("close to", RelationKind::Near, false),
    ("near to", RelationKind::Near, false),
    ("adjacent to", RelationKind::Near, false),
    ("near", RelationKind::Near, false),
    ("beside", RelationKind::Near, false),
    ("alongside", RelationKind::Near, false),
    ("around", RelationKind::Near, false),
    ("against", RelationKind::Near, false),
    ("by", RelationKind::Near, false),
    ("at", RelationKind::Near, false),
    ("far away from", RelationKind::Near, true),
    ("far from", RelationKind::Near, true),
    ("away from", RelationKind::Near, true),
    ("nearest to", RelationKind::Nearest, false),
    ("closest to", RelationKind::Nearest, false),
    ("nearest", RelationKind::Nearest, false),
    ("closest", RelationKind::Nearest, false),
    ("farthest from", RelationKind::Farthest, false),
    ("furthest from", RelationKind::Farthest, false),
    ("farthest away from", RelationKind::Farthest, false),
    ("furthest away from", RelationKind::Farthest, false),
    ("to the left of", RelationKind::LeftOf, false),
    ("on the left of", RelationKind::LeftOf, false),
    ("on the left side of", RelationKind::LeftOf, false),
    ("at the left of", RelationKind::LeftOf, false),
    ("left of", RelationKind::LeftOf, false),
    ("to the right of", RelationKind::RightOf, false),
    ("on the right of", RelationKind::RightOf, false),
    ("on the right side of", RelationKind::RightOf, false),
    ("at the right of", RelationKind::RightOf, false),
    ("right of", RelationKind::RightOf, false),
    ("in front of", RelationKind::InFrontOf, false),
    ("in the front of", RelationKind::InFrontOf, false),
    ("in back of", RelationKind::Behind, false),
    ("behind", RelationKind::Behind, false),
    ("in between", RelationKind::Between, false),
    ("between", RelationKind::Between, false),
    ("on top of", RelationKind::On, false),
    ("atop", RelationKind::On, false),
    ("upon", RelationKind::On, false),
    ("onto", RelationKind::On, false),
    ("on", RelationKind::On, false),
    ("inside of", RelationKind::In, false),
    ("inside", RelationKind::In, false),
    ("within", RelationKind::In, false),
    ("in", RelationKind::In, false),
    ("underneath", RelationKind::Under, false),
    ("beneath", RelationKind::Under, false),
    ("below", RelationKind::Under, false),
    ("under", RelationKind::Under, false),
    ("above", RelationKind::Above, false),
    ("over", RelationKind::Above, false),
    ("without", RelationKind::With, true),
    ("with", RelationKind::With, false),
];

/// Relations that are not decided.
const UNDECIDED: &[&str] = &[
    "opposite",
    "across from",
    "on the left",
    "to the left",
    "on the right",
    "to the right",
    "from the left",
    "from the right",
    "in the front",
    "in the back",
    "in the middle",
    "in the corner",
];

/// Names with a word for a relation in them.
const NAMES: &[&str] = &[
    "computer on wheels",
    "workstation on wheels",
    "jack in the box",
    "hole in the wall",
    "bed and breakfast",
    "man in the moon",
    "out of order",
];

/// Words in front of "in", "on", "by" and the like with which they make a name: "walk in closet".
const PARTICLES: &[&str] = &[
    "add", "built", "carry", "check", "clip", "drive", "drop", "fold", "log", "plug", "pull",
    "push", "roll", "screw", "slip", "snap", "stand", "stick", "strap", "walk",
];

/// Words in front of a noun that do not say which one.
pub(super) const DETERMINERS: &[&str] = &[
    "a", "an", "the", "some", "any", "my", "your", "our", "his", "her", "their", "all", "both",
    "every", "each", "these", "those", "this", "of", "other", "another",
];

/// The words without those in front of a thing that do not say which one.
pub(super) fn without_determiners(words: &[Word]) -> &[Word] {
    let first = words.iter().position(|word| !word.is_in(DETERMINERS)).unwrap_or(words.len());
    // Something has to be left: "the" may be a name.
    if first == words.len() && !words.is_empty() { &words[first - 1..] } else { &words[first..] }
}

/// Whether the words are a name of one thing, in spite of a word for a relation.
pub(super) fn is_name(words: &[Word]) -> bool {
    NAMES.iter().any(|name| starts_with(words, name) == Some(words.len()))
}

/// What stands between a thing and another one.
pub(super) enum Found {
    Relation {
        kind: RelationKind,
        is_negated: bool,
    },
    /// A relation that is not decided.
    Undecided(&'static str),
}

/// The first relation after the first word: where it begins, and where the other thing does.
pub(super) fn first_relation(words: &[Word]) -> Option<(usize, usize, Found)> {
    (1..words.len()).find_map(|at| {
        let (found, length) = relation_at(&words[at..])?;
        let has_determiner = words.get(at + length).is_some_and(|word| word.is_in(DETERMINERS));
        if at == 1 && words[0].is_in(PARTICLES) && !has_determiner {
            return None;
        }
        Some((at, at + length, found))
    })
}

/// The relation with which the words begin, and its number of words. Something follows it.
pub(super) fn relation_at(words: &[Word]) -> Option<(Found, usize)> {
    let decided = RELATIONS.iter().filter_map(|&(phrase, kind, is_negated)| {
        let length = starts_with(words, phrase).filter(|length| *length < words.len())?;
        Some((Found::Relation { kind, is_negated }, length))
    });
    let undecided = UNDECIDED
        .iter()
        .filter_map(|&phrase| Some((Found::Undecided(phrase), starts_with(words, phrase)?)));
    // The longest one: "on top of", and not "on".
    decided.chain(undecided).max_by_key(|(_, length)| *length)
}
