//! The text of `recording.toml`, and the cameras that it describes.

use super::files::Size;
use super::frame::{Camera, Cameras, DepthCamera, Distortion, FrameRate, Intrinsics};
use super::pose;
use super::prepare::Turn;
use nalgebra::Isometry3;
use serde::Deserialize;
use std::path::PathBuf;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Description {
    #[serde(default)]
    pub names: Names,
    #[serde(default)]
    pub frames_per_second: FrameRate,
    up: Option<[f64; 3]>,
    pub color: Pictures,
    pub depth: DepthPictures,
    camera: Lens,
    pub poses: Option<Poses>,
}

/// What `*` stands for.
#[derive(Clone, Copy, Default, Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
pub(super) enum Names {
    #[default]
    Numbers,
    Seconds,
    Nanoseconds,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Pictures {
    pub files: String,
    #[serde(default)]
    pub turned: Turn,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DepthPictures {
    pub files: String,
    #[serde(default)]
    pub turned: Turn,
    pub unit_metres: f64,
    min_metres: Option<f64>,
    max_metres: Option<f64>,
    #[serde(default)]
    no_depth: Vec<u16>,
    pub confidence: Option<String>,
    pub least_confidence: Option<u16>,
    camera: Option<DepthLens>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Lens {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    distortion: Option<Bend>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Bend {
    model: String,
    coefficients: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DepthLens {
    #[serde(default)]
    same_lens: bool,
    fx: Option<f64>,
    fy: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    distortion: Option<Bend>,
    color_from_depth: Option<Placement>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Placement {
    matrix: Option<Vec<f64>>,
    translation: Option<[f64; 3]>,
    quaternion: Option<[f64; 4]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Poses {
    pub files: Option<String>,
    pub file: Option<PathBuf>,
    pub tum: Option<PathBuf>,
    #[serde(default)]
    pub axes: pose::Axes,
    #[serde(default)]
    pub inverse: bool,
}

impl Description {
    /// The cameras of pictures of these sizes.
    ///
    /// # Errors
    /// The key at fault and what was expected.
    pub fn cameras(&self, color: Size, depth: Size) -> Result<Cameras, String> {
        let depth_camera = match &self.depth.camera {
            None if color == depth => None,
            None => {
                return Err(format!(
                    "color is {color} pixels, depth {depth}: say in [depth.camera] fx, fy, cx, cy and \
                     color_from_depth, or same_lens = true"
                ));
            }
            Some(lens) => {
                lens.camera(color, depth).map_err(|reason| format!("depth.camera: {reason}"))?
            }
        };
        let is_direction = |up: &[f64; 3]| {
            up.iter().all(|part| part.is_finite()) && up.iter().any(|part| *part != 0.0)
        };
        if let Some(up) = self.up.filter(|up| !is_direction(up)) {
            return Err(format!("up: expected a direction, found {up:?}"));
        }
        Ok(Cameras {
            color: self.camera.camera(color).map_err(|reason| format!("camera: {reason}"))?,
            depth: depth_camera,
            depth_range_metres: self.depth.range()?,
            no_depth: self.depth.no_depth.clone(),
            up: self.up,
        })
    }
}

impl DepthPictures {
    fn range(&self) -> Result<Option<[f64; 2]>, String> {
        if self.min_metres.is_none() && self.max_metres.is_none() {
            return Ok(None);
        }
        let [min, max] = [self.min_metres, self.max_metres].map(Option::unwrap_or_default);
        let is_right = min >= 0.0 && max.is_finite() && (self.max_metres.is_none() || min < max);
        match is_right && min.is_finite() {
            true => Ok(Some([min, max])),
            false => {
                Err(format!("depth: expected 0 <= min_metres < max_metres, found {min} and {max}"))
            }
        }
    }
}

impl Lens {
    fn camera(&self, size: Size) -> Result<Camera, String> {
        camera(size, [self.fx, self.fy, self.cx, self.cy], self.distortion.as_ref())
    }
}

impl DepthLens {
    fn camera(&self, color: Size, depth: Size) -> Result<Option<DepthCamera>, String> {
        let lens = [self.fx, self.fy, self.cx, self.cy];
        if self.same_lens {
            let has_more = lens.iter().any(Option::is_some)
                || self.distortion.is_some()
                || self.color_from_depth.is_some();
            if has_more {
                return Err("expected nothing beside same_lens = true".into());
            }
            let Size { width, height } = depth;
            return Ok((color != depth).then_some(DepthCamera::SameLens { width, height }));
        }
        let [Some(fx), Some(fy), Some(cx), Some(cy)] = lens else {
            return Err("expected fx, fy, cx and cy, or same_lens = true".into());
        };
        let camera = camera(depth, [fx, fy, cx, cy], self.distortion.as_ref())?;
        let placement = self.color_from_depth.as_ref();
        let color_from_depth = placement
            .map_or(Ok(Isometry3::identity()), Placement::isometry)
            .map_err(|reason| format!("color_from_depth: {reason}"))?;
        Ok(Some(DepthCamera::Own { camera, color_from_depth }))
    }
}

fn camera(size: Size, lens: [f64; 4], bend: Option<&Bend>) -> Result<Camera, String> {
    let ([fx, fy, cx, cy], Size { width, height }) = (lens, size);
    let is_lens = fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().all(|pixels| pixels.is_finite());
    if !is_lens {
        return Err(format!(
            "expected fx and fy above 0, cx and cy finite, found {fx}, {fy}, {cx} and {cy}"
        ));
    }
    let intrinsics = Intrinsics { width, height, fx, fy, cx, cy };
    let named = |bend: &Bend| Distortion::named(&bend.model, &bend.coefficients);
    let distortion = bend.map_or(Ok(Distortion::None), named);
    let distortion = distortion.map_err(|reason| format!("distortion: {reason}"))?;
    Ok(Camera { intrinsics, distortion })
}

impl Placement {
    fn isometry(&self) -> Result<Isometry3<f64>, String> {
        match self {
            Self { matrix: Some(rows), translation: None, quaternion: None } => {
                let found = rows.len();
                let rows: Result<[f64; 16], _> = rows.clone().try_into();
                let rows = rows.map_err(|_| format!("expected a matrix of 16, found {found}"))?;
                pose::from_matrix(&rows)
            }
            Self { matrix: None, translation: Some([x, y, z]), quaternion } => {
                let [i, j, k, w] = quaternion.unwrap_or([0.0, 0.0, 0.0, 1.0]);
                pose::from_tum(&[*x, *y, *z, i, j, k, w])
            }
            _ => Err("expected translation and quaternion = [x, y, z, w], or matrix (16 numbers, row by row)".into()),
        }
    }
}
