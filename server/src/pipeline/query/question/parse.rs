//! From a text to what it asks for.
//!
//! The relation is looked for first, from the left: what stands before it is the thing, what follows is the
//! other thing, which may have attributes and a relation of its own. Then attributes are taken out of the
//! name: those behind it ("chair that is not red") and those in front ("dark red chair").

use super::attributes::{
    CONNECTORS, NOT, attributes_behind, attributes_in_front, connectors_in_front, list,
};
use super::plural::singular;
use super::purposes;
use super::relations::{self, DETERMINERS, Found, without_determiners};
use super::subject::{Subject, subject};
use super::tokens::{Word, joined, words};
use super::wanted::{Relation, RelationKind, Wanted};

/// The most things in a row, such as "cup on the table next to the window".
const MAX_THINGS: usize = 4;

/// Nouns that name no kind of thing.
const ANYTHING: &[&str] = &[
    "thing",
    "things",
    "something",
    "anything",
    "everything",
    "object",
    "objects",
    "item",
    "items",
    "stuff",
    "one",
    "ones",
    "what",
    "what's",
    "that",
    "it",
];

/// Words that negate in a way that is never understood.
const NO: &[&str] = &["no", "nor", "neither", "nothing", "without", "don't", "doesn't"];
/// Names with such a word.
const NAMES_WITH_NO: &[&str] =
    &["no smoking", "no entry", "no parking", "do not disturb", "forget me not"];

const NUMBERS: &[&str] =
    &["two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "several", "many"];

/// Why a text is no question.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Unclear {
    /// It has no words.
    Empty,
    /// What is not understood, and what to ask instead.
    Refused(String),
}

type Result<T> = std::result::Result<T, Unclear>;

/// The name of a thing as it is embedded, with all that is said of it: "red chair". `None` if the text has no
/// words.
pub(crate) fn name(text: &str) -> Option<String> {
    match subject(text) {
        Subject::Words("") => None,
        Subject::Literal(literal) => Some(literal.to_owned()),
        Subject::Words(text) => {
            let words = words(text);
            // Symbols that are trimmed from words can be all there is.
            Some(if words.is_empty() { text.to_owned() } else { noun(without_determiners(&words)) })
        }
    }
}

/// What a text asks for.
///
/// # Errors
/// [`Unclear`]: it has no words, or something that is neither understood nor part of a name.
pub(crate) fn wanted(text: &str) -> Result<Wanted> {
    match subject(text) {
        Subject::Words("") => Err(Unclear::Empty),
        Subject::Literal(literal) => Ok(Wanted::plain(literal)),
        Subject::Words(text) => match &words(text)[..] {
            [] => Ok(Wanted::plain(text)),
            words => thing(&predicate(words), MAX_THINGS),
        },
    }
}

/// "Which chairs are red?" and "Is the chair red?" as "chairs are red" and "chair red".
fn predicate(words: &[Word]) -> Vec<Word> {
    let asks = words[0].is_in(&["which", "what", "is", "are"]) && words.len() > 2;
    if asks && !words[1].is_in(&["is", "are"]) { words[1..].to_vec() } else { words.to_vec() }
}

/// A thing with all that is said of it. `left`: things that may still follow, this one included.
fn thing(words: &[Word], left: usize) -> Result<Wanted> {
    let words = without_determiners(words);
    if left == 0 {
        return Err(refused(format!("expected at most {MAX_THINGS} things in a row, found more")));
    }
    if relations::is_name(words) || NAMES_WITH_NO.iter().any(|no| joined(words).contains(no)) {
        return Ok(Wanted::plain(joined(words)));
    }
    if let Some((names, length)) = purposes::at_start(words) {
        return with_purpose(names, &words[length..], left);
    }
    if let Some((_, length)) = relations::relation_at(words)
        && words.get(length).is_some_and(|word| word.is_in(DETERMINERS))
    {
        return Err(no_kind(&joined(words)));
    }
    if let Some(wanted) = nearest_in_front(words, left)? {
        return Ok(wanted);
    }
    let Some((end, start, found)) = relations::first_relation(words) else {
        return described(words, None);
    };
    let (before, is_not) = without_connectors(&words[..end]);
    let after = &words[start..];
    match found {
        Found::Undecided(phrase) => Err(undecided(phrase)),
        Found::Relation { kind: RelationKind::In, .. }
            if let Some(colors) = list(after, is_not) =>
        {
            let mut wanted = described(before, None)?;
            wanted.attributes.extend(colors);
            Ok(wanted)
        }
        Found::Relation { kind, is_negated } => {
            let relation = related(kind, is_negated != is_not, before, after, left)?;
            described(before, Some(relation))
        }
    }
}

/// "Nearest chair to the window".
fn nearest_in_front(words: &[Word], left: usize) -> Result<Option<Wanted>> {
    let kind = match words.first() {
        Some(_) if words.len() == 1 => return Ok(None),
        Some(word) if word.is_in(&["nearest", "closest"]) => RelationKind::Nearest,
        Some(word) if word.is_in(&["farthest", "furthest"]) => RelationKind::Farthest,
        _ => return Ok(None),
    };
    let to = words.iter().position(|word| word.is_in(&["to", "from"]));
    match to.filter(|to| *to > 1 && to + 1 < words.len()) {
        Some(to) => {
            let relation = related(kind, false, &words[1..to], &words[to + 1..], left)?;
            described(&words[1..to], Some(relation)).map(Some)
        }
        None => {
            let (word, noun) = (&words[0].text, noun(&words[1..]));
            let reason = format!("{word:?} to what? Ask for \"{noun} {word} to …\"");
            Err(refused(reason))
        }
    }
}

/// A thing by its purpose, with what follows.
fn with_purpose(names: Vec<String>, rest: &[Word], left: usize) -> Result<Wanted> {
    let mut wanted = Wanted { names, attributes: Vec::new(), relation: None };
    if rest.is_empty() {
        return Ok(wanted);
    }
    let (rest, is_not) = connectors_in_front(rest);
    match relations::relation_at(rest) {
        Some((Found::Relation { kind, is_negated }, length)) => {
            let after = &rest[length..];
            wanted.relation = Some(related(kind, is_negated != is_not, &[], after, left)?);
            Ok(wanted)
        }
        Some((Found::Undecided(phrase), _)) => Err(undecided(phrase)),
        None => {
            let reason = format!("found {:?} behind a purpose: leave it out", joined(rest));
            Err(refused(reason))
        }
    }
}

/// The relation to what `after` names.
fn related(
    kind: RelationKind,
    is_negated: bool,
    before: &[Word],
    after: &[Word],
    left: usize,
) -> Result<Box<Relation>> {
    if let Some(last) = before.last()
        && last.is_in(&["and", "or", "both"])
    {
        let reason = format!("expected one relation of {:?}, found several", joined(before));
        return Err(refused(reason));
    }
    let and = after.iter().position(|word| word.is_in(&["and"]));
    let others = match and.filter(|and| kind == RelationKind::Between && *and > 0) {
        Some(and) => vec![thing(&after[..and], left - 1)?, thing(&after[and + 1..], left - 1)?],
        None => vec![thing(after, left - 1)?],
    };
    if let Some(other) = others.iter().find(|one| ANYTHING.contains(&&*one.object())) {
        let reason = format!("{} names no kind of thing: say which one", quoted(&other.object()));
        return Err(refused(reason));
    }
    Ok(Box::new(Relation { kind, is_negated, others }))
}

/// A thing with its attributes, to which a relation is added.
fn described(words: &[Word], relation: Option<Box<Relation>>) -> Result<Wanted> {
    let (words, mut attributes) = attributes_behind(words);
    let words = without_determiners(words);
    let whole = joined(words);
    let (words, in_front) = attributes_in_front(words);
    attributes.splice(0..0, in_front);
    check_negations(&words)?;
    check_count(&words)?;
    let name = noun(&words);
    let says_more = !attributes.is_empty() || relation.is_some();
    if words.is_empty() || (says_more && ANYTHING.contains(&&*name)) || name.starts_with("what") {
        return Err(no_kind(&whole));
    }
    Ok(Wanted { names: vec![name], attributes, relation })
}

/// Refuses several things: only colors and the two things that something is between are joined.
fn check_count(words: &[Word]) -> Result<()> {
    if !words.iter().any(|word| word.is_in(&["and", "or"])) {
        return Ok(());
    }
    Err(refused(format!(
        "{} names several things: ask for one at a time, compare several as texts (on the dashboard and the \
         command line with commas between them), or put quotes around a name",
        quoted(&joined(words))
    )))
}

/// Refuses a negation that is left in a name.
fn check_negations(words: &[Word]) -> Result<()> {
    let is_not = |word: &Word| word.is_in(NOT) || word.is_in(NO);
    let pairs = [
        ["other", "than"],
        ["instead", "of"],
        ["anything", "but"],
        ["anything", "except"],
        ["everything", "but"],
        ["everything", "except"],
    ];
    let has_pair =
        |pair: &[Word]| pairs.iter().any(|[a, b]| pair[0].is_in(&[a]) && pair[1].is_in(&[b]));
    if !words.iter().any(is_not) && !words.windows(2).any(has_pair) {
        return Ok(());
    }
    let asked = quoted(&joined(words));
    if words.first().is_some_and(is_not) || words.windows(2).any(has_pair) {
        let pair = words.windows(2).position(has_pair);
        let rest = words.get(pair.map_or(1, |at| at + 2)..).unwrap_or_default();
        let thing = noun(without_determiners(rest));
        return Err(refused(format!(
            "{asked} only says what is not meant: ask for the thing that is meant, or for what sets it \
             apart, as in \"{} that is not red\"; texts compare things with each other",
            if thing.is_empty() { "chair" } else { &*thing }
        )));
    }
    Err(refused(format!(
        "the negation in {asked} is not understood: only colors, sizes and places can be negated; put \
         quotes around a name"
    )))
}

/// The words without those at the end that connect them with a relation, and whether these negate it.
fn without_connectors(words: &[Word]) -> (&[Word], bool) {
    let (mut end, mut is_not) = (words.len(), false);
    while end > 1 && (words[end - 1].is_in(CONNECTORS) || words[end - 1].is_in(NOT)) {
        end -= 1;
        is_not ^= words[end].is_in(NOT);
    }
    (&words[..end], is_not)
}

/// The name of a thing: its noun in the singular.
fn noun(words: &[Word]) -> String {
    let of = words.iter().position(|word| word.is_in(&["of"])).filter(|of| *of > 0);
    let head = of.unwrap_or(words.len()).saturating_sub(1);
    let mut texts: Vec<String> = words.iter().map(|word| word.text.clone()).collect();
    let Some(plural) = words.get(head).and_then(Word::plain) else { return texts.join(" ") };
    let before = head.checked_sub(1).map(|at| &*words[at].text);
    let one = singular(plural, before);
    let is_counted = one != plural && head > 0 && words[0].is_in(NUMBERS);
    texts[head] = one;
    texts.split_off(usize::from(is_counted)).join(" ")
}

/// A text that has attributes or a relation, and no name.
fn no_kind(text: &str) -> Unclear {
    let what = if text.is_empty() { "this".into() } else { quoted(text) };
    refused(format!(
        "{what} names no kind of thing: say which, as in \"red cup\" or \"cup on the table\""
    ))
}

fn quoted(text: &str) -> String {
    format!("\"{text}\"")
}

fn refused(reason: String) -> Unclear {
    Unclear::Refused(reason)
}

fn undecided(phrase: &str) -> Unclear {
    refused(format!(
        "\"{phrase}\" is not decided: ask with next to, on, in, under, above, between, nearest to, left of, \
         right of, in front of or behind, and another thing"
    ))
}
