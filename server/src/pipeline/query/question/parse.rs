//! From a text to what it asks for.
//!
//! The relation is looked for first, from the left: what stands before it is the thing, what follows is the
//! other thing, which may have attributes and a relation of its own. Then attributes are taken out of the
//! name: those behind it ("chair that is not red") and those in front ("dark red chair").

use super::colors::{self, DEGREES};
use super::plural::singular;
use super::purposes;
use super::relations::{self, DETERMINERS, Found};
use super::subject::{Subject, subject};
use super::tokens::{Word, joined, words};
use super::wanted::{Attribute, Relation, RelationKind, Wanted};

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

/// Words that negate.
const NOT: &[&str] = &["not", "isn't", "aren't", "wasn't", "non", "never", "except", "excluding"];
/// Words that negate in a way that is never understood.
const NO: &[&str] = &["no", "nor", "neither", "nothing", "without", "don't", "doesn't"];
/// Names with such a word.
const NAMES_WITH_NO: &[&str] =
    &["no smoking", "no entry", "no parking", "do not disturb", "forget me not"];

/// Words between a thing and what is said of it.
const CONNECTORS: &[&str] = &[
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
    let name = noun(&words);
    let says_more = !attributes.is_empty() || relation.is_some();
    if words.is_empty() || (says_more && ANYTHING.contains(&&*name)) || name.starts_with("what") {
        let what = if whole.is_empty() { "this".into() } else { quoted(&whole) };
        return Err(refused(format!(
            "{what} names no kind of thing: say which, as in \"red cup\" or \"cup on the table\""
        )));
    }
    Ok(Wanted { names: vec![name], attributes, relation })
}

/// Attributes behind a name: "chair that is not red", "chair red". With the words in front of them.
fn attributes_behind(words: &[Word]) -> (&[Word], Vec<Attribute>) {
    let is_clause = |word: &Word| word.is_in(CONNECTORS) || word.is_in(NOT);
    for at in 1..words.len() {
        let has_color = || colors::color(&words[at]).is_some_and(|_| words[at].text != "orange");
        if !is_clause(&words[at]) && !(at + 1 == words.len() && has_color()) {
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
fn list(words: &[Word], is_not: bool) -> Option<Vec<Attribute>> {
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
fn attributes_in_front(words: &[Word]) -> (Vec<Word>, Vec<Attribute>) {
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
        let without_prefix = prefixed.map(|word| super::tokens::words(word));
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
        let thing = noun(without_determiners(words.get(1..).unwrap_or_default()));
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

/// The words without those in front of a thing that do not say which one.
fn without_determiners(words: &[Word]) -> &[Word] {
    let first = words.iter().position(|word| !word.is_in(DETERMINERS)).unwrap_or(words.len());
    // Something has to be left: "the" may be a name.
    if first == words.len() && !words.is_empty() { &words[first - 1..] } else { &words[first..] }
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

/// The same for words in front.
fn connectors_in_front(words: &[Word]) -> (&[Word], bool) {
    let (mut start, mut is_not) = (0, false);
    while start < words.len() && (words[start].is_in(CONNECTORS) || words[start].is_in(NOT)) {
        is_not ^= words[start].is_in(NOT);
        start += 1;
    }
    (&words[start..], is_not)
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
