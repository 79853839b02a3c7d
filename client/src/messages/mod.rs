//! **Messages** of robots as plain readings: ROS 2 in CDR, Foxglove in protobuf and JSON.
//!
//! [`Decoder::of`] finds a decoder by the names of an encoding and a schema; [`Decoder::read`] turns the
//! bytes of a message into a [`Reading`]. Bytes come from outside: damaged ones are a [`MessageError`].
//! Nothing here knows topics, files or networks.

mod calibration;
mod cdr;
mod compressed_depth;
mod decoder;
mod encoded;
mod error;
mod foxglove;
mod picture;
mod reading;
mod rvl;

#[cfg(test)]
mod tests;

pub use calibration::{Calibrated, Calibration, Region};
pub use decoder::{Decoder, Kind};
pub use error::MessageError;
pub use picture::{Content, DEPTH_UNIT_METRES, Picture, Pixels};
pub use reading::{Gravity, Posed, Reading, Transform};
