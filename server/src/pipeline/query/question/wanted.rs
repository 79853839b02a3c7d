//! What a text asks for: a kind of thing, how it looks, and where it is relative to other things.

use crate::pipeline::query::answer::Understood;
use std::fmt::{Display, Formatter, Result};

/// A kind of thing, with attributes and a relation that narrow down which of its kind are meant.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Wanted {
    /// Names of the kind, as they are embedded, at least one. Several: a thing of any of these kinds.
    pub names: Vec<String>,
    /// What it looks like: all of these hold.
    pub attributes: Vec<Attribute>,
    /// Where it is.
    pub relation: Option<Box<Relation>>,
}

/// A property of a thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Attribute {
    pub kind: AttributeKind,
    /// Whether it must not hold.
    pub is_negated: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum AttributeKind {
    Color(Color),
    Dark,
    Light,
    /// Compared with the others of its kind.
    Size(Size),
}

/// A comparison of a thing with the others of its kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Size {
    /// The word for it.
    pub word: &'static str,
    /// Whether heights are compared; else diagonals of boxes.
    pub is_height: bool,
    /// Larger ones, or smaller ones.
    pub is_more: bool,
    /// Only the one with the most.
    pub is_most: bool,
}

/// The basic colors of English, turquoise and beige.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Color {
    Red,
    Orange,
    Yellow,
    Green,
    Turquoise,
    Blue,
    Purple,
    Pink,
    Brown,
    Beige,
    White,
    Grey,
    Black,
}

/// How a thing lies to another one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Relation {
    pub kind: RelationKind,
    /// Whether it must not hold.
    pub is_negated: bool,
    /// The other things: two kinds, or one, for [`RelationKind::Between`]; else one.
    pub others: Vec<Wanted>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RelationKind {
    Near,
    Nearest,
    Farthest,
    On,
    In,
    Under,
    Above,
    Between,
    /// The other thing is on it or in it.
    With,
    LeftOf,
    RightOf,
    InFrontOf,
    Behind,
}

impl Wanted {
    /// A kind of thing without further conditions.
    pub(crate) fn plain(name: impl Into<String>) -> Self {
        Self { names: vec![name.into()], attributes: Vec::new(), relation: None }
    }

    /// Whether any thing of the kind is meant.
    pub(crate) fn is_plain(&self) -> bool {
        self.attributes.is_empty() && self.relation.is_none()
    }

    /// The kind of thing in words.
    pub(crate) fn object(&self) -> String {
        match &self.names[..] {
            [rest @ .., last] if !rest.is_empty() => format!("{} or {last}", rest.join(", ")),
            names => names.concat(),
        }
    }
}

impl From<&Wanted> for Understood {
    fn from(wanted: &Wanted) -> Self {
        let relation = wanted.relation.as_ref();
        let others = relation.iter().flat_map(|relation| &relation.others);
        Self {
            object: wanted.object(),
            attributes: wanted.attributes.iter().map(Attribute::to_string).collect(),
            others: others.map(Wanted::to_string).collect(),
            relation: relation.map(|relation| relation.to_string()),
        }
    }
}

impl Color {
    /// All colors.
    pub(crate) const ALL: [Self; 13] = [
        Self::Red,
        Self::Orange,
        Self::Yellow,
        Self::Green,
        Self::Turquoise,
        Self::Blue,
        Self::Purple,
        Self::Pink,
        Self::Brown,
        Self::Beige,
        Self::White,
        Self::Grey,
        Self::Black,
    ];

    /// Its name.
    pub(crate) fn as_str(self) -> &'static str {
        match self {
            Self::Red => "red",
            Self::Orange => "orange",
            Self::Yellow => "yellow",
            Self::Green => "green",
            Self::Turquoise => "turquoise",
            Self::Blue => "blue",
            Self::Purple => "purple",
            Self::Pink => "pink",
            Self::Brown => "brown",
            Self::Beige => "beige",
            Self::White => "white",
            Self::Grey => "grey",
            Self::Black => "black",
        }
    }
}

impl RelationKind {
    /// The words for it.
    pub(crate) fn as_str(self) -> &'static str {
        match self {
            Self::Near => "next to",
            Self::Nearest => "nearest to",
            Self::Farthest => "farthest from",
            Self::On => "on",
            Self::In => "in",
            Self::Under => "under",
            Self::Above => "above",
            Self::Between => "between",
            Self::With => "with",
            Self::LeftOf => "left of",
            Self::RightOf => "right of",
            Self::InFrontOf => "in front of",
            Self::Behind => "behind",
        }
    }

    /// Whether it depends on where one looks from.
    pub(crate) fn needs_view(self) -> bool {
        matches!(self, Self::LeftOf | Self::RightOf | Self::InFrontOf | Self::Behind)
    }
}

impl Display for Attribute {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let word = match self.kind {
            AttributeKind::Color(color) => color.as_str(),
            AttributeKind::Dark => "dark",
            AttributeKind::Light => "light",
            AttributeKind::Size(size) => size.word,
        };
        write!(f, "{}{word}", if self.is_negated { "not " } else { "" })
    }
}

impl Display for Relation {
    /// Its words, without the other things.
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match (self.kind, self.is_negated) {
            (RelationKind::With, true) => write!(f, "without"),
            (kind, negated) => write!(f, "{}{}", if negated { "not " } else { "" }, kind.as_str()),
        }
    }
}

impl Display for Wanted {
    /// A text that asks for the same: "red chair next to window".
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        for attribute in &self.attributes {
            write!(f, "{attribute} ")?;
        }
        write!(f, "{}", self.object())?;
        let Some(relation) = &self.relation else { return Ok(()) };
        let others: Vec<String> = relation.others.iter().map(Self::to_string).collect();
        write!(f, " {relation} {}", others.join(" and "))
    }
}
