//! The things in a room, each built from parts in its own frame: metres, standing on z = 0, front
//! towards +y, centred on its footprint (things on walls: back on y = 0, centred on z = 0).
//! In: the builder and the room's dice; out: patches. Where things go is [`super::layout`]'s matter.

pub(crate) mod decor;
pub(crate) mod seating;
pub(crate) mod storage;
pub(crate) mod tables;
pub(crate) mod walls;
