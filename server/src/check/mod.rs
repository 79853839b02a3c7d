//! Validation of outside input: gRPC messages, JSON and recorded messages become domain types here.
//!
//! Every function takes input as it arrived and returns a type of `pipeline` or `export` that needs
//! no further check, or a [`Refusal`] that names the field with the error. Both interfaces (gRPC
//! and HTTP) and the replay of recordings use these functions, so the same input gets the same verdict
//! everywhere.

mod camera;
mod cameras;
mod color;
mod depth;
mod direction;
mod file_options;
mod frame;
mod images;
mod jpeg;
mod labels;
mod limits;
mod opening;
mod page;
mod question;
mod refusal;
mod render;
mod view;
mod wait;

pub(crate) use file_options::file_options;
pub(crate) use frame::{frame, registered};
pub(crate) use limits::Limits;
pub(crate) use opening::{Opening, opening};
pub(crate) use page::Page;
pub(crate) use question::Question;
pub(crate) use refusal::Refusal;
pub(crate) use render::render_request;
pub(crate) use wait::wait;

#[cfg(test)]
mod tests;
