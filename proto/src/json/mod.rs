//! The JSON types of the HTTP interface, used by the server to write and by clients to read.
//!
//! Conventions: lengths are metres in the map's world, image positions are pixels, scores are
//! relevancies in 0..1, transforms are row-major 4x4 matrices named `target_from_source`. Fields
//! that are `None` are left out of the JSON.

mod answer;
mod camera;
mod event;
mod health;
mod import;
mod map;
mod problem;
mod question;
mod render;
mod reply;
mod segmentation;
mod session;

pub use answer::{
    Answer, HeatmapLink, Object, Peak, PixelBox, PointsLink, Rle, Timing, Understood,
};
pub use camera::{Camera, View};
pub use event::{FrameEvent, InputWarningEvent, MissedEvent, RefinementEvent, RevisionEvent};
pub use health::{Health, MapLoading};
pub use import::{Import, ImportPoses, ImportState};
pub use map::{
    Frames, InputWarning, Keyframe, LoadProgress, MapState, Maps, NewMap, Restored, Status, Up,
};
pub use problem::Problem;
pub use question::{Bounds, Question};
pub use render::{Channel, RenderRequest};
pub use reply::Reply;
pub use segmentation::{LabelsLink, LegendEntry, Segmentation};
pub use session::Login;

#[cfg(test)]
mod tests;
