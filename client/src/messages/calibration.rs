//! Calibrations of cameras, as `sensor_msgs/CameraInfo` and `foxglove.CameraCalibration` give them.

use super::error::MessageError;
use crate::dataset::{Camera, Distortion, Intrinsics};

/// How a camera projects, as the message has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The camera's frame of coordinates, x right, y down, z forward.
    pub frame_id: String,
    /// Columns of the calibrated picture, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// Name of the model of `d`.
    pub distortion_model: String,
    /// Coefficients of the distortion.
    pub d: Vec<f64>,
    /// Camera matrix of the picture with its distortion, 3x3.
    pub k: [f64; 9],
    /// Projection of the rectified picture, 3x4.
    pub p: [f64; 12],
    /// How many columns and rows of pixels were merged into one, at least 1.
    pub binning: [u32; 2],
    /// The part of the calibrated picture that is sent, before binning.
    pub region: Region,
}

/// A part of a picture; without width and height the whole of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// The camera of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibrated {
    /// The camera of the pictures as they are sent.
    pub camera: Camera,
    /// What of the calibration is not used, or was concluded, in words.
    pub notes: Vec<String>,
}

impl Calibration {
    /// The camera of pictures of `size` (columns, rows). `is_rectified`: their distortion was removed, and P
    /// holds for them.
    ///
    /// # Errors
    /// [`MessageError`] if the camera was never calibrated, or the pictures have another shape.
    pub fn of_pictures(
        &self,
        size: (u32, u32),
        is_rectified: bool,
    ) -> Result<Calibrated, MessageError> {
        let mut notes = Vec::new();
        let [fx, _, cx, _, fy, cy, ..] = self.k;
        let [p_fx, _, p_cx, _, _, p_fy, p_cy, ..] = self.p;
        let uses_p = is_rectified && p_fx > 0.0 && p_fy > 0.0;
        let lens = if uses_p { [p_fx, p_fy, p_cx, p_cy] } else { [fx, fy, cx, cy] };
        if !(lens.iter().all(|number| number.is_finite()) && lens[0] > 0.0 && lens[1] > 0.0) {
            return Err(MessageError::content(format!(
                "expected a calibrated camera {}, found fx fy cx cy = {:?}: calibrate it",
                self.frame_id, lens
            )));
        }
        let distortion = match is_rectified {
            true => Distortion::None,
            false => self.distortion(&mut notes)?,
        };
        let intrinsics = self.sent(lens, &mut notes);
        let intrinsics = fitted(intrinsics, size, &mut notes)?;
        Ok(Calibrated { camera: Camera { intrinsics, distortion }, notes })
    }

    /// The lens of what is sent of the calibrated picture.
    fn sent(&self, [fx, fy, cx, cy]: [f64; 4], notes: &mut Vec<String>) -> Intrinsics {
        let Region { x, y, width, height } = self.region;
        let [across, down] = self.binning;
        let (width, height) = match (width, height) {
            (0, _) | (_, 0) => (self.width, self.height),
            part => part,
        };
        if self.region != Region::default() && (width, height) != (self.width, self.height) {
            notes.push(format!("pictures are a part of {width}x{height} pixels from {x}, {y}"));
        }
        if self.binning != [1, 1] {
            notes.push(format!("pixels are merged by {across}x{down}"));
        }
        let whole =
            Intrinsics { width, height, fx, fy, cx: cx - f64::from(x), cy: cy - f64::from(y) };
        whole.scaled((width / across).max(1), (height / down).max(1))
    }

    fn distortion(&self, notes: &mut Vec<String>) -> Result<Distortion, MessageError> {
        let d = &self.d;
        if d.iter().any(|coefficient| !coefficient.is_finite()) {
            return Err(MessageError::content("expected finite coefficients of the distortion"));
        }
        if d.iter().all(|coefficient| *coefficient == 0.0) {
            return Ok(Distortion::None);
        }
        let used = match (&*self.distortion_model, d.len()) {
            ("plumb_bob" | "rational_polynomial" | "", 4 | 5 | 8) => {
                return Ok(Distortion::BrownConrady(d.clone()));
            }
            ("plumb_bob" | "rational_polynomial" | "", 9..) => 8,
            ("equidistant" | "fisheye" | "kannala_brandt", 4..) => 4,
            (model, count) => {
                notes.push(format!(
                    "the distortion {model:?} with {count} coefficients is not known: pictures are taken as if \
                     the lens were straight; publish rectified ones if that is too coarse"
                ));
                return Ok(Distortion::None);
            }
        };
        if d[used..].iter().any(|coefficient| *coefficient != 0.0) {
            notes.push(format!("of the distortion, {:?} is not used", &d[used..]));
        }
        Ok(match used {
            4 => Distortion::KannalaBrandt(std::array::from_fn(|at| d[at])),
            _ => Distortion::BrownConrady(d[..used].to_vec()),
        })
    }
}

/// The same lens in pictures of another size, if they have the same shape.
fn fitted(
    lens: Intrinsics,
    (width, height): (u32, u32),
    notes: &mut Vec<String>,
) -> Result<Intrinsics, MessageError> {
    if (lens.width, lens.height) == (width, height) {
        return Ok(lens);
    }
    let calibrated = format!("{}x{}", lens.width, lens.height);
    if width == 0 || height == 0 {
        return Err(MessageError::content("expected pictures with pixels"));
    }
    let shape = |width: u32, height: u32| f64::from(width) / f64::from(height.max(1));
    if lens.width == 0 || (shape(lens.width, lens.height) / shape(width, height) - 1.0).abs() > 0.01
    {
        return Err(MessageError::content(format!(
            "expected pictures of {calibrated} pixels as the camera is calibrated for, found {width}x{height}"
        )));
    }
    notes.push(format!("the calibration for {calibrated} pixels is scaled to {width}x{height}"));
    Ok(lens.scaled(width, height))
}
