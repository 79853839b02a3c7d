//! Things by what they are for: "something to sit on" is a chair, a sofa, a stool or a bench.
//!
//! A sentence encoder relates such a phrase to anything about sitting. The table has what one finds in
//! rooms; other purposes are left to the encoder.

use super::tokens::{Word, joined, starts_with};

/// Purposes, and the kinds of things that serve them.
const PURPOSES: &[(&str, &[&str])] = &[
    ("sit", &["chair", "sofa", "stool", "bench"]),
    ("sleep", &["bed", "sofa"]),
    ("lie", &["bed", "sofa"]),
    ("lie down", &["bed", "sofa"]),
    ("eat", &["fruit", "food"]),
    ("eat at", &["table"]),
    ("eat from", &["plate", "bowl"]),
    ("eat with", &["fork", "spoon"]),
    ("drink", &["bottle", "cup", "glass"]),
    ("drink from", &["cup", "mug", "glass"]),
    ("write", &["pen", "pencil"]),
    ("write with", &["pen", "pencil"]),
    ("write on", &["paper", "notebook", "whiteboard"]),
    ("work at", &["desk", "table"]),
    ("read", &["book", "magazine"]),
    ("watch", &["television", "screen"]),
    ("type on", &["keyboard", "laptop"]),
    ("cut with", &["knife", "scissors"]),
    ("cook on", &["stove"]),
    ("play with", &["toy", "ball", "teddy bear"]),
    ("tell the time", &["clock", "watch"]),
];

/// Ways to say the same.
const SAME: &[(&str, &str)] = &[
    ("sit on", "sit"),
    ("sit in", "sit"),
    ("sit down", "sit"),
    ("sit down on", "sit"),
    ("sleep on", "sleep"),
    ("sleep in", "sleep"),
    ("lie on", "lie"),
    ("lie down on", "lie"),
    ("eat on", "eat at"),
    ("eat off", "eat from"),
    ("eat out of", "eat from"),
    ("drink out of", "drink from"),
    ("drink with", "drink from"),
    ("work on", "work at"),
    ("see the time", "tell the time"),
];

/// What stands in front of a purpose.
const OPENINGS: &[&str] = &[
    "something to",
    "something i can",
    "something you can",
    "something one can",
    "something for me to",
    "anything to",
    "thing to",
    "things to",
    "place to",
    "somewhere to",
    "where do i",
    "where can i",
    "where can you",
    "where can one",
    "where can we",
    "what can i",
];

/// The kinds of things that serve the purpose with which the words begin, and its number of words.
pub(super) fn at_start(words: &[Word]) -> Option<(Vec<String>, usize)> {
    let opening = OPENINGS.iter().find_map(|opening| starts_with(words, opening))?;
    let after = &words[opening..];
    // The longest purpose first: "sit down on".
    (1..=after.len().min(3)).rev().find_map(|length| {
        let phrase = joined(&after[..length]);
        let same = SAME.iter().find(|(way, _)| *way == phrase).map_or(&*phrase, |(_, same)| same);
        let (_, kinds) = PURPOSES.iter().find(|(purpose, _)| *purpose == same)?;
        Some((kinds.iter().map(|&kind| kind.to_owned()).collect(), opening + length))
    })
}
