//! The server's HTTP interface: [`HttpClient`] and the types of its questions and answers.

mod client;
mod connect;
mod error;
mod links;
mod manage;
mod map_file;
mod project;

pub use client::HttpClient;
pub use error::HttpError;
pub use lexsplat_proto::json::{
    Answer, Bounds, Camera, Health, HeatmapLink, Keyframe, LabelsLink, LegendEntry, MapState,
    Object, Peak, PixelBox, PointsLink, Question, Rle, Segmentation, Status, Timing, Understood,
    Up, View,
};
pub use map_file::{MapFile, ReadOf};
pub use project::project;
