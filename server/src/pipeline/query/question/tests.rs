//! What is understood of many texts.

use super::*;

/// A text that says what is understood: the same text if nothing is left out.
fn understood(text: &str) -> String {
    match wanted(text) {
        Ok(wanted) => wanted.to_string(),
        Err(unclear) => panic!("{text:?}: {unclear:?}"),
    }
}

fn has(wanted: &Wanted, kind: AttributeKind) -> bool {
    wanted.attributes.contains(&Attribute { kind, is_negated: false })
}

fn refusal(text: &str) -> String {
    match wanted(text) {
        Err(Unclear::Refused(reason)) => reason,
        other => panic!("{text:?}: {other:?}"),
    }
}

#[test]
fn many_ways_to_ask_for_a_bed_ask_for_the_same() {
    for text in [
        "bed",
        "Bed",
        "BED",
        "beds",
        "the bed",
        "a bed!",
        "Where is the bed?",
        "where are the beds",
        "Where's my bed?",
        "WHERE IS THE BED",
        "Is there a bed in here?",
        "Are there any beds?",
        "Show me all beds, please.",
        "two beds",
        "\"bed\"",
        "(bed)",
        "find the \"bed\"",
        "How many beds are there?",
        "I'm looking for a bed.",
        "Which one is the bed?",
        "the bed in this room",
    ] {
        assert_eq!(wanted(text), Ok(Wanted::plain("bed")), "{text}");
        assert_eq!(name(text).as_deref(), Some("bed"), "{text}");
    }
}

#[test]
fn attributes_are_taken_out_of_the_name() {
    for (text, expected) in [
        ("Where is the red chair?", "red chair"),
        ("RED CHAIRS", "red chair"),
        ("a dark red chair", "dark red chair"),
        ("light-blue cup", "light blue cup"),
        ("navy blue cup", "dark blue cup"),
        ("gray-colored sofa", "grey sofa"),
        ("red colored chair", "red chair"),
        ("the very big red chair", "big red chair"),
        ("old red chair", "red old chair"),
        ("red and white cushions", "red white cushion"),
        ("chair that is red", "red chair"),
        ("Which chairs are red?", "red chair"),
        ("Is the chair red?", "red chair"),
        ("the chair painted red", "red chair"),
        ("big chair in red", "big red chair"),
        ("largest table", "largest table"),
        ("dark chair", "dark chair"),
        ("a cup of green tea", "cup of green tea"),
        ("red cups of tea", "red cup of tea"),
        ("chair that is not red", "not red chair"),
        ("chairs which aren't red", "not red chair"),
        ("a chair, but not the red one", "not red chair"),
        ("chair that's not red or blue", "not red not blue chair"),
        ("all chairs except the red ones", "not red chair"),
        ("non-red chair", "not red chair"),
        ("not red chair", "not red chair"),
        ("red \"Red Wine\" bottle", "red Red Wine bottle"),
    ] {
        assert_eq!(understood(text), expected, "{text}");
    }
    let found = wanted("dark red chair").unwrap();
    assert_eq!(found.names, ["chair"]);
    assert!(has(&found, AttributeKind::Color(Color::Red)) && has(&found, AttributeKind::Dark));
}

#[test]
fn names_with_colors_and_sizes_are_names() {
    for text in [
        "red wine",
        "white board",
        "black board",
        "orange",
        "orange juice",
        "light",
        "light bulb",
        "bottle of red wine",
        "green bean",
        "computer on wheels",
        "walk in closet",
        "no smoking sign",
        "thing",
        "something",
        "person holding a cup",
        "où est le lit",
        "いす",
        "☕",
    ] {
        assert_eq!(wanted(text), Ok(Wanted::plain(text)), "{text}");
    }
    assert_eq!(understood("white boards"), "white board");
    assert_eq!(wanted("\"red Chairs\""), Ok(Wanted::plain("red Chairs")), "word by word");
    assert_eq!(name("red Chairs").as_deref(), Some("red chair"), "a label has its attributes");
}

#[test]
fn relations_have_another_thing() {
    for (text, expected) in [
        ("the chair next to the window", "chair next to window"),
        ("Where is the red chair by the big window?", "red chair next to big window"),
        ("cups on the tables", "cup on table"),
        ("cup on top of the table", "cup on table"),
        ("the cup that is standing on the table", "cup on table"),
        ("Which cup is on the table?", "cup on table"),
        ("TV on the wall", "tv on wall"),
        ("ball under the bed", "ball under bed"),
        ("picture over the sofa", "picture above sofa"),
        ("apples inside the bowl", "apple in bowl"),
        ("chair to the left of the table", "chair left of table"),
        ("chair at the left of the table", "chair left of table"),
        ("chair in front of the desk", "chair in front of desk"),
        ("lamp between the sofa and the window", "lamp between sofa and window"),
        ("stool in between the chairs", "stool between chair"),
        ("chair closest to the door", "chair nearest to door"),
        ("the nearest chair to the door", "chair nearest to door"),
        ("chair far from the door", "chair not next to door"),
        ("chair that is not next to the table", "chair not next to table"),
        ("table without a laptop", "table without laptop"),
        ("bed with a teddy bear", "bed with teddy bear"),
        ("cup on the table next to the window", "cup on table next to window"),
        ("cup on the table that is not brown", "cup on not brown table"),
        ("plug in the wall", "plug in wall"),
        ("\"TV on the wall\" next to the door", "TV on the wall next to door"),
    ] {
        assert_eq!(understood(text), expected, "{text}");
    }
    let found = wanted("lamp between the sofa and a red chair").unwrap();
    let relation = found.relation.unwrap();
    assert_eq!(relation.kind, RelationKind::Between);
    assert_eq!(relation.others[0], Wanted::plain("sofa"));
    assert!(has(&relation.others[1], AttributeKind::Color(Color::Red)));
}

#[test]
fn what_is_understood_is_understood_again() {
    for text in [
        "not dark red chair next to big window",
        "cup on table not near green chair",
        "largest lamp between sofa and chair",
        "table without laptop",
        "stool right of bed",
        "chair farthest from door",
    ] {
        let found = wanted(text).unwrap();
        assert_eq!(wanted(&found.to_string()), Ok(found), "{text}");
    }
}

#[test]
fn purposes_stand_for_kinds_of_things() {
    let seats = ["chair", "sofa", "stool", "bench"];
    for text in [
        "something to sit on",
        "Where can I sit?",
        "Where do I sit?",
        "Show me a place to sit down.",
        "something I can sit on",
    ] {
        assert_eq!(wanted(text).unwrap().names, seats, "{text}");
    }
    assert_eq!(
        understood("something to sit on next to the window"),
        "chair, sofa, stool or bench next to window"
    );
    assert_eq!(understood("something to drink from"), "cup, mug or glass");
    assert_eq!(understood("something to juggle with"), "something to juggle with");
}

#[test]
fn what_cannot_be_decided_is_refused_with_a_way_out() {
    for text in ["not a chair", "no chair", "anything but chairs", "everything except the chairs"] {
        assert!(refusal(text).contains("what is not meant"), "{text}: {}", refusal(text));
    }
    assert!(refusal("not a chair").contains("chair that is not red"));
    for text in ["chair that is not broken", "chair that doesn't wobble"] {
        assert!(refusal(text).contains("negation"), "{text}: {}", refusal(text));
    }
    for text in [
        "the red one",
        "something red",
        "things on the table",
        "What is on the table?",
        "on the table",
    ] {
        assert!(refusal(text).contains("names no kind of thing"), "{text}: {}", refusal(text));
    }
    for text in ["chair on the left", "chair opposite the sofa", "lamp in the corner"] {
        assert!(refusal(text).contains("is not decided"), "{text}: {}", refusal(text));
    }
    assert!(refusal("nearest chair").contains("to what"));
    assert!(refusal("chair next to the table and near the door").contains("several"));
    for several in ["laptop or bowl", "the laptop and the bowl", "red or green door"] {
        assert!(refusal(several).contains("several things"), "{several}");
    }
    assert_eq!(understood("\"salt and pepper\""), "salt and pepper");
    for (text, instead) in [
        ("anything but chairs", "\"chair that is not red\""),
        ("everything except the table", "\"table that is not red\""),
    ] {
        assert!(refusal(text).contains(instead), "{}", refusal(text));
    }
    let long = "cup".to_owned() + &" on the table".repeat(5);
    assert!(refusal(&long).contains("at most 4 things"));
    for text in ["", "?", " the ", "a an"] {
        assert!(!matches!(wanted(text), Err(Unclear::Refused(_))), "{text:?}");
    }
    assert_eq!(wanted(" ?! "), Err(Unclear::Empty));
}

#[test]
fn no_text_is_too_strange() {
    let parts = [
        "not", "red", "on", "the", "chair", "next", "to", "and", "that", "is", "\"", "of",
        "between",
    ];
    // All texts of four of these words.
    for number in 0..parts.len().pow(4) {
        let word = |place: u32| parts[number / parts.len().pow(place) % parts.len()];
        let text = [word(0), word(1), word(2), word(3)].join(" ");
        if let Ok(found) = wanted(&text) {
            assert!(!found.names.iter().any(String::is_empty), "{text:?}: {found:?}");
        }
    }
}
