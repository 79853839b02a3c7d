//! The objects of a room, each built from parts in its own frame: metres, standing on z = 0, front
//! towards +y, centred on its footprint (objects on walls: back on y = 0, centred on z = 0). They
//! are placed by [`crate::layout`].

pub(crate) mod decor;
pub(crate) mod seating;
pub(crate) mod storage;
pub(crate) mod tables;
pub(crate) mod walls;
