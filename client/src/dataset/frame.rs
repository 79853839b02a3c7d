//! An RGB-D frame and the camera that took it.

pub use lexsplat_proto::v1::{ColorFormat, DepthFormat};
use nalgebra::Isometry3;
use std::fmt;

/// A pinhole camera, pixels; the centre of the top-left pixel is (0, 0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Columns, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// Horizontal focal length, pixels.
    pub fx: f64,
    /// Vertical focal length, pixels.
    pub fy: f64,
    /// Column of the principal point, pixels.
    pub cx: f64,
    /// Row of the principal point, pixels.
    pub cy: f64,
}

impl Intrinsics {
    /// The same lens in a picture of another size: pixel edges stay edges.
    pub fn scaled(&self, width: u32, height: u32) -> Self {
        let (x, y) =
            (f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height));
        Self {
            width,
            height,
            fx: self.fx * x,
            fy: self.fy * y,
            cx: (self.cx + 0.5) * x - 0.5,
            cy: (self.cy + 0.5) * y - 0.5,
        }
    }
}

/// How a lens departs from a pinhole; coefficients as of OpenCV.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Distortion {
    /// It does not.
    #[default]
    None,
    /// Brown–Conrady: 4, 5 or 8 coefficients k1 k2 p1 p2 k3 k4 k5 k6. In ROS "plumb_bob" and
    /// "rational_polynomial".
    BrownConrady(Vec<f64>),
    /// Kannala–Brandt (fisheye): k1 k2 k3 k4. In ROS "equidistant".
    KannalaBrandt([f64; 4]),
}

impl Distortion {
    /// A distortion as ROS, OpenCV, COLMAP or RealSense name it: `plumb_bob`, `rational_polynomial`,
    /// `brown_conrady`, `OPENCV`; `equidistant`, `kannala_brandt`, `fisheye`, `OPENCV_FISHEYE`; `none` or
    /// nothing. Coefficients of 0 behind the last that a model has are left out.
    ///
    /// # Errors
    /// What was expected, if the model is not known or has another number of coefficients.
    pub fn named(model: &str, coefficients: &[f64]) -> Result<Self, String> {
        if let Some(wrong) = coefficients.iter().find(|coefficient| !coefficient.is_finite()) {
            return Err(format!("expected finite coefficients, found {wrong}"));
        }
        let used = coefficients.iter().rposition(|coefficient| *coefficient != 0.0);
        let used = used.map_or(0, |last| last + 1);
        let plain = model.to_ascii_lowercase().replace(['-', ' '], "_");
        match &*plain {
            "equidistant" | "kannala_brandt" | "kannala_brandt4" | "fisheye" | "opencv_fisheye" => {
                let four = coefficients.get(..4).filter(|_| used <= 4);
                let four = four.and_then(|four| four.try_into().ok());
                four.map(Self::KannalaBrandt).ok_or_else(|| {
                    format!("{model}: expected 4 coefficients, found {}", coefficients.len())
                })
            }
            "plumb_bob" | "rational_polynomial" | "brown_conrady" | "opencv" | "full_opencv" => {
                let counts = [4, 5, 8];
                let count = counts.into_iter().find(|count| *count >= used);
                let listed = count.filter(|_| matches!(coefficients.len(), 0 | 4 | 5 | 8..));
                match listed {
                    _ if used == 0 => Ok(Self::None),
                    Some(count) => Ok(Self::BrownConrady(coefficients[..count].to_vec())),
                    None => Err(format!(
                        "{model}: expected 4, 5 or 8 coefficients (k1 k2 p1 p2 k3 k4 k5 k6), found {}",
                        coefficients.len()
                    )),
                }
            }
            _ if used == 0 => Ok(Self::None),
            _ => Err(format!(
                "expected distortion model brown_conrady (plumb_bob, rational_polynomial) or kannala_brandt \
                 (equidistant), found {model:?}: undistort the pictures first"
            )),
        }
    }
}

/// A camera with its lens.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Size, focal lengths and principal point.
    pub intrinsics: Intrinsics,
    /// Distortion of the lens.
    pub distortion: Distortion,
}

impl From<Intrinsics> for Camera {
    /// A camera without distortion.
    fn from(intrinsics: Intrinsics) -> Self {
        Self { intrinsics, distortion: Distortion::None }
    }
}

/// The camera of depth, where it is not color's.
#[derive(Clone, Debug, PartialEq)]
pub enum DepthCamera {
    /// Color's own lens at another resolution, as phones have it.
    SameLens {
        /// Columns of depth, pixels.
        width: u32,
        /// Rows of depth, pixels.
        height: u32,
    },
    /// A camera of its own.
    Own {
        /// Size, intrinsics and distortion.
        camera: Camera,
        /// Its pose in the coordinates of the color camera, metres.
        color_from_depth: Isometry3<f64>,
    },
}

/// The cameras of a recording, and which values of depth are measurements.
#[derive(Clone, Debug, PartialEq)]
pub struct Cameras {
    /// The color camera.
    pub color: Camera,
    /// The depth camera; `None`: depth is registered to color, with color's size.
    pub depth: Option<DepthCamera>,
    /// Nearest and farthest depth that counts as a measurement, metres; `None`: the server's limits.
    pub depth_range_metres: Option<[f64; 2]>,
    /// Values of 16-bit depth that mean no measurement, beside 0; empty: 65535.
    pub no_depth: Vec<u16>,
    /// The direction up in the coordinates of given poses; `None`: not known.
    pub up: Option<[f64; 3]>,
}

impl From<Intrinsics> for Cameras {
    /// Depth that is registered to color, taken through a lens without distortion.
    fn from(intrinsics: Intrinsics) -> Self {
        Self::from(Camera::from(intrinsics))
    }
}

impl From<Camera> for Cameras {
    /// Depth that is registered to color.
    fn from(color: Camera) -> Self {
        Self { color, depth: None, depth_range_metres: None, no_depth: Vec::new(), up: None }
    }
}

impl Cameras {
    /// Whether frames are as a map uses them: no distortion, and depth registered to color.
    pub fn are_registered(&self) -> bool {
        self.color.distortion == Distortion::None && self.depth.is_none()
    }

    /// Columns and rows of depth images.
    pub fn depth_size(&self) -> (u32, u32) {
        match &self.depth {
            None => (self.color.intrinsics.width, self.color.intrinsics.height),
            Some(DepthCamera::SameLens { width, height }) => (*width, *height),
            Some(DepthCamera::Own { camera, .. }) => {
                (camera.intrinsics.width, camera.intrinsics.height)
            }
        }
    }
}

/// A color image as it is stored.
#[derive(Clone, Debug, PartialEq)]
pub struct Color {
    /// Encoding of the bytes.
    pub format: ColorFormat,
    /// The encoded image.
    pub bytes: Vec<u8>,
}

/// A depth image as it is stored; 0 and 65535 are no measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Depth {
    /// Encoding of the bytes.
    pub format: DepthFormat,
    /// The encoded image.
    pub bytes: Vec<u8>,
}

/// A color image, the depth of the same pixels and the pose of the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdFrame {
    /// The frame's number, strictly increasing in a stream.
    pub sequence: u64,
    /// Time of the exposure, nanoseconds; layouts without times count 30 frames per second from 0.
    pub timestamp_nanos: u64,
    /// The color image.
    pub color: Color,
    /// The depth image, of the camera that [`Cameras`] says.
    pub depth: Depth,
    /// The camera's pose, metres (camera x right, y down, z forward); absent if it is not known.
    pub world_from_camera: Option<Isometry3<f64>>,
    /// What else some cameras tell.
    pub extras: FrameExtras,
}

/// What some cameras tell with each frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameExtras {
    /// The color camera of this frame, where autofocus changes it; of the usual size.
    pub intrinsics: Option<Intrinsics>,
    /// When depth was taken, nanoseconds; `None`: together with color.
    pub depth_timestamp_nanos: Option<u64>,
    /// The direction up in the camera's coordinates, of any length; `None`: not known.
    pub up: Option<[f64; 3]>,
}

/// When and where a frame was taken, without its pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Time of the exposure, as in [`RgbdFrame`], nanoseconds.
    pub timestamp_nanos: u64,
    /// The camera's pose, metres; absent if it is not known.
    pub world_from_camera: Option<Isometry3<f64>>,
}

/// How many frames a second were taken, where no file has their times.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize)]
#[serde(try_from = "f64")]
pub struct FrameRate(f64);

impl FrameRate {
    /// The time of frame number `sequence`, nanoseconds from that of number 0.
    pub fn nanos(self, sequence: u64) -> u64 {
        (sequence as f64 * 1e9 / self.0) as u64
    }
}

impl Default for FrameRate {
    /// 30 frames per second.
    fn default() -> Self {
        Self(30.0)
    }
}

impl TryFrom<f64> for FrameRate {
    type Error = String;

    fn try_from(rate: f64) -> Result<Self, String> {
        match (1e-3..=1e4).contains(&rate) {
            true => Ok(Self(rate)),
            false => Err(format!("frames_per_second: expected 0.001 to 10000, found {rate}")),
        }
    }
}

impl fmt::Display for FrameRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// The time of frame number `sequence` in a layout without times, nanoseconds from that of number 0.
pub fn counted_nanos(sequence: u64) -> u64 {
    FrameRate::default().nanos(sequence)
}
