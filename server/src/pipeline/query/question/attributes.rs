//! What a text says of a thing beside its name: colors and sizes, in front of the name and behind it.

use super::colors::{self, DEGREES};
use super::relations::without_determiners;
use super::tokens::{self, Word};
use super::wanted::Attribute;

/// Words that negate.
pub(super) const NOT: &[&str] =
    &["not", "isn't", "aren't", "wasn't", "non", "never", "except", "excluding"];
/// Words between a thing and what is said of it.
pub(super) const CONNECTORS: &[&str] = &[
    "that",
    "which",
    "who",
    "is",
    "are",
    "was",
    "that's",
    "but",
    "for",
    "the",
    "one",
    "ones",
    "standing",
    "sitting",
    "lying",
    "hanging",
    "placed",
    "located",
    "positioned",
    "mounted",
    "stored",
    "resting",
    "leaning",
    "kept",
    "directly",
    "right",
    "just",
    "somewhere",
    "painted",
];

/// Attributes behind a name: "chair that is not red", "chair red". With the words in front of them.
pub(super) fn attributes_behind(words: &[Word]) -> (&[Word], Vec<Attribute>) {
    let is_clause = |word: &Word| word.is_in(CONNECTORS) || word.is_in(NOT);
    for at in 1..words.len() {
        let is_last = at + 1 == words.len();
        let has_color = || words[at].text != "orange" && colors::color(&words[at]).is_some();
        if !(is_clause(&words[at]) || is_last && has_color()) {
            continue;
        }
        let (rest, is_not) = connectors_in_front(&words[at..]);
        if let Some(attributes) = list(rest, is_not) {
            return (&words[..at], attributes);
        }
    }
    (words, Vec::new())
}

/// The attributes of which these words consist: "dark red", "red and white", "not red or blue ones".
pub(super) fn list(words: &[Word], is_not: bool) -> Option<Vec<Attribute>> {
    let mut attributes = Vec::new();
    let mut at = 0;
    while at < words.len() {
        let is_between = !attributes.is_empty() && at + 1 < words.len();
        if (is_between && words[at].is_in(&["and"]))
            || (is_between && is_not && words[at].is_in(&["or", "nor"]))
            || words[at].is_in(DEGREES)
            || (!attributes.is_empty() && words[at].is_in(&["one", "ones"]))
        {
            at += 1;
            continue;
        }
        let rest = &words[at..];
        let (kinds, length) = colors::color_at(rest).or_else(|| colors::size_at(rest))?;
        attributes.extend(kinds.into_iter().map(|kind| Attribute { kind, is_negated: is_not }));
        at += length;
    }
    (!attributes.is_empty()).then_some(attributes)
}

/// Attributes in front of a name, and the words without them. Colors are found behind other adjectives, too:
/// "old red chair". The last word of the name stays, since "orange" alone is a fruit.
pub(super) fn attributes_in_front(words: &[Word]) -> (Vec<Word>, Vec<Attribute>) {
    let of = words.iter().position(|word| word.is_in(&["of"]));
    let head = of.unwrap_or(words.len()).saturating_sub(1);
    let (mut name, mut attributes) = (Vec::new(), Vec::new());
    let mut at = 0;
    while at < head {
        let mut start = at;
        let mut is_not = false;
        while start < head && (words[start].is_in(NOT) || words[start].is_in(DEGREES)) {
            is_not ^= words[start].is_in(NOT);
            start += 1;
        }
        let prefixed = words[start].plain().and_then(|word| word.strip_prefix("non-"));
        let without_prefix = prefixed.map(tokens::words);
        is_not ^= prefixed.is_some();
        let rest = without_prefix.as_deref().unwrap_or(&words[start..]);
        let found = (!colors::is_compound(rest))
            .then(|| {
                colors::color_at(rest).or_else(|| colors::size_at(rest).filter(|_| name.is_empty()))
            })
            .flatten()
            .filter(|(_, length)| start + length <= head);
        let Some((kinds, length)) = found else {
            let is_and = words[at].is_in(&["and"]) && !attributes.is_empty() && name.is_empty();
            if !is_and {
                name.push(words[at].clone());
            }
            at += 1;
            continue;
        };
        attributes.extend(kinds.into_iter().map(|kind| Attribute { kind, is_negated: is_not }));
        at = start + length;
    }
    name.extend(words[at..].iter().cloned());
    (without_determiners(&name).to_vec(), attributes)
}

/// The words without those in front that connect a thing with what is said of it, and whether these negate it.
pub(super) fn connectors_in_front(words: &[Word]) -> (&[Word], bool) {
    let (mut start, mut is_not) = (0, false);
    while start < words.len() && (words[start].is_in(CONNECTORS) || words[start].is_in(NOT)) {
        is_not ^= words[start].is_in(NOT);
        start += 1;
    }
    (&words[start..], is_not)
}
