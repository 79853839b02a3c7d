//! Pictures in messages, and turning them into what a frame has: color as JPEG, PNG or RGB, depth as 16-bit
//! PNG, 16-bit millimetres or 32-bit metres.

use super::error::MessageError;
use super::{compressed_depth, encoded};
use crate::dataset::{Color, ColorFormat, Depth, DepthFormat};
use std::borrow::Cow;

/// Metres per unit of 16-bit depth in messages of ROS (REP 118).
pub const DEPTH_UNIT_METRES: f64 = 0.001;

/// Encodings of depth.
const DEPTH_ENCODINGS: [&str; 3] = ["16UC1", "32FC1", "mono16"];

/// A picture in a message.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture<'a> {
    /// When it was taken, nanoseconds; 0 if the sender did not stamp it.
    pub nanos: u64,
    /// The camera's frame of coordinates, x right, y down, z forward.
    pub frame_id: String,
    /// The pixels as they were sent.
    pub pixels: Pixels<'a>,
}

/// Pixels as they were sent.
#[derive(Clone, Debug, PartialEq)]
pub enum Pixels<'a> {
    /// Without compression.
    Raw {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// ROS's name of the encoding, such as `rgb8`.
        encoding: String,
        /// Bytes from one row to the next.
        step: u32,
        /// The order of the bytes of numbers.
        is_big_endian: bool,
        /// The rows.
        data: Cow<'a, [u8]>,
    },
    /// Compressed.
    Compressed {
        /// What the sender says of the compression, such as `jpeg` or `16UC1; compressedDepth png`.
        format: String,
        /// The bytes.
        data: Cow<'a, [u8]>,
    },
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// Colors.
    Color,
    /// Brightness, as of an infrared camera.
    Grey,
    /// Distances.
    Depth,
}

/// How the bytes of a raw pixel are used.
#[derive(Clone, Copy)]
enum Layout {
    /// Bytes of a pixel, and which of them are red, green and blue.
    Channels(usize, [usize; 3]),
    /// Two pixels in four bytes: the places of both lightnesses, and of blue and red difference.
    Yuv([usize; 2], [usize; 2]),
    Millimetres,
    Metres,
}

impl Layout {
    fn of(encoding: &str) -> Result<Self, MessageError> {
        Ok(match encoding {
            "rgb8" => Self::Channels(3, [0, 1, 2]),
            "bgr8" | "8UC3" => Self::Channels(3, [2, 1, 0]),
            "rgba8" => Self::Channels(4, [0, 1, 2]),
            "bgra8" | "8UC4" => Self::Channels(4, [2, 1, 0]),
            "mono8" | "8UC1" => Self::Channels(1, [0; 3]),
            "yuv422" | "uyvy" => Self::Yuv([1, 3], [0, 2]),
            "yuv422_yuy2" | "yuyv" => Self::Yuv([0, 2], [1, 3]),
            "16UC1" | "mono16" => Self::Millimetres,
            "32FC1" => Self::Metres,
            other => {
                let reason = format!("the encoding {other:?} is not read: publish rgb8 or 16UC1");
                return Err(MessageError::content(reason));
            }
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::Channels(bytes, _) => bytes,
            Self::Yuv(..) | Self::Millimetres => 2,
            Self::Metres => 4,
        }
    }
}

impl Picture<'_> {
    /// What it shows, by its encoding.
    ///
    /// # Errors
    /// [`MessageError`] if the encoding is not read.
    pub fn content(&self) -> Result<Content, MessageError> {
        match &self.pixels {
            Pixels::Raw { encoding, .. } => Ok(match Layout::of(encoding)? {
                Layout::Channels(1, _) => Content::Grey,
                Layout::Channels(..) | Layout::Yuv(..) => Content::Color,
                Layout::Millimetres | Layout::Metres => Content::Depth,
            }),
            Pixels::Compressed { format, .. } if is_compressed_depth(format) => Ok(Content::Depth),
            Pixels::Compressed { format, data } => match encoded::png_kind(data) {
                // Bits and kind of a PNG: grey of 16 bits.
                Some([16, 0]) => Ok(Content::Depth),
                Some([_, 0]) => Ok(Content::Grey),
                None if DEPTH_ENCODINGS.iter().any(|depth| format.starts_with(depth)) => {
                    let reason = "depth as JPEG has lost its values: publish compressedDepth";
                    Err(MessageError::content(reason))
                }
                _ => encoded::format(data).map(|_| Content::Color),
            },
        }
    }

    /// Columns and rows.
    ///
    /// # Errors
    /// [`MessageError`] if the header of a compressed picture is damaged.
    pub fn size(&self) -> Result<(u32, u32), MessageError> {
        match &self.pixels {
            Pixels::Raw { width, height, .. } => Ok((*width, *height)),
            Pixels::Compressed { format, data } if is_compressed_depth(format) => {
                compressed_depth::size(format, data)
            }
            Pixels::Compressed { data, .. } => encoded::size(data),
        }
    }

    /// As the color of a frame.
    ///
    /// # Errors
    /// [`MessageError`] if it is depth, or damaged.
    pub fn color(&self) -> Result<Color, MessageError> {
        if self.content()? == Content::Depth {
            return Err(MessageError::content("expected a color picture, found depth"));
        }
        match &self.pixels {
            Pixels::Compressed { data, .. } => {
                Ok(Color { format: encoded::format(data)?, bytes: data.to_vec() })
            }
            Pixels::Raw { encoding, .. } => {
                let layout = Layout::of(encoding)?;
                let mut bytes = Vec::new();
                self.rows(layout.bytes(), |row| put_color(layout, row, &mut bytes))?;
                Ok(Color { format: ColorFormat::Rgb8, bytes })
            }
        }
    }

    /// As the depth of a frame; 16-bit values are in units of [`DEPTH_UNIT_METRES`].
    ///
    /// # Errors
    /// [`MessageError`] if it is no depth, or damaged.
    pub fn depth(&self) -> Result<Depth, MessageError> {
        if self.content()? != Content::Depth {
            return Err(MessageError::content("expected depth, found a color picture"));
        }
        match &self.pixels {
            Pixels::Compressed { format, data } if is_compressed_depth(format) => {
                compressed_depth::depth(format, data)
            }
            Pixels::Compressed { data, .. } => {
                Ok(Depth { format: DepthFormat::Png16, bytes: data.to_vec() })
            }
            Pixels::Raw { encoding, is_big_endian, .. } => {
                let layout = Layout::of(encoding)?;
                let mut bytes = Vec::new();
                self.rows(layout.bytes(), |row| bytes.extend_from_slice(row))?;
                if *is_big_endian {
                    bytes.chunks_exact_mut(layout.bytes()).for_each(<[u8]>::reverse);
                }
                let format = match layout {
                    Layout::Metres => DepthFormat::F32Metres,
                    _ => DepthFormat::U16,
                };
                Ok(Depth { format, bytes })
            }
        }
    }

    /// Calls `each` with the bytes of every row, without what is between rows.
    fn rows(&self, pixel_bytes: usize, mut each: impl FnMut(&[u8])) -> Result<(), MessageError> {
        let Pixels::Raw { width, height, step, data, .. } = &self.pixels else { return Ok(()) };
        let (rows, row_bytes) = (*height as usize, *width as usize * pixel_bytes);
        let step = if *step == 0 { row_bytes } else { *step as usize };
        let needed = rows.checked_sub(1).and_then(|rows| rows.checked_mul(step));
        let is_whole = needed.and_then(|bytes| bytes.checked_add(row_bytes));
        if row_bytes == 0 || step < row_bytes || is_whole.is_none_or(|bytes| bytes > data.len()) {
            return Err(MessageError::content(format!(
                "expected {rows} rows of {width} pixels, {step} bytes apart, found {} bytes",
                data.len()
            )));
        }
        data.chunks(step).take(rows).for_each(|row| each(&row[..row_bytes]));
        Ok(())
    }
}

fn put_color(layout: Layout, row: &[u8], rgb: &mut Vec<u8>) {
    match layout {
        Layout::Channels(bytes, places) => {
            let pixels = row.chunks_exact(bytes);
            rgb.extend(pixels.flat_map(|pixel| places.map(|place| pixel[place])));
        }
        Layout::Yuv(lightness, [blue, red]) => {
            for two in row.chunks(4) {
                // Half a pair, at the end of an odd row, has no color of its own.
                let at = |place: usize| f32::from(two.get(place).copied().unwrap_or(128));
                let here = lightness.into_iter().filter(|place| *place < two.len().max(2));
                rgb.extend(here.flat_map(|place| rgb_of(at(place), at(blue), at(red))));
            }
        }
        Layout::Millimetres | Layout::Metres => {}
    }
}

/// ITU-R BT.601 with lightness from 16 to 235.
fn rgb_of(lightness: f32, blue: f32, red: f32) -> [u8; 3] {
    let (y, u, v) = (1.164 * (lightness - 16.0), blue - 128.0, red - 128.0);
    // Casts from f32 saturate.
    [y + 1.596 * v, y - 0.392 * u - 0.813 * v, y + 2.017 * u].map(|value| value.round() as u8)
}

fn is_compressed_depth(format: &str) -> bool {
    format.contains("compressedDepth")
}
