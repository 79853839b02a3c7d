//! Nouns in the singular: maps are asked for "chairs" and know "chair".

/// Plurals without a rule. A noun may end with them: "bookshelves".
const IRREGULAR: &[(&str, &str)] = &[
    ("shelves", "shelf"),
    ("knives", "knife"),
    ("leaves", "leaf"),
    ("loaves", "loaf"),
    ("scarves", "scarf"),
    ("wolves", "wolf"),
    ("calves", "calf"),
    ("halves", "half"),
    ("people", "person"),
    ("women", "woman"),
    ("children", "child"),
    ("feet", "foot"),
    ("teeth", "tooth"),
    ("geese", "goose"),
    ("mice", "mouse"),
    ("cacti", "cactus"),
];

/// Plurals without a rule that must be the whole noun: "specimen" is none.
const IRREGULAR_ALONE: &[(&str, &str)] = &[
    ("men", "man"),
    ("firemen", "fireman"),
    ("policemen", "policeman"),
    ("snowmen", "snowman"),
    ("wives", "wife"),
    ("elves", "elf"),
    ("buses", "bus"),
    ("lenses", "lens"),
    ("gases", "gas"),
    ("canvases", "canvas"),
    ("atlases", "atlas"),
    ("thermoses", "thermos"),
    ("menus", "menu"),
    ("emus", "emu"),
    ("skis", "ski"),
    ("taxis", "taxi"),
    ("kiwis", "kiwi"),
    ("bikinis", "bikini"),
    ("cookies", "cookie"),
    ("movies", "movie"),
    ("pies", "pie"),
    ("ties", "tie"),
    ("neckties", "necktie"),
    ("hoodies", "hoodie"),
    ("brownies", "brownie"),
    ("smoothies", "smoothie"),
    ("selfies", "selfie"),
    ("potatoes", "potato"),
    ("tomatoes", "tomato"),
    ("mangoes", "mango"),
    ("heroes", "hero"),
    ("mosquitoes", "mosquito"),
    ("axes", "axe"),
];

/// Nouns that end like plurals. Their singular is the same, another thing, or none: a pair of scissors is
/// no scissor, stairs are no stair, and glasses are not glass.
const NO_PLURALS: &[&str] = &[
    "glasses",
    "eyeglasses",
    "sunglasses",
    "scissors",
    "stairs",
    "downstairs",
    "upstairs",
    "pants",
    "trousers",
    "jeans",
    "shorts",
    "tights",
    "leggings",
    "pajamas",
    "pyjamas",
    "overalls",
    "suspenders",
    "clothes",
    "headphones",
    "earphones",
    "goggles",
    "binoculars",
    "pliers",
    "tongs",
    "tweezers",
    "shears",
    "clippers",
    "blinds",
    "bellows",
    "goods",
    "groceries",
    "belongings",
    "electronics",
    "news",
    "series",
    "species",
    "bus",
    "gas",
    "lens",
    "canvas",
    "atlas",
    "pancreas",
    "christmas",
    "texas",
    "adidas",
    "bias",
    "thermos",
    "chaos",
    "cosmos",
    "mars",
    "gps",
    "ios",
    "barracks",
    "molasses",
    "works",
    "steelworks",
    "physics",
    "athletics",
    "gymnastics",
    "mathematics",
];

/// What one fills: then "glasses" are several of them.
const DRINKS: &[&str] =
    &["wine", "water", "beer", "champagne", "cocktail", "drinking", "shot", "whiskey", "juice"];

/// A noun in the singular, in small letters. `before`: the word in front of it.
pub(super) fn singular(noun: &str, before: Option<&str>) -> String {
    if noun == "glasses" && before.is_some_and(|word| DRINKS.contains(&word)) {
        return "glass".into();
    }
    if NO_PLURALS.contains(&noun) || noun.contains(['\'', '’']) {
        return noun.into();
    }
    let alone = IRREGULAR_ALONE.iter().find(|(plural, _)| *plural == noun);
    if let Some((_, one)) = alone {
        return (*one).into();
    }
    let ending = IRREGULAR.iter().find_map(|(plural, one)| Some((noun.strip_suffix(plural)?, one)));
    if let Some((start, one)) = ending {
        return format!("{start}{one}");
    }
    regular(noun)
}

fn regular(noun: &str) -> String {
    let letters = noun.chars().count();
    if letters < 3 || ["ss", "us", "is"].iter().any(|end| noun.ends_with(end)) {
        return noun.into();
    }
    if letters > 4
        && let Some(start) = noun.strip_suffix("ies")
    {
        return format!("{start}y");
    }
    let hissing = ["ches", "shes", "xes", "sses"].iter().any(|end| noun.ends_with(end));
    let ending = if hissing { "es" } else { "s" };
    noun.strip_suffix(ending).unwrap_or(noun).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plurals_have_their_singular() {
        for (plural, one) in [
            ("chairs", "chair"),
            ("shelves", "shelf"),
            ("bookshelves", "bookshelf"),
            ("knives", "knife"),
            ("people", "person"),
            ("women", "woman"),
            ("benches", "bench"),
            ("dishes", "dish"),
            ("boxes", "box"),
            ("mattresses", "mattress"),
            ("vases", "vase"),
            ("houses", "house"),
            ("batteries", "battery"),
            ("cookies", "cookie"),
            ("shoes", "shoe"),
            ("potatoes", "potato"),
            ("sofas", "sofa"),
            ("radios", "radio"),
            ("keys", "key"),
            ("tvs", "tv"),
            ("buses", "bus"),
            ("mice", "mouse"),
        ] {
            assert_eq!(singular(plural, None), one);
            assert_eq!(singular(one, None), one, "it stays");
        }
        assert_eq!(singular("glasses", Some("wine")), "glass");
    }

    #[test]
    fn nouns_that_look_like_plurals_stay() {
        for noun in [
            "glasses", "scissors", "stairs", "trousers", "bus", "gas", "lens", "canvas", "dress",
            "glass", "cactus", "tennis", "specimen", "chess", "series", "men's", "sheep", "いす",
            "as",
        ] {
            assert_eq!(singular(noun, Some("reading")), noun);
        }
    }
}
