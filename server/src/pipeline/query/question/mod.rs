//! What a question asks for, in plain words: "Where is the red chair next to the windows?" asks for a chair,
//! which is red, and next to a window.
//!
//! Text towers learned names of things. They do not know questions, hardly know colors, and do not know
//! "not" and "next to" at all. So the name is taken out of the text and embedded alone; attributes and the
//! relation are decided otherwise. In: a text. Out: a [`Wanted`]. Nothing here knows a map. Only English is
//! known; a text in another language is a name.
//!
//! What is in quotes is a name, word by word. Words that are not known stay in the name. A negation that is
//! not understood is refused, since a text tower would find the contrary of what was meant.

mod attributes;
mod colors;
mod parse;
mod plural;
mod purposes;
mod relations;
mod subject;
mod tokens;
mod wanted;

pub(super) use parse::{Unclear, name, wanted};
pub(super) use wanted::{Attribute, AttributeKind, Color, Relation, RelationKind, Size, Wanted};

#[cfg(test)]
mod tests;
