//! Why nothing is chosen, in words.

use super::look::Look;
use crate::pipeline::query::question::{Attribute, AttributeKind, Relation, Wanted};

/// There is nothing of the kind.
pub(super) fn nothing(wanted: &Wanted) -> String {
    format!("no {} was found", wanted.object())
}

/// There are things of the kind, and none has the attribute.
pub(super) fn without_attribute(wanted: &Wanted, attribute: Attribute, looks: &[Look]) -> String {
    let count = looks.len().max(1);
    let affirmed = Attribute { is_negated: false, ..attribute };
    let mut reason = match (attribute.is_negated, count) {
        (false, _) => format!("{} found, and none is {attribute}", counted(count, wanted)),
        (true, 1) => format!("{} found, and it is {affirmed}", counted(count, wanted)),
        (true, _) => format!("{} found, and all are {affirmed}", counted(count, wanted)),
    };
    if matches!(attribute.kind, AttributeKind::Color(_)) && !attribute.is_negated {
        let mut colors: Vec<&str> = looks.iter().map(|look| look.main_color().as_str()).collect();
        colors.sort_unstable();
        colors.dedup();
        reason += &format!(" (mostly {})", colors.join(", "));
    }
    reason
}

/// There are things with all attributes, and none is where it is looked for.
pub(super) fn without_relation(wanted: &Wanted, count: usize) -> String {
    let Some(relation) = &wanted.relation else { return nothing(wanted) };
    let others: Vec<String> = relation.others.iter().map(Wanted::to_string).collect();
    format!("{} found, and none is {relation} {}", counted(count, wanted), others.join(" and "))
}

/// All others were excluded: "chair that is not the largest".
pub(super) fn no_other(wanted: &Wanted) -> String {
    format!("there is only one {}", wanted.object())
}

/// The relation depends on where one looks from.
pub(super) fn no_view(relation: &Relation) -> String {
    format!("\"{}\" depends on where one looks from: ask about a view", relation.kind.as_str())
}

/// The map does not know what is up.
pub(super) fn no_up(relation: &Relation) -> String {
    format!("\"{}\" needs the direction up, which is not known yet", relation.kind.as_str())
}

fn counted(count: usize, wanted: &Wanted) -> String {
    match count {
        1 => format!("one {} was", wanted.object()),
        _ => format!("{count} things called {:?} were", wanted.object()),
    }
}
