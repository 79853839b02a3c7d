//! The part of a question that says what is asked for: of "Where is the bed?", "bed".
//!
//! Text towers learned names of things, not questions: asked "where is the bed", the tiny bundle says that
//! no bed is there.

/// Ways to ask for a thing, in front of its name.
const OPENINGS: &[&str] = &[
    "where is",
    "where are",
    "where's",
    "where did i leave",
    "where did i put",
    "which one is",
    "which of",
    "what about",
    "is that",
    "how many",
    "have you seen",
    "where can i find",
    "where do i find",
    "is there",
    "are there",
    "can you see",
    "do you see",
    "can you find",
    "could you find",
    "can you show me",
    "could you show me",
    "i am looking for",
    "i'm looking for",
    "i need",
    "i lost",
    "i cannot find",
    "i can't find",
    "tell me where",
    "can you tell me where",
    "could you tell me where",
    "do you know where",
    "look for",
    "search for",
    "find me",
    "find",
    "show me",
    "show",
    "locate",
    "point at",
    "point to",
    "go to",
    "take me to",
    "bring me to",
    "give me",
    "get me",
    "i want",
    "please",
];

/// Words behind the name that say nothing.
const ENDINGS: &[&str] = &[
    "please",
    "are there",
    "is",
    "are",
    "in here",
    "around here",
    "here",
    "over there",
    "in this room",
    "in the room",
    "in the map",
];

const ARTICLES: &[&str] = &["a", "an", "the", "some", "any", "my", "your", "our"];

const PUNCTUATION: &[char] = &['.', ',', ';', ':', '!', '?', '…', '¡', '¿'];

pub(super) const QUOTES: &[[char; 2]] =
    &[['"', '"'], ['\'', '\''], ['“', '”'], ['„', '“'], ['‘', '’'], ['«', '»'], ['`', '`']];

const BRACKETS: &[[char; 2]] = &[['(', ')'], ['[', ']'], ['{', '}']];

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Subject<'a> {
    /// What stood in quotes, word by word.
    Literal(&'a str),
    /// A part of the text. Empty if the text has no words.
    Words(&'a str),
}

/// What a text asks for, a part of it: without punctuation and brackets around it, the words of the question,
/// and articles in front.
pub(super) fn subject(text: &str) -> Subject<'_> {
    let text = without_punctuation(text);
    if !text.contains(is_word) {
        return Subject::Words("");
    }
    if let Some(literal) = between(text, QUOTES) {
        return Subject::Literal(without_punctuation(literal));
    }
    if let Some(inside) = between(text, BRACKETS) {
        return subject(inside);
    }
    let mut name = text;
    while let Some(rest) = OPENINGS.iter().find_map(|opening| after_words(name, opening)) {
        name = rest;
    }
    while let Some(rest) = ENDINGS.iter().find_map(|ending| before_words(name, ending)) {
        name = rest;
    }
    while let Some(rest) = ARTICLES.iter().find_map(|article| after_words(name, article)) {
        name = rest;
    }
    match between(name, QUOTES) {
        Some(literal) => Subject::Literal(literal.trim()),
        None => Subject::Words(name),
    }
}

/// Whether this is more than a mark. Symbols such as ☕ are words.
fn is_word(letter: char) -> bool {
    let marks = QUOTES.iter().chain(BRACKETS).flatten().chain(PUNCTUATION);
    !letter.is_whitespace()
        && !"-–_/".contains(letter)
        && marks.into_iter().all(|mark| *mark != letter)
}

fn without_punctuation(text: &str) -> &str {
    text.trim_matches(|c: char| c.is_whitespace() || PUNCTUATION.contains(&c))
}

/// What stands between two marks of a pair that are nowhere else in the text.
fn between<'a>(text: &'a str, pairs: &[[char; 2]]) -> Option<&'a str> {
    pairs.iter().find_map(|[first, last]| {
        let inside = text.strip_prefix(*first)?.strip_suffix(*last)?;
        (!inside.contains([*first, *last]) && !inside.trim().is_empty()).then_some(inside)
    })
}

/// What follows these words, whose case does not matter. `None` if nothing does.
fn after_words<'a>(text: &'a str, words: &str) -> Option<&'a str> {
    let (start, rest) = text.split_at_checked(words.len())?;
    let is_whole = rest.starts_with(|c: char| c.is_whitespace() || PUNCTUATION.contains(&c));
    let rest = without_punctuation(rest);
    (start.eq_ignore_ascii_case(words) && is_whole && !rest.is_empty()).then_some(rest)
}

/// What stands before these words, whose case does not matter. `None` if nothing does.
fn before_words<'a>(text: &'a str, words: &str) -> Option<&'a str> {
    let (rest, end) = text.split_at_checked(text.len().checked_sub(words.len())?)?;
    let is_whole = rest.ends_with(|c: char| c.is_whitespace() || PUNCTUATION.contains(&c));
    let rest = without_punctuation(rest);
    (end.eq_ignore_ascii_case(words) && is_whole && !rest.is_empty()).then_some(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text_of(text: &str) -> &str {
        match subject(text) {
            Subject::Literal(text) | Subject::Words(text) => text,
        }
    }

    #[test]
    fn a_question_asks_for_its_noun() {
        for question in [
            "bed",
            " bed\n",
            "bed?",
            "bed!",
            "bed,",
            "\"bed\"",
            "“bed”",
            "(bed)",
            "the bed",
            "a bed",
            "Where is the bed?",
            "where is the bed",
            "Where's my bed?!",
            "Is there a bed in here?",
            "Please, show me the bed.",
            "Can you find a bed, please?",
            "find the \"bed\"",
            "the \"bed\"",
            "Where is the bed, please?",
            "Where did I leave my bed?",
            "bed in the room",
            "Can you tell me where the bed is?",
            "I can't find my bed.",
            "the bed over there",
        ] {
            assert_eq!(text_of(question), "bed", "{question}");
        }
        assert_eq!(text_of("WHERE ARE THE COFFEE CUPS"), "COFFEE CUPS");
        assert_eq!(
            text_of("¿Where is the red chair next to the window?"),
            "red chair next to the window"
        );
    }

    #[test]
    fn names_stay_as_they_are() {
        for name in [
            "coffee cup",
            "A4 paper",
            "theatre",
            "showcase",
            "find",
            "the",
            "please",
            "person in the kitchen",
            "cup (red)",
            "5\" screen",
            "rock 'n' roll poster",
            "(red) cup (small)",
            "où est le lit",
            "いす",
        ] {
            assert_eq!(subject(name), Subject::Words(name));
        }
        assert_eq!(subject("\"Where is the Way\""), Subject::Literal("Where is the Way"));
        assert_eq!(subject("Where is the 'Way'?"), Subject::Literal("Way"));
    }

    #[test]
    fn nothing_but_marks_asks_for_nothing() {
        for text in ["", "?", " ?! ", "...", "()", "\"\"", "«»", "-"] {
            assert_eq!(text_of(text), "");
        }
        assert_eq!(text_of("☕"), "☕");
        assert_eq!(text_of("the a"), "a", "something is left");
    }
}
