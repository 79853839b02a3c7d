//! Which of the things of a kind are meant: the red ones, the one next to the window.
//!
//! In: objects in space, of the kind that is wanted and of those that it is related to. Out: those that have
//! all attributes and the relation, or the reason why there is none. Colors are those of the objects' own
//! Gaussians, relations are decided by their shapes. No network takes part.

mod choose;
mod color;
mod find;
mod look;
mod messages;
mod nearness;
mod relation;
mod shape;
mod sight;

pub(super) use find::Finder;

#[cfg(test)]
mod tests;
