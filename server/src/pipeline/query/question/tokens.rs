//! Words of a text, in small letters. What stands in quotes is one word.

use super::subject::QUOTES;

/// A word.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Word {
    pub text: String,
    /// Whether it stood in quotes: then it is a name, whatever its words mean.
    is_literal: bool,
}

impl Word {
    /// Whether it is one of these words, and not in quotes.
    pub fn is_in(&self, words: &[&str]) -> bool {
        !self.is_literal && words.contains(&&*self.text)
    }

    /// The text, unless it stood in quotes.
    pub fn plain(&self) -> Option<&str> {
        (!self.is_literal).then_some(&*self.text)
    }
}

/// The words of a text, without punctuation around them.
pub(super) fn words(text: &str) -> Vec<Word> {
    let mut words = Vec::new();
    let mut rest = text.trim_start();
    while !rest.is_empty() {
        if let Some((literal, after)) = quoted(rest) {
            words.push(Word { text: literal.trim().to_owned(), is_literal: true });
            rest = after.trim_start();
            continue;
        }
        let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
        let word = rest[..end].trim_matches([',', ';', ':', '.', '!', '?', '…']);
        if !word.is_empty() {
            let text = word.to_lowercase().replace('’', "'");
            words.push(Word { text, is_literal: false });
        }
        rest = rest[end..].trim_start();
    }
    words
}

/// What stands in quotes at the start of a text, and what follows. Single quotes are no quotes here: they
/// are also apostrophes.
fn quoted(text: &str) -> Option<(&str, &str)> {
    QUOTES.iter().filter(|[first, _]| !matches!(first, '\'' | '‘')).find_map(|[first, last]| {
        let inside = text.strip_prefix(*first)?;
        let (literal, after) = inside.split_once(*last)?;
        let is_whole = after.chars().next().is_none_or(|c| c.is_whitespace() || c == ',');
        (is_whole && !literal.trim().is_empty()).then_some((literal, after))
    })
}

/// The number of words of `phrase` if `words` begin with it, none of them in quotes.
pub(super) fn starts_with(words: &[Word], phrase: &str) -> Option<usize> {
    let mut count = 0;
    for wanted in phrase.split(' ') {
        if words.get(count)?.plain()? != wanted {
            return None;
        }
        count += 1;
    }
    Some(count)
}

/// The words as one text.
pub(super) fn joined(words: &[Word]) -> String {
    words.iter().map(|word| &*word.text).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_small_and_quotes_hold_together() {
        let texts = |text| words(text).into_iter().map(|word| word.text).collect::<Vec<_>>();
        assert_eq!(texts("The RED  Chair, please"), ["the", "red", "chair", "please"]);
        assert_eq!(texts("red \"Red Wine\" bottle"), ["red", "Red Wine", "bottle"]);
        assert_eq!(texts("5\" screen"), ["5\"", "screen"]);
        assert_eq!(texts("chair that isn’t red"), ["chair", "that", "isn't", "red"]);
        let quoted = words("\"on\" on");
        assert!(!quoted[0].is_in(&["on"]) && quoted[1].is_in(&["on"]));
        assert_eq!(starts_with(&words("on top of it"), "on top of"), Some(3));
        assert_eq!(starts_with(&words("on \"top\" of it"), "on top of"), None);
    }
}
