//! Words for colors and sizes, and names that only look as if they had a color.

use super::plural::singular;
use super::tokens::{Word, starts_with};
use super::wanted::{AttributeKind, Color, Size};

/// Words for colors. Names of things ("rose", "olive", "gold") are left out.
const COLORS: &[(&str, Color)] = &[
    ("red", Color::Red),
    ("reddish", Color::Red),
    ("crimson", Color::Red),
    ("scarlet", Color::Red),
    ("orange", Color::Orange),
    ("yellow", Color::Yellow),
    ("yellowish", Color::Yellow),
    ("green", Color::Green),
    ("greenish", Color::Green),
    ("turquoise", Color::Turquoise),
    ("teal", Color::Turquoise),
    ("cyan", Color::Turquoise),
    ("blue", Color::Blue),
    ("bluish", Color::Blue),
    ("purple", Color::Purple),
    ("violet", Color::Purple),
    ("pink", Color::Pink),
    ("magenta", Color::Pink),
    ("brown", Color::Brown),
    ("brownish", Color::Brown),
    ("beige", Color::Beige),
    ("white", Color::White),
    ("grey", Color::Grey),
    ("gray", Color::Grey),
    ("black", Color::Black),
];

/// Words in front of a color that hardly change which one it is.
const SHADES: &[&str] = &[
    "bright", "pale", "deep", "vivid", "pure", "plain", "navy", "sky", "royal", "lime", "olive",
    "forest", "mint", "hot", "blood", "snow", "jet",
];

/// Words in front of an attribute that do not change it.
pub(super) const DEGREES: &[&str] =
    &["very", "really", "quite", "rather", "mostly", "fairly", "so"];

const COLORED: &[&str] = &["colored", "coloured", "color", "colour"];

/// Names whose first word is no color or size of the thing.
const COMPOUNDS: &[&str] = &[
    "red wine",
    "red cabbage",
    "red onion",
    "red panda",
    "red cross",
    "red bull",
    "white wine",
    "white board",
    "white bread",
    "white rice",
    "white noise",
    "white house",
    "black board",
    "black box",
    "black tea",
    "black coffee",
    "black pepper",
    "black bear",
    "black light",
    "black hole",
    "brown bread",
    "brown rice",
    "brown bear",
    "brown sugar",
    "green bean",
    "green tea",
    "green onion",
    "green screen",
    "green house",
    "blue cheese",
    "blue ray",
    "blue print",
    "blue whale",
    "blue jay",
    "yellow pages",
    "orange juice",
    "orange peel",
    "orange tree",
    "orange slice",
    "pink panther",
    "grey hound",
    "dark chocolate",
    "dark room",
    "dark matter",
    "light bulb",
    "light switch",
    "light fixture",
    "light source",
    "light stand",
    "light box",
    "light saber",
    "light strip",
    "light pole",
    "light post",
    "light house",
    "light shade",
    "light string",
    "light beer",
    "big ben",
    "big bang",
    "big toe",
    "little finger",
    "small talk",
    "small change",
    "large intestine",
];

const fn size(word: &'static str, is_height: bool, is_more: bool, is_most: bool) -> Size {
    Size { word, is_height, is_more, is_most }
}

const SIZES: &[Size] = &[
    size("big", false, true, false),
    size("large", false, true, false),
    size("huge", false, true, false),
    size("small", false, false, false),
    size("little", false, false, false),
    size("tiny", false, false, false),
    size("tall", true, true, false),
    size("low", true, false, false),
    size("biggest", false, true, true),
    size("largest", false, true, true),
    size("smallest", false, false, true),
    size("tallest", true, true, true),
    size("lowest", true, false, true),
];

/// Whether a name begins here whose first word is no attribute, such as "red wine".
pub(super) fn is_compound(words: &[Word]) -> bool {
    let Some([first, second]) = words.first_chunk() else { return false };
    let (Some(first), Some(second)) = (first.plain(), second.plain()) else { return false };
    let name = format!("{first} {}", singular(second, Some(first)));
    COMPOUNDS.contains(&&*name)
}

/// The color of a word: "red", "red-colored".
pub(super) fn color(word: &Word) -> Option<Color> {
    let text = word.plain()?;
    let text = COLORED.iter().find_map(|end| text.strip_suffix(end)?.strip_suffix('-'));
    let text = text.or_else(|| word.plain())?;
    COLORS.iter().find(|(name, _)| *name == text).map(|(_, color)| *color)
}

/// The color at the start of the words, with a darkness: "dark red", "light-blue", "navy blue colored". With
/// the number of words.
pub(super) fn color_at(words: &[Word]) -> Option<(Vec<AttributeKind>, usize)> {
    let first = words.first()?;
    let is_colored = |at: usize| words.get(at).is_some_and(|word| word.is_in(COLORED));
    if let Some((shade, name)) = first.plain()?.split_once('-')
        && let Some((_, color)) = COLORS.iter().find(|(known, _)| *known == name)
        && (darkness(shade).is_some() || SHADES.contains(&shade))
    {
        return Some((with_darkness(darkness(shade), *color), 1));
    }
    let shade = first.plain().filter(|word| darkness(word).is_some() || SHADES.contains(word));
    let at = usize::from(shade.is_some());
    let color = color(words.get(at)?)?;
    let kinds = with_darkness(shade.and_then(darkness), color);
    Some((kinds, at + 1 + usize::from(is_colored(at + 1))))
}

fn with_darkness(darkness: Option<AttributeKind>, color: Color) -> Vec<AttributeKind> {
    darkness.into_iter().chain([AttributeKind::Color(color)]).collect()
}

fn darkness(word: &str) -> Option<AttributeKind> {
    match word {
        "dark" | "navy" => Some(AttributeKind::Dark),
        "light" => Some(AttributeKind::Light),
        _ => None,
    }
}

/// A size, "dark", or "light", at the start of the words, with the number of words.
pub(super) fn size_at(words: &[Word]) -> Option<(Vec<AttributeKind>, usize)> {
    let word = words.first()?.plain()?;
    if let Some(size) = SIZES.iter().find(|size| size.word == word) {
        return Some((vec![AttributeKind::Size(*size)], 1));
    }
    let colored = COLORED.iter().find_map(|end| word.strip_suffix(end)?.strip_suffix('-'));
    if let Some(kind) = colored.and_then(darkness) {
        return Some((vec![kind], 1));
    }
    let kind = darkness(word).filter(|_| word != "navy")?;
    let is_colored = ["colored", "coloured"];
    let more = is_colored.iter().any(|end| starts_with(&words[1..], end).is_some());
    Some((vec![kind], 1 + usize::from(more)))
}
